"""Models of files that users write: they read, refuse, give a JSON Schema and a reference page from the same fields."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from functools import reduce
from operator import getitem
from typing import Annotated, Any, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from ground.fields import Expected, Taken, key_of

LONGEST_SHOWN = 120  # characters of a value in a refusal
SCHEMA_KEY = "$schema"
READS = Expected("1, the version that this program reads")  # of `schema_version`

Place = tuple[str | int, ...]


class FilePart(BaseModel):
    """A file that users write, or a part of it; each field has a description."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False, protected_namespaces=())


class WholeFile(FilePart):
    """A whole file, in which editors find the JSON Schema of its model."""

    schema_file: Annotated[
        str | None,
        Field(alias=SCHEMA_KEY, description="file or address of this file's JSON Schema, for editors alone"),
    ] = None


class Fault(NamedTuple):
    """What is wrong at a place of a file.

    Parameters
    ----------
    place : keys and numbers that lead there
    words : what was found and is expected, to stand after the place
    is_told : whether the words name the key themselves, as those of a check of our own do
    is_unknown : whether it is a key that means nothing
    """

    place: Place
    words: str
    is_told: bool = False
    is_unknown: bool = False

    def __str__(self) -> str:
        where = ".".join(map(str, self.place))
        if self.is_told:
            return f"{where}: {self.words}" if where else self.words
        return f"{where or 'the file'} {self.words}"


def faults_of(error: ValidationError, model: type[BaseModel], content: Any = None) -> list[Fault]:
    """Say everything that is wrong with the content of a file, in our sentences.

    Parameters
    ----------
    error : of the model's validation
    model : of the whole file
    content : of the file, where a fault in a value may be told of the whole value (`Expected.is_whole`)
    """
    faults = [_fault(detail, model, content) for detail in error.errors(include_url=False)]
    return list({(fault.place, fault.words): fault for fault in faults}.values())


def first_fault(error: OSError | ValueError, model: type[BaseModel]) -> str:
    """Say what is wrong first with a file that cannot be read as a model."""
    return str(faults_of(error, model)[0] if isinstance(error, ValidationError) else error)


def schema_name(name: str) -> str:
    """Return the file in which a file of a kind expects its JSON Schema; `reconstudy schema NAME` prints it."""
    return f"{name}.schema.json"


def without(content: Any, places: Sequence[Place]) -> Any:
    """Return the content of a file without the keys at some places."""
    content = deepcopy(content)
    for place in places:
        part = content
        for key in place[:-1]:
            part = part[key]
        del part[place[-1]]
    return content


def _fault(detail: Any, model: type[BaseModel], content: Any) -> Fault:
    place, kind = tuple(key for key in detail["loc"] if key != "[key]"), detail["type"]
    if kind == "extra_forbidden":
        holder = _at(model, place[:-1])
        known = ", ".join(key_of(*field) for field in holder.kind.model_fields.items() if field[1].alias != SCHEMA_KEY)
        return Fault(place, f"is unknown, expected one of {known}", is_unknown=True)
    if kind == "value_error":  # of a check of our own, which says it all
        return Fault(place, str(detail["ctx"]["error"]), is_told=True)
    for n in range(1, len(place)):
        if _at(model, place[:n]).is_whole:
            place, detail = place[:n], {"type": "whole", "input": reduce(getitem, place[:n], content)}
            break
    return Fault(place, fault_in_words(detail, _at(model, place).words))


def fault_in_words(detail: Mapping[str, Any], expected: str) -> str:
    """Say what a validation found at a place, and what is expected there."""
    if detail["type"] == "missing":
        return "is missing"
    if detail["type"] == "json_invalid":
        return f"is no JSON ({detail['ctx']['error']})"
    return f"is {shown(detail['input'])}, expected {expected}"


def _at(model: type[BaseModel], place: Place) -> Taken:
    """Return what may stand at a place, or around it as far as that is known."""
    value = Taken(model)
    for key in place:
        value = value.inner(key) or value
    return value


def shown(value: Any) -> str:
    """Return a value as a refusal shows it."""
    text = repr(value)
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}…"
