"""The command `schema`: JSON Schema of what users write, so that editors complete and check it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Annotated

import typer
from pydantic import BaseModel

from app.operations.commands import COMMANDS

SCHEMAS: Mapping[str, type[BaseModel]] = {**COMMANDS}

app = typer.Typer()


@app.command()
def schema(
    name: Annotated[list[str], typer.Argument(help="Whose: a command, such as `reconstruct` or `capture import`.")],
) -> None:
    """Print JSON Schema of settings, for editors and programs."""
    model = SCHEMAS.get(" ".join(name))
    if model is None:
        raise typer.BadParameter(f"{' '.join(name)!r} has no schema; expected one of {', '.join(SCHEMAS)}")
    print(json.dumps(model.model_json_schema(), indent=2))
