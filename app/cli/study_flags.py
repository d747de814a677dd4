"""Give a command a flag for each option of a study that fits on a command line, as the options declare them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from inspect import Parameter, Signature
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

if TYPE_CHECKING:
    from app.study.option_fields import Setting

TYPES: dict[str, Any] = {
    "flag": bool | None,
    "whole": int | None,
    "number": float | None,
    "choice": str | None,
    "condition": str | None,
    "conditions": list[str] | None,
    "dataset": str | None,
}
SHORTER = {"practice_dataset": "practice"}  # names of flags that are not those of their options


GIVEN = "options given as flags"


class CommandWithOptionFlags(TyperCommand):
    """A command that takes a flag for each option; it finds those given in `context.meta[GIVEN]`, by their names.

    The options are imported once the command's parameters are asked for: no other command waits for them.
    """

    flags: Sequence[Any] = ()

    def get_params(self, ctx: Any) -> Any:
        """Return the command's parameters, and a flag for each option."""
        if not self.flags:
            self.flags = _flags()
            self.params += self.flags
        return super().get_params(ctx)

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        values = {flag.name: ctx.params.pop(flag.name) for flag in self.flags}
        ctx.meta[GIVEN] = {name: value for name, value in values.items() if value not in (None, [], ())}
        return super().invoke(ctx)


def _flags() -> Sequence[Any]:
    def flags() -> None:
        """Bear the parameters, for typer to read."""

    parameters = list(_parameters())
    flags.__signature__ = Signature(parameters)  # type: ignore[attr-defined]  # PEP 362
    flags.__annotations__ = {each.name: each.annotation for each in parameters}
    app = typer.Typer(add_completion=False)
    app.command()(flags)
    return typer.main.get_command(app).params


def _parameters() -> Iterator[Parameter]:
    from app.study.options.option_table import COLUMNS, SETTINGS

    for setting in SETTINGS:
        if setting.kind not in TYPES or setting.name != setting.option or setting.name in COLUMNS:
            continue
        name = SHORTER.get(setting.name, setting.name).replace("_", "-")
        names = f"--{name}/--no-{name}" if setting.kind == "flag" else f"--{name}"
        low = setting.low if setting.kind in ("whole", "number") else None
        option = typer.Option(names, help=_help(setting), min=low, show_default=False)
        annotation: Any = Annotated[TYPES[setting.kind], option]
        yield Parameter(setting.name, Parameter.POSITIONAL_OR_KEYWORD, default=None, annotation=annotation)


def _help(setting: Setting) -> str:
    choices = "; ".join(f"{key or repr('')}: {what}" for key, what in setting.choices.items())
    repeatable = " May be repeated." if setting.kind == "conditions" else ""
    return f"{setting.label}: {setting.text}{f' ({choices})' if choices else ''}.{repeatable}"
