"""The command `reconstudy`: studies, analysis and the server, with the reconstruction's commands mounted.

Each command imports what it needs when it runs: `--help` is quick, and the server loads no reconstruction backend.
"""

from __future__ import annotations

import os
import sys

import typer

from app.cli import analysis, experiments, server, studies
from app.errors import StudyError
from recon.cli.main import app as recon_app

BACKEND_PACKAGES = ("cv2", "numba", "pyrender", "skimage", "trimesh")

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Objective and subjective evaluation of multi-stereo 3D reconstruction.",
)
for part in (recon_app, experiments.app, studies.app, server.app, analysis.app):
    app.add_typer(part)


def main() -> None:
    """Run the command line; exits with 0 when done, 1 with a sentence that says what failed, 2 after wrong use."""
    try:
        app()
    except ModuleNotFoundError as error:
        if error.name not in BACKEND_PACKAGES:
            raise
        _fail(
            f"this command needs the reconstruction backend ({error.name} is missing): pip install 'reconstudy[recon]'"
        )
    except KeyboardInterrupt:
        _fail("interrupted", code=130)
    except (ValueError, OSError, RuntimeError) as error:
        if "RECONSTUDY_DEBUG" in os.environ:
            raise
        _fail(str(error))
    except StudyError as error:
        _fail(error.detail)


def _fail(sentence: str, code: int = 1) -> None:
    print(f"reconstudy: {sentence}", file=sys.stderr)
    sys.exit(code)
