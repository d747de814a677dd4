"""Declare an option once, as the field of a model: its type, default, bounds and words.

From the field come the reading of a study file, the refusal, the JSON Schema, the dashboard's form, the flag of a
command and the row of the documentation.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from types import NoneType
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar, get_args, get_origin

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    GetJsonSchemaHandler,
    Strict,
    StringConstraints,
    ValidationError,
)
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, PydanticCustomError

from ground.fields import taken
from ground.file_models import shown

Change = Literal["any time", "until begun", "with films"]
ANY_TIME: Change = "any time"
UNTIL_BEGUN: Change = "until begun"  # all participants see the same study
WITH_FILMS: Change = "with films"  # until begun, and the films are made again from the stimulus set

Kind = Literal[
    "",
    "text",
    "document",
    "flag",
    "whole",
    "number",
    "choice",
    "several",
    "names",
    "window",
    "dataset",
    "condition",
    "conditions",
    "questions",
    "spoken",
    "films",
]
KINDS: Mapping[Any, Kind] = {bool: "flag", int: "whole", float: "number", str: "text", Literal: "choice"}

T = TypeVar("T")


class SettingError(ValueError):
    """A wrong value of a setting.

    Parameters
    ----------
    field : its name in a study file, within [options]; of a table of options "table.key"
    words : what was found and what is expected, to stand after the name
    place : in the sentence, instead of the name
    """

    def __init__(self, field: str, words: str, place: str = "") -> None:
        super().__init__(field, words, place)  # all of them, so that another process can hand it on
        self.field = field
        self._words = words
        self._name = field.replace(".", ": ")
        self._place = place or self._name

    def __str__(self) -> str:
        return f"{self._place} {self._words}"

    def called(self, label: str) -> str:
        """Return the sentence with a label in place of the name, where it begins with the name."""
        return f"{label} {self._words}" if self._place == self._name else str(self)


def _different(parts: tuple[T, ...]) -> tuple[T, ...]:
    if len(set(parts)) < len(parts):
        raise PydanticCustomError("not_different", "expected different ones")
    return parts


Different = AfterValidator(_different)
ListOf = Annotated[tuple[T, ...], Strict(False)]  # files hold lists
Names = Annotated[ListOf[str], AfterValidator(lambda names: tuple(dict.fromkeys(names)))]  # each once
Note = Annotated[str, StringConstraints(strip_whitespace=True, max_length=500)]


@dataclass(frozen=True)
class Setting:
    """The words of an option, as a form shows it; what its field says besides is filled in by `settings_of`.

    Parameters
    ----------
    label, text : what the form calls it, and what it does in a sentence
    change : when it may change
    section : of the form; empty: that of its table, or none
    kind : how it is entered; empty: as its type tells
    choices : of a choice, or of several: what they mean, by value
    step : of a number; "any": any number
    expected : what a refusal expects; empty: as type and bounds tell
    is_basic : does nearly every study set it? The form shows it first, and the others folded
    name : key in the study file, within [options]; of a table of options "table.key"
    low, high : of a number
    longest : most characters of a text
    may_be_empty : a number may be left out
    """

    label: str
    text: str
    change: Change = UNTIL_BEGUN
    section: str = ""
    kind: Kind = ""
    choices: Mapping[str, str] = field(default_factory=dict)
    step: str = ""
    expected: str = ""
    is_basic: bool = False
    name: str = ""
    low: float | None = None
    high: float | None = None
    longest: int | None = None
    may_be_empty: bool = False

    @property
    def option(self) -> str:
        """Name of the option that it belongs to: its own, or its table's."""
        return self.name.partition(".")[0]

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Give the option its words in the JSON Schema."""
        return {**handler(core), "title": self.label, "description": self.text}


class Options(BaseModel):
    """Options of one subject, right as soon as they are there; every field bears a `Setting`."""

    called: ClassVar[str] = ""  # in refusals: one of several, and its keys where they stand in no table
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    @classmethod
    def read(cls, content: Any) -> Self:
        """Read options from a file or from JSON.

        Raises
        ------
        ValueError
            Naming the key, the value and what is expected.
        """
        try:
            return cls.model_validate(content)
        except ValidationError as error:
            raise _refusal(error, cls, content) from error

    def as_json(self) -> dict[str, Any]:
        """Return the options as `read` takes them."""
        return self.model_dump(mode="json")

    def but(self, **changes: Any) -> Self:
        """Return the options with some changed, checked as by `read`."""
        return self.read({**dict(self), **changes})


def settings_of(model: type[Options], table: str = "") -> Iterator[Setting]:
    """Yield the settings of a model and of the tables in it.

    Parameters
    ----------
    model : of the options
    table : its name; empty: the study's options themselves
    """
    for key, info in model.model_fields.items():
        if is_table(info):
            yield from settings_of(info.annotation, key)  # type: ignore[arg-type]  # which is_table says
        else:
            yield _completed(info, f"{table}.{key}" if table else key, table)


def is_table(info: FieldInfo) -> bool:
    """Is a field a table of options?"""
    return isinstance(info.annotation, type) and issubclass(info.annotation, Options)


def _completed(info: FieldInfo, name: str, table: str) -> Setting:
    setting, kind, value = _setting(info), _kind(info), taken(info)
    return replace(
        setting,
        name=name,
        section=setting.section or table,
        kind=kind,
        step=setting.step or ("any" if kind == "number" else "1"),
        low=value.bound("ge") if setting.low is None else setting.low,
        high=value.bound("le"),
        longest=value.bound("max_length") if value.kind is str else None,
        may_be_empty=NoneType in get_args(info.annotation),
    )


def _setting(info: FieldInfo) -> Setting:
    return next(each for each in info.metadata if isinstance(each, Setting))


def _kind(info: FieldInfo) -> Kind:
    kind = _type(info)
    if get_origin(kind) is tuple:
        return _setting(info).kind or ("several" if get_origin(get_args(kind)[0]) is Literal else "names")
    return _setting(info).kind or KINDS.get(get_origin(kind) or kind, "")


def _expected(info: FieldInfo) -> str:
    """Say in words what a field takes."""
    kind = _type(info)
    if _setting(info).expected:
        return _setting(info).expected
    if get_origin(kind) is Literal:
        return f"one of {_listed(kind)}{', or nothing' if '' in get_args(kind) else ''}"
    if get_origin(kind) is tuple:
        return "a list of names" if get_args(kind)[0] is str else f"some of {_listed(get_args(kind)[0])}"
    return taken(info).words


def _type(info: FieldInfo) -> Any:
    return taken(info).kind


def _listed(literal: Any) -> str:
    return ", ".join(str(value) for value in get_args(literal) if value != "")


def _refusal(error: ValidationError, model: type[Options], content: Any) -> ValueError:
    """Say in one sentence what is wrong with options, and what is expected: an unknown key before a wrong value."""
    faults = error.errors(include_url=False)
    fault = next((fault for fault in faults if fault["type"] == "extra_forbidden"), faults[0])
    if fault["type"] == "value_error":  # of a check of our own, which says it all
        told: ValueError = fault["ctx"]["error"]
        return told
    place: list[Any] = list(fault["loc"])
    key, at, content_of = place.pop(0), "", content
    field = str(key)
    while place and (inner := _inner(model, key)):
        model, content_of, at = inner, content_of[key], str(key)
        if isinstance(place[0], int):
            content_of, at = content_of[place[0]], f"{inner.called} {place.pop(0) + 1}"
        elif place:
            field = f"{field}.{place[0]}"
        if not place:
            return SettingError(field, f"is {content_of!r:.120}, expected a table of its own", at)
        key = place.pop(0)
    before = f"{at}: " if at else ""
    if fault["type"] == "extra_forbidden":
        known = ", ".join(model.model_fields)
        return SettingError(field, f"is not known; expected some of {known}", f"{before or model.called}{key!r}")
    info = model.model_fields[key]
    if is_table(info):
        return SettingError(field, f"is {fault['input']!r:.120}, expected a table of its own", key)
    if place and _kind(info) == "several":
        some = _listed(get_args(_type(info))[0])
        return SettingError(field, f"holds {shown(fault['input'])}, expected some of {some}", f"{before}{key}")
    return SettingError(field, f"is {shown(content_of.get(key))}, expected {_expected(info)}", f"{before}{key}")


def _inner(model: type[Options], key: str) -> type[Options] | None:
    """Return the model of a field's table, or of the tables in its list; None: it has none."""
    kind = _type(model.model_fields[key]) if key in model.model_fields else None
    kind = get_args(kind)[0] if get_origin(kind) is tuple else kind
    return kind if isinstance(kind, type) and issubclass(kind, Options) else None
