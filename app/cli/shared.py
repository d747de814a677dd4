"""What several groups of commands share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

import typer

from recon.cli.console import ProgressLine

DEFAULT_URL = "http://127.0.0.1:8000"
UrlOption = Annotated[str, typer.Option(help="Where the server is reached, for the links that are printed.")]


def counted(progress: ProgressLine) -> Callable[[int, int, str], None]:
    """Progress as the server reports it; the first word names the step, the rest the item at hand."""
    return lambda done, total, what: progress(what.split(" ")[0], done, total) if what else None
