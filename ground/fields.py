"""What the field of a model takes, in words: for refusals and for the reference pages."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import reduce
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NotRequired, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel
from pydantic.fields import FieldInfo

LISTS = (list, tuple, Sequence)
PLAIN: Mapping[Any, str] = {
    bool: "true or false",
    Path: "a file or folder",
    datetime: "a date and time, such as 2027-03-31T18:00:00+02:00",
    NoneType: "nothing",
    Any: "another value",
}


@dataclass(frozen=True)
class Expected:
    """Say what a field takes, where its type and bounds do not say it.

    Parameters
    ----------
    words : what is expected
    is_whole : whether what is wrong within the value, such as a number of a matrix, is told of the whole value
    """

    words: str
    is_whole: bool = False


@dataclass(frozen=True)
class Taken:
    """What a value may be: a type, and the bounds and words that stand beside it."""

    kind: Any
    said: tuple[Any, ...] = ()

    def bound(self, name: str) -> Any:
        """Return a bound by its name, such as `ge` or `max_length`; None: there is none."""
        return next((getattr(each, name) for each in self.said if getattr(each, name, None) is not None), None)

    def inner(self, key: str | int) -> Taken | None:
        """Return what may stand at a key or place within the value; None: nothing that is known."""
        if is_model(self.kind):
            info = field_of(self.kind, key)
            return None if info is None else taken(info)
        if _is_typed(self.kind):
            hints = get_type_hints(self.kind, include_extras=True)
            return plain(hints[key]) if key in hints else None
        parts = get_args(self.kind)
        if get_origin(self.kind) in (*LISTS, dict) and parts:
            return plain(parts[1] if get_origin(self.kind) is dict else parts[0])
        return None

    def at(self, place: Sequence[str | int]) -> Taken:
        """Return what may stand at a place within the value, or around it as far as that is known."""
        return reduce(lambda value, key: value.inner(key) or value, place, self)

    @property
    def keys(self) -> list[str]:
        """The keys that a model or a typed dictionary has."""
        if _is_typed(self.kind):
            return list(self.kind.__annotations__)
        return [key_of(*field) for field in self.kind.model_fields.items()]

    @property
    def stated(self) -> Expected | None:
        """What the field itself says that it takes."""
        return next((each for each in self.said if isinstance(each, Expected)), None)

    @property
    def is_whole(self) -> bool:
        """Whether what is wrong within the value is told of the whole value."""
        return self.stated is not None and self.stated.is_whole

    @property
    def words(self) -> str:
        """What is expected, in words."""
        return self.stated.words if self.stated is not None else _words(self)


def is_model(kind: Any) -> bool:
    """Tell whether a type is a model, with keys of its own."""
    return isinstance(kind, type) and issubclass(kind, BaseModel)


def _is_typed(kind: Any) -> bool:
    """Tell whether a type is a typed dictionary, from whichever library."""
    return hasattr(kind, "__required_keys__")


def key_of(name: str, info: FieldInfo) -> str:
    """Return the key by which a file names a field."""
    return info.alias or name


def field_of(model: type[BaseModel], key: str | int) -> FieldInfo | None:
    """Return the field of a model by its key in a file; None: there is none."""
    return next((info for name, info in model.model_fields.items() if key_of(name, info) == key), None)


def taken(info: FieldInfo) -> Taken:
    """Return what a field takes."""
    return plain(info.annotation, tuple(info.metadata))


def plain(kind: Any, said: Sequence[Any] = ()) -> Taken:
    """Return a type without `Annotated` and without "or None", and all that stood beside it."""
    if get_origin(kind) is Annotated:
        inner, *beside = get_args(kind)
        return plain(inner, (*said, *(each for part in beside for each in _parts(part))))
    if get_origin(kind) is NotRequired:
        return plain(get_args(kind)[0], said)
    if get_origin(kind) in (Union, UnionType):
        others = [part for part in get_args(kind) if part is not NoneType]
        return plain(others[0], said) if len(others) == 1 else Taken(kind, tuple(said))
    return Taken(kind, tuple(said))


def _parts(beside: Any) -> Iterator[Any]:
    yield from beside.metadata if isinstance(beside, FieldInfo) else (beside,)


def _words(value: Taken) -> str:
    kind, low, high = value.kind, value.bound("ge"), value.bound("le")
    if kind is int:
        return f"a whole number{_range(low, high)}"
    if kind is float:
        above = value.bound("gt")
        positive = "a positive number" if high is None else f"a positive number up to {high:g}"
        return positive if above == 0 else f"a number{_range(low, high)}"
    if kind is str:
        return _text(value.bound("min_length"), value.bound("max_length"), value.bound("pattern"))
    if words := next((words for known, words in PLAIN.items() if kind is known), ""):
        return words
    if get_origin(kind) in (Union, UnionType):
        return " or ".join(plain(part, value.said).words for part in get_args(kind))
    if get_origin(kind) is Literal:
        choices = [str(choice) for choice in get_args(kind)]
        return f"one of {', '.join(choices)}" if len(choices) > 1 else choices[0]
    return _collection(value)


def _collection(value: Taken) -> str:
    if get_origin(value.kind) in LISTS:
        least, most = value.bound("min_length"), value.bound("max_length")
        if least is None:
            return "a list" if most is None else f"a list of at most {most}"
        return f"a list of {'' if least == most else 'at least '}{least}"
    return "an object with keys"


def _text(least: int | None, longest: int | None, pattern: str | None) -> str:
    length = "" if longest is None else f" of {f'{least} to' if least else 'at most'} {longest} characters"
    return f"a text{length}{f' that matches {pattern}' if pattern else ''}"


def _range(low: Any, high: Any) -> str:
    if low is None:
        return "" if high is None else f" of at most {high:g}"
    return f" of at least {_short(low)}" if high is None else f" from {_short(low)} to {_short(high)}"


def _short(number: float) -> str:
    return f"{number:.15g}"
