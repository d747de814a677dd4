"""Models made of frozen dataclasses, so that a file may set parameters which the code keeps in dataclasses.

Types and defaults are those of the fields; what a field means stands in the docstring, in numpy's style.
"""

from __future__ import annotations

import inspect
import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from typing import Annotated, Any, TypeVar, get_type_hints

from pydantic import AfterValidator, ValidationError, create_model
from pydantic import Field as ModelField

from ground.fields import Expected, plain
from ground.file_models import FilePart, faults_of

Built = TypeVar("Built")

SETTABLE = (bool, int, float, str)
TYPE = re.compile(r"(str|bool|int|float|mapping|tuple of \w+|sequence of \w+)(, optional)?")


def built(
    kind: type[Built],
    content: Mapping[str, Any],
    place: str,
    given: Mapping[str, object],
    make: Callable[..., Built] | None = None,
) -> Built:
    """Make an object of a dataclass from a table of a file.

    Parameters
    ----------
    kind : the dataclass
    content : of the table
    place : of the table, for messages
    given : fields that are not the table's to say
    make : what makes the object of the values; None: the dataclass

    Raises
    ------
    ValueError
        Naming the place, what was found and what is expected.
    """
    model = model_of(kind, frozenset(given), is_whole=make is None)
    try:
        checked = model.model_validate(dict(content))
    except ValidationError as error:
        faults = faults_of(error, model)
        fault = next((fault for fault in faults if fault.is_unknown), faults[0])
        if fault.place and fault.words == "is missing":
            raise ValueError(f"{place}: {fault}") from error
        raise ValueError(f"{place} {' '.join(map(str, fault.place))} {fault.words}") from error
    hints = get_type_hints(kind)
    values = {name: _value(getattr(checked, name), hints[name], f"{place} {name}") for name in content}
    try:
        return (make or kind)(**values, **given)
    except ValueError as error:
        raise ValueError(f"{place} {', '.join(content)}: {error}") from error


def model_of(kind: Any, given: frozenset[str] = frozenset(), *, is_whole: bool = True) -> type[FilePart]:
    """Return the model of the table that sets a dataclass.

    Parameters
    ----------
    kind : the dataclass
    given : fields that are not the table's to say
    is_whole : whether the table has to set what has no default; else it changes what there is
    """
    hints, words = get_type_hints(kind), described(kind)
    entries: dict[str, Any] = {
        entry.name: (
            _annotation(hints[entry.name]),
            _field(entry, hints[entry.name], words.get(entry.name, ""), is_required=is_whole),
        )
        for entry in fields(kind)
        if entry.name not in given and not entry.name.startswith("_")
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of names that a model has, too, such as `copy`
        return create_model(kind.__name__, __base__=FilePart, __doc__=kind.__doc__, **entries)


def described(kind: type[Any]) -> dict[str, str]:
    """Return what the docstrings of a dataclass, and of those it derives from, say of each field."""
    return {name: text for each in reversed(kind.__mro__) for name, text in _described(each).items()}


def _described(kind: type[Any]) -> dict[str, str]:
    """Return the entries of a docstring's parameters, `name, name : type` with indented lines or `name : text`."""
    sentences: dict[str, str] = {}
    names: list[str] = []
    for line in (inspect.cleandoc(kind.__doc__ or "")).splitlines():
        match = re.match(r"^([a-z_]+(?:, [a-z_]+)*) : (.*)$", line)
        if match:
            names = match[1].split(", ")
            sentences.update(dict.fromkeys(names, "" if TYPE.fullmatch(match[2]) else match[2]))
        elif names and line.startswith("    "):
            sentences.update({name: f"{sentences[name]} {line.strip()}" for name in names})
        elif not line.startswith(" "):
            names = []
    return {name: " ".join(text.split()) for name, text in sentences.items()}


def _annotation(hint: Any) -> Any:
    if _is_table(hint):
        return model_of(hint)
    return hint if plain(hint).kind in SETTABLE else Annotated[Any, AfterValidator(_unsettable), Expected("")]


def _field(entry: Field[Any], hint: Any, words: str, *, is_required: bool) -> Any:
    if _is_table(hint):
        return ModelField(default_factory=model_of(hint), description=words)
    if entry.default is not MISSING:
        return ModelField(entry.default, description=words)
    return ModelField(... if is_required and entry.default_factory is MISSING else None, description=words)


def _value(value: Any, hint: Any, place: str) -> Any:
    if _is_table(hint):
        return built(hint, value.model_dump(exclude_unset=True), place, {})
    return value


def _is_table(hint: Any) -> bool:
    return is_dataclass(hint) and isinstance(hint, type)


def _unsettable(_: Any) -> Any:
    raise ValueError("cannot be set in a file: it is no number, text, truth or table of these")
