"""Options and progress that several groups of commands share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from recon.cli.console import ProgressLine

if TYPE_CHECKING:
    from app.ffmpeg import Progress

UrlOption = Annotated[
    str | None,
    typer.Option(
        help="Address of the server, for printed links; default: the public one, where it runs, or port 8000."
    ),
]


def by_step(progress: ProgressLine) -> Progress:
    """Show the server's progress with a line for each step: its first word names the step, the rest the item."""
    return lambda what, done, total: progress(what.split(" ")[0], done, total) if what else None
