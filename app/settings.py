"""The server's settings, from `RECONSTUDY_*` environment variables or the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

from ground.fields import Expected

DATA_FOLDER = "reconstudy"  # below the folder in which a command runs, where nothing else is said


class Settings(BaseSettings):
    """Where the server stores its data, and how it is reached."""

    model_config = SettingsConfigDict(env_prefix="RECONSTUDY_", frozen=True, extra="ignore")

    data_dir: Path = Field(default=Path(DATA_FOLDER), description="folder of the embedded database and the pair videos")
    database_url: str | None = Field(default=None, description="SQLAlchemy URL; unset: SQLite in the data folder")
    stimuli_dir: Path | None = Field(
        default=None,
        description="folder of the stimulus sets that the dashboard offers; unset: stimuli in the data folder",
    )
    intake_folder: Path | None = Field(
        default=None,
        description="folder of recordings, films and what jobs made of them; unset: intake in the data folder",
    )
    largest_upload_mb: int = Field(default=4096, ge=1, description="limit of an uploaded zip file, packed and unpacked")
    jobs_cluster: Annotated[str | None, Expected("the address of a scheduler, such as tcp://HOST:8786")] = Field(
        default=None,
        pattern=r"^[a-z]+://\S+$",
        description="Dask scheduler of jobs that reconstruct, tcp://HOST:8786; unset: their worker does it",
    )
    jobs_device: Literal["cpu", "gpu"] = Field(
        default="cpu", description="where jobs that reconstruct match: cpu or gpu"
    )
    longest_job_h: float = Field(default=72, gt=0, description="after how many hours a job is ended")
    largest_intake_mb: int = Field(
        default=65536, ge=1, description="limit of an upload to the intake folder, packed and unpacked"
    )
    most_intake_files: int = Field(default=200_000, ge=1, description="limit of files in such an upload")
    api_requests_per_minute: int = Field(default=1200, ge=1, description="limit for each token or experimenter")
    sessions_per_minute: int = Field(
        default=600, ge=1, description="limit of sessions that begin from one network address; a laboratory shares one"
    )
    secure_cookies: bool = Field(default=False, description="send cookies over https only; set it behind a TLS proxy")
    hsts_subdomains: bool = Field(
        default=False,
        description="with secure cookies: let browsers use https for all hosts below this one's name, too",
    )
    second_factor: Literal["offered", "required"] = Field(
        default="offered", description="required: without one, the dashboard shows an experimenter their account alone"
    )
    public_url: Annotated[str | None, Expected("http:// or https:// and a host, without a path")] = Field(
        default=None,
        pattern="^https?://[^/]+$",
        description="address that people use, for links, for example https://study.example.org; unset: as they ask",
    )
    allowed_hosts: str | None = Field(
        default=None,
        description="host names to answer to, with commas between, * for any; unset: IP addresses and this machine's "
        "name; that of the public address always",
    )
    media_accel: Annotated[str | None, Expected("a path that begins and ends with /")] = Field(
        default=None,
        pattern="^/.*/$",
        description="internal nginx path of the pair videos, for example /pairs/",
    )
    media_url: str | None = Field(
        default=None,
        description="where browsers fetch the pair videos: s3://bucket/folder, …, or https:// of a public host",
    )
    check_browser: str = Field(
        default="auto",
        description="browser that plays a study's films before people see them: auto finds Chromium or Chrome, none "
        "leaves it out, else its path",
    )
    backup_encrypt_to: str | None = Field(
        default=None,
        description="public key (age1…, ssh-ed25519 …) to which backups are encrypted, or a file of such keys",
    )
    log_format: Literal["text", "json"] = Field(
        default="text", description="json: a line for every request, to standard error"
    )

    @property
    def url(self) -> str:
        if self.database_url:
            return self.database_url
        path = str((self.data_dir / "study.sqlite").absolute())
        return f"sqlite:///{path.replace('%', '%25').replace('?', '%3F')}"  # else it would end, or be read, there

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
    def intake_dir(self) -> Path:
        return self.intake_folder or self.data_dir / "intake"

    @property
    def private_dirs(self) -> tuple[Path, ...]:
        """Folders in the data folder that the server's user alone may enter: all but the films, which nginx may send.

        An intake folder elsewhere is the operator's to protect.
        """
        names = ("intake", "models", "reports", "stills", "uploads", "work")
        return tuple(self.data_dir / name for name in names)

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
