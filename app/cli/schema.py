"""The command `schema`: JSON Schema of what users write, so that editors complete and check it."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from pydantic import BaseModel

app = typer.Typer()


def _study() -> type[BaseModel]:
    from app.study.options.study_file import StudyFile

    return StudyFile


def _capture() -> type[BaseModel]:
    from recon.capture.schema import CaptureContent

    return CaptureContent


def _scene() -> type[BaseModel]:
    from recon.models.scene_file import SceneContent

    return SceneContent


def _manifest() -> type[BaseModel]:
    from app.intake.stimuli import Manifest

    return Manifest


def _methods() -> type[BaseModel]:
    from recon.cli.methods_model import methods_file

    return methods_file()


FILES: Mapping[str, Callable[[], type[BaseModel]]] = {
    "study": _study,
    "capture": _capture,
    "scene": _scene,
    "manifest": _manifest,
    "methods": _methods,
}


def schemas() -> Mapping[str, Callable[[], type[BaseModel]]]:
    """Return what loads the model of each thing that users write, by name."""
    from app.operations.commands import COMMANDS

    return {**FILES, **{name: partial(_given, command) for name, command in COMMANDS.items()}}


def _given(model: type[BaseModel]) -> type[BaseModel]:
    return model


@app.command()
def schema(
    name: Annotated[
        list[str],
        typer.Argument(
            metavar="NAME", help=f"Whose: {', '.join(FILES)}, or a command, such as `reconstruct` or `capture import`."
        ),
    ],
) -> None:
    """Print JSON Schema of a file that you write, or of a command's settings, for editors and programs.

    `reconstudy schema study > study.schema.json` beside a study file lets an editor complete and check it.
    """
    models, wanted = schemas(), " ".join(name)
    if wanted not in models:
        raise typer.BadParameter(f"{wanted!r} has no schema; expected one of {', '.join(models)}")
    print(json.dumps(models[wanted]().model_json_schema(), indent=2))
