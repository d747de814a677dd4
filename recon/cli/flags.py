"""Give a command the arguments and flags of its settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import wraps
from inspect import Parameter, Signature, signature
from typing import Annotated, Any, Concatenate, Literal, TypeVar, get_args, get_origin

import typer
from pydantic import ValidationError
from pydantic.fields import FieldInfo

from ground.file_models import faults_of
from recon.cli.commands.setting import Command, Setting, bounds, settings_of
from recon.cli.console import JsonOption
from recon.cli.options import parse_place, telling
from recon.runtime.notices import Notice

C = TypeVar("C", bound=Command)

BESIDE = (  # the settings, a command may take
    Parameter("as_json", Parameter.KEYWORD_ONLY, default=False, annotation=JsonOption),
    Parameter("context", Parameter.KEYWORD_ONLY, annotation=typer.Context),
)


def with_settings(
    settings: type[C], **more: dict[str, Any]
) -> Callable[[Callable[Concatenate[C, ...], None]], Callable[..., None]]:
    """Let a command take the settings as its arguments and flags, and what it takes of `BESIDE`.

    Parameters
    ----------
    settings : of the command
    more : what typer is told of single fields beyond what they say, by their names
    """

    def decorated(command: Callable[Concatenate[C, ...], None]) -> Callable[..., None]:
        beside = [part for part in BESIDE if part.name in signature(command).parameters]

        @wraps(command)
        def with_flags(**given: Any) -> None:
            others = {part.name: given.pop(part.name) for part in beside}
            asked = _checked(settings, given)
            with telling(Notice):
                command(asked, **others)

        parameters = [_parameter(*field, more.get(field[0], {})) for field in settings_of(settings)]
        parameters += beside
        with_flags.__signature__ = Signature(parameters)  # type: ignore[attr-defined]  # PEP 362
        with_flags.__annotations__ = {each.name: each.annotation for each in parameters}
        return with_flags

    return decorated


def _checked(settings: type[C], given: Mapping[str, Any]) -> C:
    try:
        return settings(**given)
    except ValidationError as error:
        fault = faults_of(error, settings)[0]
        flag = next((said.flag(name) for name, _, said in settings_of(settings) if fault.place[:1] == (name,)), "")
        if fault.is_told or not flag:
            raise typer.BadParameter(str(fault)) from error
        raise typer.BadParameter(fault.words.removeprefix("is "), param_hint=f"'{flag}'") from error


def _parameter(name: str, info: FieldInfo, setting: Setting, more: dict[str, Any]) -> Parameter:
    low, high = bounds(info)
    shown = setting.metavar or (name.upper() if setting.is_argument else None)
    said: dict[str, Any] = {"help": info.description, "metavar": shown, "min": low, "max": high}
    said |= {"parser": parse_place} if setting.is_place else {}
    made = typer.Argument if setting.is_argument else typer.Option
    option: Any = made(*setting.flags, **said | more)
    default = Parameter.empty if info.is_required() else info.default
    annotation: Any = Annotated[_typed(info.annotation), option]
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def _typed(kind: Any) -> Any:
    """Return the type that typer reads: it takes no list of choices, which the settings then check."""
    return list[str] if get_origin(kind) is list and get_origin(get_args(kind)[0]) is Literal else kind
