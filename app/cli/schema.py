"""The command `schema`: JSON Schema of what users write, so that editors complete and check it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from pydantic import BaseModel

app = typer.Typer()


def schemas() -> Mapping[str, type[BaseModel]]:
    """Return the models of what users write, by name."""
    from app.operations.commands import COMMANDS
    from app.study.options.study_file import StudyFile
    from recon.models.scene_file import SceneContent

    return {"study": StudyFile, "scene": SceneContent, **COMMANDS}


@app.command()
def schema(
    name: Annotated[
        list[str], typer.Argument(help="Whose: study, scene, or a command, such as `reconstruct` or `capture import`.")
    ],
) -> None:
    """Print JSON Schema of a study file, of `scene.json` or of a command's settings, for editors and programs."""
    models, wanted = schemas(), " ".join(name)
    if wanted not in models:
        raise typer.BadParameter(f"{wanted!r} has no schema; expected one of {', '.join(models)}")
    print(json.dumps(models[wanted].model_json_schema(), indent=2))
