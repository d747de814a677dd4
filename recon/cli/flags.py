"""Give a command the arguments and flags of its settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import wraps
from inspect import Parameter, Signature
from typing import Annotated, Any, Concatenate, TypeVar

import typer
from pydantic import ValidationError
from pydantic.fields import FieldInfo

from ground.file_models import faults_of
from recon.cli.commands.setting import Command, Setting, bounds, settings_of
from recon.cli.console import JsonOption
from recon.cli.options import parse_place, telling
from recon.runtime.notices import Notice

C = TypeVar("C", bound=Command)


def with_settings(
    settings: type[C], **more: dict[str, Any]
) -> Callable[[Callable[Concatenate[C, ...], None]], Callable[..., None]]:
    """Let a command take the settings as its arguments and flags, and `--json`.

    Parameters
    ----------
    settings : of the command
    more : what typer is told of single fields beyond what they say, by their names
    """

    def decorated(command: Callable[Concatenate[C, ...], None]) -> Callable[..., None]:
        @wraps(command)
        def with_flags(*, as_json: bool, **given: Any) -> None:
            asked = _checked(settings, given)
            with telling(Notice):
                command(asked, as_json=as_json)

        parameters = [_parameter(*field, more.get(field[0], {})) for field in settings_of(settings)]
        parameters.append(Parameter("as_json", Parameter.KEYWORD_ONLY, default=False, annotation=JsonOption))
        with_flags.__signature__ = Signature(parameters)  # type: ignore[attr-defined]  # PEP 362
        with_flags.__annotations__ = {each.name: each.annotation for each in parameters}
        return with_flags

    return decorated


def _checked(settings: type[C], given: Mapping[str, Any]) -> C:
    try:
        return settings(**given)
    except ValidationError as error:
        raise typer.BadParameter(str(faults_of(error, settings)[0])) from error


def _parameter(name: str, info: FieldInfo, setting: Setting, more: dict[str, Any]) -> Parameter:
    low, high = bounds(info)
    shown = setting.metavar or (name.upper() if setting.is_argument else None)
    said: dict[str, Any] = {"help": info.description, "metavar": shown, "min": low, "max": high}
    said |= {"parser": parse_place} if setting.is_place else {}
    made = typer.Argument if setting.is_argument else typer.Option
    option: Any = made(*setting.flags, **said | more)
    default = Parameter.empty if info.is_required() else info.default
    annotation: Any = Annotated[info.annotation, option]
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
