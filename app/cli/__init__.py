"""The command `reconstudy`: studies, analysis and the server, with the reconstruction's commands mounted.

Each command imports what it needs when it runs: `--help` is quick, and the server loads no reconstruction backend.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from difflib import get_close_matches
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import typer

from app.cli import analysis, experiments, languages, planning, schema, server, stimuli, studies
from app.errors import StudyError, said_on_page
from app.operations.extras import missing_extra
from recon.cli.main import app as recon_app
from recon.cli.options import LocalPathsGroup
from recon.runtime.remote import with_addresses

GOING_ON = ("demo", "experiment", "reconstruct", "render")  # commands that keep what is done for a second start
DONE_FILE = "RECONSTUDY_DONE_FILE"  # names a file that a command makes when it has done all, for who runs it
INTERRUPTED = 130  # exit code, as shells have it
ALMOST = 0.9  # likeness of two names: one or two letters of twenty differ

app = typer.Typer(cls=LocalPathsGroup, no_args_is_help=True, pretty_exceptions_enable=False)
for part in (
    recon_app,
    experiments.app,
    stimuli.app,
    studies.app,
    languages.app,
    server.app,
    analysis.app,
    planning.app,
    schema.app,
):
    app.add_typer(part)


def _print_version(is_asked: bool) -> None:
    if is_asked:
        print(f"reconstudy {version('reconstudy')}")
        raise typer.Exit


@app.callback()
def options(
    _version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    """Objective and subjective evaluation of multi-stereo 3D reconstruction."""


def main() -> None:
    """Run the command line; exits with 0 when done, 1 with a sentence that says what failed, 2 after wrong use."""
    for name, meant in _misspelled_settings():
        print(f"warning: {name} is no setting and changes nothing; did you mean {meant}?", file=sys.stderr)
    try:
        app()
    except KeyboardInterrupt:
        _fail(_interrupted(), code=INTERRUPTED)
    except SystemExit as end:
        if end.code == INTERRUPTED:  # typer has taken the interrupt, and says nothing
            _fail(_interrupted(), code=INTERRUPTED)
        if not end.code and (done := os.environ.get(DONE_FILE)):
            Path(done).touch()
        raise
    except (ImportError, ValueError, OSError, RuntimeError) as error:
        advice = missing_extra(error)
        if "RECONSTUDY_DEBUG" in os.environ or (advice is None and isinstance(error, ModuleNotFoundError)):
            raise
        _fail(f"{error}; {advice}" if advice else _sentence(error))
    except MemoryError as error:
        if "RECONSTUDY_DEBUG" in os.environ:
            raise
        cause = f" ({error})" if str(error) else ""
        _fail(f"the memory is not enough{cause}; ask for less, or use a machine with more")
    except StudyError as error:
        if reason := getattr(error.__cause__, "orig", None):  # what the database itself said, where it is away
            _fail(
                f"the database cannot be used: {reason}; `reconstudy status` tells where it lies and what space is "
                "left; run it as the server's user"
            )
        _fail(error.detail)


def _interrupted() -> str:
    goes_on = len(sys.argv) > 1 and sys.argv[1] in GOING_ON
    return f"interrupted{'; started again, it goes on where it was' if goes_on else ''}"


def _sentence(error: Exception) -> str:
    """Say what failed; of the system's errors without their number, and with what is in the way."""
    if isinstance(error, ValueError) and (setting := _wrong_setting(error)):
        return setting
    if not isinstance(error, OSError) or not isinstance(error.filename, str) or error.strerror is None:
        return with_addresses(said_on_page(error) if DONE_FILE in os.environ else str(error))
    path = Path(error.filename2 or error.filename)  # the second: where a temporary file was to go
    if isinstance(error, PermissionError):
        while not os.path.exists(path) and path != path.parent:  # noqa: PTH110  # Path.exists raises this error again
            path = path.parent
        return f"{path}: permission denied; look at who may read or write it"
    if isinstance(error, FileExistsError | NotADirectoryError):
        for place in (path, *path.parents):
            if place.is_file():
                return f"{place}: is a file, expected a folder; choose another name"
    return f"{path}: {error.strerror.lower()}"


def _misspelled_settings() -> Iterator[tuple[str, str]]:
    """Find environment variables that are almost a setting of the server: nothing reads them."""
    given = [name for name in os.environ if name.startswith("RECONSTUDY_")]
    if not given:
        return
    from app.settings import Settings

    settings = [f"RECONSTUDY_{name.upper()}" for name in Settings.model_fields]
    for name in sorted(set(given) - set(settings)):
        if meant := get_close_matches(name, settings, n=1, cutoff=ALMOST):
            yield name, meant[0]


def _wrong_setting(error: ValueError) -> str | None:
    """Name the environment variable that the server's settings refuse, and what it is for; None of other errors."""
    from pydantic import ValidationError

    from app.settings import Settings
    from ground.file_models import faults_of

    if not isinstance(error, ValidationError) or error.title != Settings.__name__:
        return None
    fault = faults_of(error, Settings)[0]
    name = str(fault.place[0])
    return f"RECONSTUDY_{name.upper()} {fault.words}. Its meaning: {Settings.model_fields[name].description}"


def _fail(sentence: str, code: int = 1) -> None:
    clear_line = "\r\x1b[K" if sys.stderr.isatty() else ""  # of the progress, which the error has stopped
    print(f"{clear_line}reconstudy: {sentence}", file=sys.stderr)
    sys.exit(code)
