"""The server's settings, from `RECONSTUDY_*` environment variables or given by the command line."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict


class Settings(BaseSettings):
    """Where the server keeps what it knows, and how it meets the outside."""

    model_config = SettingsConfigDict(env_prefix="RECONSTUDY_", frozen=True, extra="ignore")

    data_dir: Path = Field(
        default=Path("reconstudy"), description="folder of the embedded database and the pair videos"
    )
    database_url: str | None = Field(default=None, description="SQLAlchemy URL; unset: SQLite in the data folder")
    secure_cookies: bool = Field(default=False, description="send cookies over https only; set it behind a TLS proxy")

    @property
    def url(self) -> str:
        return self.database_url or f"sqlite:///{(self.data_dir / 'study.sqlite').absolute()}"

    @property
    def is_embedded(self) -> bool:
        return self.database_url is None

    @property
    def media_dir(self) -> Path:
        return self.data_dir / "pairs"
