"""What a setting of a command says about itself: to the command line, to the forms of jobs, and in JSON Schema.

A study's option has a `Setting` of its own (`app/study/option_fields.py`), without flags: it says when it may change,
and how a form enters it. Both take type and bounds from `ground/fields.py`; label and choices alone are common to both.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from types import ModuleType
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field
from pydantic.fields import FieldInfo

from ground.fields import taken

FRAME_RANGE = r"\d*:\d*|[1-9]\d*"
NAME = r"[^\W_][\w .+-]*"  # of datasets and approaches
NAMES = rf"{NAME}(?:, *{NAME})*"
NUMBER = r"-?\d+(?:\.\d+)?"
OUT = ("--out", "-o")
OR_URL = "or an fsspec URL such as s3://BUCKET/NAME"
PLUGIN_NAMES = "installed plug-ins"  # in a help: what stands for the names of those that are installed


D = TypeVar("D")


@dataclass(frozen=True, kw_only=True)
class Setting:
    """What a field of a command's model says beyond its type, default, bounds and help.

    Parameters
    ----------
    flags : of the command line; empty: "--" and the field's name, with "--no-" too if it is true or false
    is_argument : whether it is given by its place, without a flag
    is_place : whether it takes an fsspec URL, too
    metavar : what stands for its value in the help
    label : in a form; empty: no form offers the setting
    note : in a form, where the help does not fit there
    choices : what each value means, by value
    is_several : whether it takes some of the choices, with commas between
    form : regular expression of a text
    example : such a text
    low, high : bounds of a number in a form, where the command has none or wider ones
    is_blank : whether a form leaves it empty for the default of the command
    """

    flags: tuple[str, ...] = ()
    is_argument: bool = False
    is_place: bool = False
    metavar: str | None = None
    label: str = ""
    note: str | None = None
    choices: Mapping[str, str] = field(default_factory=dict)
    is_several: bool = False
    form: str = ""
    example: str = ""
    low: float | None = None
    high: float | None = None
    is_blank: bool = False

    def flag(self, name: str) -> str:
        """Return the flag by which a command line gives the setting of a field; empty: by its place."""
        default = "" if self.is_argument else f"--{name.replace('_', '-')}"
        return self.flags[0] if self.flags else default

    def in_form(self, meaning: str) -> str:
        """Return what a form says after the label: the help, where an empty field stands for the default."""
        if self.note is not None:
            return self.note
        rest = meaning.removeprefix(self.label).lstrip(",; ").removesuffix(".")
        return rest.replace("default:", "empty:").replace("Default:", "Empty:")

    def __call__(self, schema: dict[str, Any]) -> None:
        """Add the example to the JSON Schema of the field."""
        schema |= {"examples": [self.example]} if self.example else {}


class Command(BaseModel):
    """The settings of a command, in the order of its help."""

    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)  # built by the one command that runs

    def filled_in(self, kind: type[D], **others: object) -> D:
        """Fill a dataclass with the settings that have the names of its fields, and with others.

        Parameters
        ----------
        kind : the dataclass
        others : values of its other fields, and of those whose setting means something else
        """
        alike = {part.name: getattr(self, part.name) for part in fields(kind) if part.name in type(self).model_fields}  # type: ignore[arg-type]
        return kind(**alike | others)


def option(
    default: Any,
    meaning: str,
    *,
    gt: float | None = None,
    ge: float | None = None,
    le: float | None = None,
    **said: Any,
) -> Any:
    """Return the field of a setting that a flag gives.

    Parameters
    ----------
    default : the value where it is not given; ... if it must be
    meaning : the help
    gt, ge, le : bounds
    said : as `Setting` takes it
    """
    return Field(default, description=meaning, gt=gt, ge=ge, le=le, json_schema_extra=Setting(**said))


def argument(meaning: str, **said: Any) -> Any:
    """Return the field of a setting that is given by its place, see `option`."""
    return option(..., meaning, is_argument=True, **said)


def settings_of(command: type[Command]) -> Iterator[tuple[str, FieldInfo, Setting]]:
    """Return each field of a command: its name, its type with default and bounds, and what it says about itself."""
    for name, info in command.model_fields.items():
        if isinstance(info.json_schema_extra, Setting):
            yield name, info, info.json_schema_extra


def bounds(info: FieldInfo) -> tuple[float | None, float | None]:
    """Return the lowest and the highest value that a field takes; None: any."""
    value = taken(info)
    return value.bound("ge"), value.bound("le")


def commands_of(*modules: ModuleType) -> Mapping[str, type[Command]]:
    """Return the settings of the commands in modules by what is typed: `CaptureSynth` are those of `capture synth`."""
    return {
        re.sub("(?<=[a-z])(?=[A-Z])", " ", name).lower(): command
        for module in modules
        for name, command in vars(module).items()
        if isinstance(command, type) and issubclass(command, Command) and command.__module__ == module.__name__
    }
