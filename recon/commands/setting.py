"""What a setting of a command says about itself: to the command line, to the forms of jobs, and in JSON Schema."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from pydantic import BaseModel, ConfigDict
from pydantic.fields import FieldInfo

FRAME_RANGE = r"\d*:\d*"
NAME = r"[^\W_][\w .+-]*"  # of datasets and approaches
NAMES = rf"{NAME}(?:, *{NAME})*"
NUMBER = r"-?\d+(?:\.\d+)?"
OR_URL = "or an fsspec URL such as s3://BUCKET/NAME"
PLUGIN_NAMES = "installed plug-ins"  # in a help: what stands for the names of those that are installed


@dataclass(frozen=True)
class Setting:
    """Describes an option of a command; the field of its model adds type, default and bounds.

    Parameters
    ----------
    help : on the command line, and in a form where that has no `note`
    label : in a form; empty: no form offers the setting
    note : in a form, in place of the help
    flags : of the command line; empty: "--" and the field's name, with "--no-" if it is true or false
    metavar : what stands for its value in the help
    is_place : whether it takes an fsspec URL, too
    choices : what each value means, by value
    is_several : whether it takes some of the choices, with commas between
    form : regular expression of a text
    example : such a text
    low, high : bounds of a number in a form, where the command has none or wider ones
    is_blank : whether a form leaves it empty for the default of the command
    """

    help: str
    label: str = ""
    note: str | None = None
    flags: tuple[str, ...] = ()
    metavar: str | None = None
    is_place: bool = False
    choices: Mapping[str, str] = field(default_factory=dict)
    is_several: bool = False
    form: str = ""
    example: str = ""
    low: float | None = None
    high: float | None = None
    is_blank: bool = False

    def flag(self, name: str) -> str:
        """Return the flag by which a command line gives the setting of a field; empty: by its place."""
        return self.flags[0] if self.flags else f"--{name.replace('_', '-')}"

    def __get_pydantic_json_schema__(self, core_schema: Any, handler: Any) -> dict[str, Any]:
        """Add what the setting says to the JSON Schema of its field."""
        schema: dict[str, Any] = handler(core_schema)
        more = {"title": self.label, "description": self.help, "examples": [self.example] if self.example else []}
        return schema | {key: value for key, value in more.items() if value}


@dataclass(frozen=True)
class Argument(Setting):
    """Describes what a command takes by its place."""

    def flag(self, name: str) -> str:  # noqa: ARG002
        """Return no flag."""
        return ""


class Command(BaseModel):
    """The settings of a command, in the order of its help."""

    model_config = ConfigDict(frozen=True, extra="forbid")


def settings_of(command: type[Command]) -> Iterator[tuple[str, FieldInfo, Setting]]:
    """Return each field of a command: its name, its type with default and bounds, and what it says about itself."""
    for name, info in command.model_fields.items():
        yield name, info, next(each for each in info.metadata if isinstance(each, Setting))


def bounds(info: FieldInfo) -> tuple[float | None, float | None]:
    """Return the lowest and the highest value that a field takes; None: any."""
    found = {end: getattr(each, end) for each in info.metadata for end in ("ge", "le") if hasattr(each, end)}
    return found.get("ge"), found.get("le")
