"""The server's settings, from `RECONSTUDY_*` environment variables or the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict


class Settings(BaseSettings):
    """Where the server stores its data, and how it is reached."""

    model_config = SettingsConfigDict(env_prefix="RECONSTUDY_", frozen=True, extra="ignore")

    data_dir: Path = Field(
        default=Path("reconstudy"), description="folder of the embedded database and the pair videos"
    )
    database_url: str | None = Field(default=None, description="SQLAlchemy URL; unset: SQLite in the data folder")
    stimuli_dir: Path | None = Field(
        default=None,
        description="folder of the stimulus sets that the dashboard offers; unset: stimuli in the data folder",
    )
    largest_upload_mb: int = Field(default=4096, ge=1, description="limit of an uploaded zip file, packed and unpacked")
    api_requests_per_minute: int = Field(default=1200, ge=1, description="limit for each token or experimenter")
    secure_cookies: bool = Field(default=False, description="send cookies over https only; set it behind a TLS proxy")

    media_accel: str | None = Field(
        default=None,
        pattern="^/.*/$",
        description="internal nginx path of the pair videos, for example /pairs/",
    )
    media_url: str | None = Field(
        default=None,
        description="where browsers fetch the pair videos: s3://bucket/folder, …, or https:// of a public host",
    )
    log_format: Literal["text", "json"] = Field(
        default="text", description="json: a line for every request, to standard error"
    )

    @property
    def url(self) -> str:
        return self.database_url or f"sqlite:///{(self.data_dir / 'study.sqlite').absolute()}"

    @property
    def is_embedded(self) -> bool:
        return self.database_url is None

    @property
    def is_sqlite(self) -> bool:
        return self.url.startswith("sqlite")

    @property
    def sets_dir(self) -> Path:
        return self.stimuli_dir or self.data_dir / "stimuli"

    @property
    def languages_dir(self) -> Path:
        """Folder of the experimenter's own language packs."""
        return self.data_dir / "languages"

    @property
    def media_dir(self) -> Path:
        return self.data_dir / "pairs"

    def as_environment(self) -> dict[str, str]:
        """Return these settings as environment variables, for a child process."""
        values = self.model_dump(mode="json", exclude_none=True)
        return {f"RECONSTUDY_{name.upper()}": str(value) for name, value in values.items()}
