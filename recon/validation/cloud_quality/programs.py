"""Measures by programs of others: they get two PLY files, or other files, and print a number.

A methods file declares them as tables ``[measure.NAME]``; docs/measures.md shows PCQM's.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import partial
from math import isnan
from pathlib import Path
from typing import ClassVar
from zlib import crc32

from recon.geometry.ply import FLOAT_NORMAL, UINT8_COLOUR, ply_bytes, vector_columns
from recon.methods.methods_file import Table, read_tables
from recon.runtime.files import write_bytes
from recon.runtime.programs import LOG, Program, ProgramError, workplace
from recon.validation.cloud_quality.compared import Pair, Value
from recon.validation.cloud_quality.measures import MEASURES, Measure, Scale
from recon.validation.cloud_quality.points import PointSet
from recon.validation.measures import BETTER
from recon.validation.page import plain_name

NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


@dataclass(frozen=True)
class MeasureProgram(Program):
    """How to call a program that compares two clouds, or films; its limit of time is for one pair.

    Parameters
    ----------
    pattern : regular expression whose only group is the value in what the program prints; "" for the last number
    unit : of the value, or "" for none
    better : "higher" or "lower"

    Raises
    ------
    ValueError
        If the command or a value cannot be used.
    """

    PLACEHOLDERS: ClassVar[tuple[str, ...]] = ("reference", "distorted")
    OUTPUTS: ClassVar[tuple[str, ...]] = ("text",)

    pattern: str = ""
    unit: str = ""
    better: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.better not in BETTER.values():
            raise ValueError(f"better is {self.better!r}, expected one of {', '.join(BETTER.values())}")
        if missing := [name for name in self.PLACEHOLDERS if not self.asks_for(name)]:
            raise ValueError(f"command is {self.command!r}, which lacks {{{missing[0]}}}")
        try:
            groups = re.compile(self.pattern).groups
        except re.error as error:
            raise ValueError(f"pattern is {self.pattern!r}, which is no regular expression: {error}") from error
        if self.pattern and groups != 1:
            raise ValueError(f"pattern is {self.pattern!r}, with {groups} groups, expected one around the value")

    def measure(self, files: Mapping[str, Path], place: Path) -> float:
        """Run in a place with a file for each placeholder, and return the value; a ProgramError says what failed."""
        self.run({role: str(file) for role, file in files.items()}, place)
        return self.value(
            (place / LOG).read_text(encoding="utf-8", errors="replace").partition("\n")[2]
        )  # after the command

    def value(self, printed: str) -> float:
        """Find the value in what the program printed; a ProgramError says that it is not there."""
        matches = re.findall(self.pattern or NUMBER, printed)
        if not matches:
            wanted = f"matches {self.pattern!r}" if self.pattern else "is a number"
            raise ProgramError(f"the program printed nothing that {wanted}")
        try:
            value = float(matches[-1])
        except ValueError as error:
            raise ProgramError(f"the program printed {matches[-1]!r}, expected a number") from error
        if isnan(value):
            raise ProgramError("the program printed no number as its value: nan")
        return value


def program_measures(path: Path | None, folder: Path) -> dict[str, tuple[Measure, str]]:
    """Read the measures of a methods file by name, each with its source in words.

    Parameters
    ----------
    path : of the methods file; None for none
    folder : where the programs run, each pair in a folder of its own that keeps the log

    Raises
    ------
    ValueError
        If the file cannot be read, or a name or a value in it cannot be used.
    """
    programs = declared_programs(path, "measure", MEASURES)
    return {
        name: (partial(measure_by_program, name, program, folder / name), program.command)
        for name, program in programs.items()
    }


def declared_programs(path: Path | None, kind: str, taken: Collection[str]) -> dict[str, MeasureProgram]:
    """Read the programs of a kind of measure in a methods file.

    Parameters
    ----------
    path, kind, taken : as for `recon.methods.methods_file.read_tables`
    """
    return {name: _program(table) for name, table in read_tables(path, kind, taken).items()}


def measure_by_program(name: str, program: MeasureProgram, folder: Path, pair: Pair, _scale: Scale) -> list[Value]:
    """Compare two clouds by a program.

    It gets binary PLY files with float x, y, z, and, where known, float nx, ny, nz and uchar red, green, blue.

    Parameters
    ----------
    name : of the measure
    program : what to call
    folder : of the programs' folders
    pair : the clouds

    Raises
    ------
    ProgramError
        If the program fails in any way; it names the log.
    """
    place = folder.resolve() / folder_name(pair.name)
    files = {"reference": place / "reference.ply", "distorted": place / "distorted.ply"}
    with workplace(place):
        _write(files["reference"], pair.reference.cloud)
        _write(files["distorted"], pair.distorted.cloud)
        value = program.measure(files, place)
    return [Value(name, value, program.unit, program.better, "")]


def folder_name(name: str) -> str:
    """Return the plain name, with a checksum where it is another one: "a b" shall not share the folder of "a_b"."""
    plain = plain_name(name)
    return plain if plain == name else f"{plain}-{crc32(name.encode(errors='replace')):08x}"


def _program(table: Table) -> MeasureProgram:
    if "command" not in table.content:
        raise ValueError(f"{table.place}: command is missing, the program to call")
    return table.built(MeasureProgram, folder=str(table.folder), output="text")


def _write(path: Path, cloud: PointSet) -> None:
    columns = vector_columns("xyz", cloud.points)
    if cloud.normals is not None:
        columns |= vector_columns(FLOAT_NORMAL, cloud.normals)
    if cloud.colours is not None:
        columns |= vector_columns(UINT8_COLOUR, cloud.colours)
    write_bytes(path, ply_bytes(columns))
