"""Options and progress that several groups of commands share."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import typer

from recon.cli.console import ProgressLine

if TYPE_CHECKING:
    from app.ffmpeg import Progress
    from app.settings import Settings


def _server_address(url: str | None) -> str | None:
    address = url and url.rstrip("/")
    if address and not re.fullmatch(r"https?://[^/\s]+", address):
        raise typer.BadParameter(f"{url!r} is no address of a server; expected one such as https://study.example.org")
    return address


LINKS: Mapping[str, dict[str, Any]] = {"url": {"callback": _server_address}}  # of commands that print links


def once_served(settings: Settings) -> str:
    """Say behind a printed link that a server must run, where none does."""
    from app.operations.running import running_url

    return "" if running_url(settings) else " once `reconstudy serve` runs"


def by_step(progress: ProgressLine) -> Progress:
    """Show the server's progress with a line for each step: its first word names the step, the rest the item."""
    return lambda what, done, total: progress(what.split(" ")[0], done, total) if what else None


def server_settings() -> Settings:
    """Read the server's settings; commands that need none do not wait for the import."""
    from app.settings import Settings

    return Settings()
