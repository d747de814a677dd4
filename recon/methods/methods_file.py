"""A methods file: TOML with tables ``[depth.NAME]``, ``[fusion.NAME]``, ``[measure.NAME]`` and ``[film.NAME]``.

This reads the file, and checks its names and the types of its values. What the tables of a kind mean is known where
that kind of method is run: ``read_tables(path, "measure", taken)`` gives those of measures.
"""

from __future__ import annotations

import tomllib
from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from ground.dataclass_models import built
from recon.methods.approaches import check_method_name
from recon.runtime.files import naming
from recon.runtime.programs import Program

Built = TypeVar("Built")
AProgram = TypeVar("AProgram", bound=Program)

METHOD_KINDS = ("depth", "fusion", "measure", "film")


@dataclass(frozen=True)
class Table:
    """What a methods file says about a method.

    Parameters
    ----------
    place : where it stands, for messages: the file and the table's name
    content : of the table
    folder : of the file
    """

    place: str
    content: dict[str, Any]
    folder: Path

    def is_program(self) -> bool:
        """Tell a table with a command from one with a method; a ValueError says that it has both or neither."""
        if ("method" in self.content) == ("command" in self.content):
            keys = " and ".join(self.content) or "nothing"
            raise ValueError(f"{self.place} has {keys}, expected either method, one of this program's, or command")
        return "command" in self.content

    def method(self, known: Collection[str]) -> str:
        """Return the name behind "method", or raise a ValueError if it is not a known one."""
        method = self.content.get("method")
        if not isinstance(method, str) or method not in known:
            raise ValueError(f"{self.place} method is {method!r}, expected one of {', '.join(known)}")
        return method

    def built(self, kind: type[Built], **given: object) -> Built:
        """Make an object of a dataclass from the settings, each of the type that the dataclass says.

        Its fields in `given` are not the table's to say.
        """
        return built(kind, self.settings, self.place, given)

    @property
    def settings(self) -> dict[str, Any]:
        """The entries that set parameters: all but the method."""
        return {name: value for name, value in self.content.items() if name != "method"}

    def part(self, name: str, kind: type[Built]) -> Built | None:
        """Make an object of a dataclass from the table in an entry; None where there is no such entry."""
        if name not in self.content:
            return None
        place = f"{self.place} {name}"
        return built(kind, _table(self.content[name], place), place, {})

    def without(self, name: str) -> Table:
        """Return the table without an entry."""
        return replace(self, content={key: value for key, value in self.content.items() if key != name})

    def changed(self, default: Built) -> Built:
        """Return parameters, an object of a dataclass, with the table's entries instead of what they were."""
        return built(type(default), self.settings, self.place, {}, partial(replace, default))  # type: ignore[type-var]

    def program(self, kind: type[AProgram]) -> AProgram:
        """Return the program that the table says how to call."""
        if "output" not in self.content:
            raise ValueError(f"{self.place}: output is missing, the format of what the command writes")
        return self.built(kind, folder=str(self.folder))


def read_tables(path: Path | None, kind: str, taken: Collection[str]) -> dict[str, Table]:
    """Read the tables of a kind of methods by the methods' names; there are none without a file.

    Parameters
    ----------
    path : of the methods file
    kind : of `METHOD_KINDS`
    taken : names of methods that there are without the file

    Raises
    ------
    ValueError
        If the file cannot be read, holds another kind of table, or the name of a method cannot be used.
    """
    if path is None:
        return {}
    content = _read_toml(path)
    unknown = [name for name in content if name not in METHOD_KINDS]
    if unknown:
        expected = ", ".join(f"[{name}.NAME]" for name in METHOD_KINDS)
        raise ValueError(f"{path}: {', '.join(unknown)} is unknown, expected {expected}")
    tables = {}
    for name, table in _table(content.get(kind, {}), f"{path}: {kind}").items():
        place = f"{path}: [{kind}.{name}]"
        if name in taken:
            raise ValueError(f"{place}: there is a {kind} {name} already; choose another name")
        with naming(place):
            check_method_name(name)
        tables[name] = Table(place, _table(table, place), path.resolve().parent)
    return tables


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError as error:
        raise ValueError(f"{path}: there is no such file") from error
    except (OSError, ValueError) as error:
        raise ValueError(f"{path}: is not readable as TOML: {error}") from error


def _table(content: Any, place: str) -> dict[str, Any]:
    if not isinstance(content, dict):
        raise ValueError(f"{place} is {content!r}, expected a table")
    return dict(content)
