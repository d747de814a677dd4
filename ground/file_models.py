"""Models of files that users write: they read, refuse, give a JSON Schema and a reference page from the same fields."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from functools import reduce
from operator import getitem
from typing import Annotated, Any, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from ground.fields import Expected, Taken

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
    faults = (fault_of(detail, detail["loc"], Taken(model), content) for detail in error.errors(include_url=False))
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


def fault_of(detail: Mapping[str, Any], place: Place, within: Taken, content: Any = None) -> Fault:
    """Say what a validation found, in our sentences.

    Parameters
    ----------
    detail : as pydantic or the web framework tells it
    place : that it names, from what was validated
    within : what was validated
    content : of a file, as for `faults_of`
    """
    place, kind = tuple(key for key in place if key != "[key]"), detail["type"]
    if kind == "extra_forbidden":
        known = ", ".join(key for key in within.at(place[:-1]).keys if key != SCHEMA_KEY)
        return Fault(place, f"is unknown, expected one of {known}", is_unknown=True)
    if kind == "value_error":  # of a check of our own, which says it all
        return Fault(place, str(detail["ctx"]["error"]), is_told=True)
    if kind == "missing":
        return Fault(place, "is missing")
    if kind == "json_invalid":
        return Fault(place, f"is no JSON ({detail['ctx']['error']})")
    for n in range(1, len(place)):
        if within.at(place[:n]).is_whole:
            place, detail = place[:n], {"input": reduce(getitem, place[:n], content)}
            break
    return Fault(place, f"is {shown(detail['input'])}, expected {within.at(place).words}")


def shown(value: Any) -> str:
    """Return a value as a refusal shows it; of bytes, which may be anything, only how many they are."""
    if isinstance(value, bytes):
        return f"{len(value)} bytes"
    text = repr(value)
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}…"
