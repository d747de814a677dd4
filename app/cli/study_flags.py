"""Give a command a flag for each option of a study that fits on a command line, from the table of settings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import wraps
from inspect import Parameter, signature
from typing import Annotated, Any, get_type_hints

import typer

from app.study.options.option_table import COLUMNS, SETTINGS, Kind, Setting

TYPES: dict[Kind, Any] = {
    "flag": bool | None,
    "whole": int | None,
    "number": float | None,
    "choice": str | None,
    "condition": str | None,
    "conditions": list[str] | None,
    "dataset": str | None,
}
SHORTER = {"practice_dataset": "practice"}  # names of flags that are not those of their options
ON_COMMAND_LINE = [
    setting
    for setting in SETTINGS
    if setting.kind in TYPES and setting.name == setting.option and setting.name not in COLUMNS
]


def with_option_flags(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the flags; it gets what was given as `given`, by the options' names."""

    @wraps(command)
    def with_flags(**arguments: Any) -> None:
        options = {setting.name: arguments.pop(setting.name) for setting in ON_COMMAND_LINE}
        command(**arguments, given={name: value for name, value in options.items() if value not in (None, [])})

    hints = get_type_hints(command, include_extras=True)
    plain = [each for each in signature(command).parameters.values() if each.name != "given"]
    parameters = [*(each.replace(annotation=hints[each.name]) for each in plain), *_flags()]
    with_flags.__signature__ = signature(command).replace(parameters=parameters)  # type: ignore[attr-defined]  # PEP 362
    with_flags.__annotations__ = {each.name: each.annotation for each in parameters}
    return with_flags


def _flags() -> Iterator[Parameter]:
    for setting in ON_COMMAND_LINE:
        name = SHORTER.get(setting.name, setting.name).replace("_", "-")
        names = f"--{name}/--no-{name}" if setting.kind == "flag" else f"--{name}"
        low = setting.low if setting.kind in ("whole", "number") else None
        option = typer.Option(names, help=_help(setting), min=low, show_default=False)
        kind: Any = TYPES[setting.kind]
        annotation: Any = Annotated[kind, option]
        yield Parameter(setting.name, Parameter.POSITIONAL_OR_KEYWORD, default=None, annotation=annotation)


def _help(setting: Setting) -> str:
    choices = "; ".join(f"{key or repr('')}: {what}" for key, what in setting.choices.items())
    repeatable = " Repeatable." if setting.kind == "conditions" else ""
    return f"{setting.label}: {setting.text}{f' ({choices})' if choices else ''}.{repeatable}"
