"""The methods that a run can use, by name: ours, and those of a methods file, which adds variants of ours and programs.

A methods file is TOML: tables ``[depth.NAME]`` and ``[fusion.NAME]``. docs/depth.md shows one.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, is_dataclass, replace
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

import numpy as np
from numpy.typing import NDArray

from recon.approaches import check_method_name
from recon.depth import DEFAULTS, MATCHERS, Parameters, StereoPair, matched
from recon.depth.program import Program, match_by_program
from recon.fusion import FUSIONS
from recon.surface import SurfaceParameters

Built = TypeVar("Built")

KINDS: dict[object, tuple[tuple[type, ...], str]] = {
    bool: ((bool,), "true or false"),
    int: ((int,), "a whole number"),
    float: ((int, float), "a number"),
    float | None: ((int, float), "a number"),
    str: ((str,), "a text"),
}


@dataclass(frozen=True)
class DepthMethod:
    """A name in `MATCHERS`, and the parameters that it is run with."""

    method: str
    parameters: Parameters


@dataclass(frozen=True)
class FusionMethod:
    """A name in `FUSIONS`, and what it changes of a run's `SurfaceParameters`."""

    method: str
    changes: Mapping[str, Any] = field(default_factory=dict)


def _depth_methods() -> dict[str, DepthMethod | Program]:
    return {name: DepthMethod(name, DEFAULTS[name]) for name in MATCHERS}


def _fusion_methods() -> dict[str, FusionMethod]:
    return {name: FusionMethod(name) for name in FUSIONS}


@dataclass(frozen=True)
class Methods:
    """Depth and fusion methods by name; those of this program unless others are given."""

    depth: Mapping[str, DepthMethod | Program] = field(default_factory=_depth_methods)
    fusion: Mapping[str, FusionMethod] = field(default_factory=_fusion_methods)

    def check(self, depths: tuple[str, ...], fusions: tuple[str, ...]) -> None:
        """Raise a ValueError if one of these methods is not there."""
        for kind, names, known in (("depth", depths, self.depth), ("fusion", fusions, self.fusion)):
            for name in names:
                if name not in known:
                    raise ValueError(f"unknown {kind} method {name!r}, expected one of {', '.join(known)}")


def match(method: DepthMethod | Program, pair: StereoPair, folder: Path) -> tuple[NDArray[np.float32], list[str]]:
    """Match a pair; returns the disparities of its left image and a sentence for each warning.

    Parameters
    ----------
    method : one of ours, or a program
    pair : to match
    folder : where a program works; what is in it is removed

    Returns
    -------
    disparity : float32 (H, W), pixels, NaN where unmatched or masked out
    warnings : sentences
    """
    if isinstance(method, Program):
        return match_by_program(pair, method, folder), []
    return matched(method.method, pair, method.parameters)


def depth_key(method: DepthMethod | Program) -> dict[str, Any]:
    """Describe a depth method for a key, by what its result depends on."""
    if isinstance(method, Program):
        return {"command": method.command, "output": method.output}
    return asdict(method)


def describe_depth(method: DepthMethod | Program) -> dict[str, Any]:
    """Describe a depth method for people."""
    return depth_key(method) | ({"timeout_s": method.timeout_s} if isinstance(method, Program) else {})


def surface_parameters(method: FusionMethod, run: SurfaceParameters) -> SurfaceParameters:
    """Return the parameters of the surface by a fusion method, in a run with these."""
    return replace(run, **method.changes)


def read_methods(path: Path | None) -> Methods:
    """Read a methods file; its methods come after ours, which are all if there is no file.

    Raises
    ------
    ValueError
        If the file cannot be read, or a name or a value in it cannot be used; it names the table and the key.
    """
    methods = Methods()
    if path is None:
        return methods
    content = _read_toml(path)
    readers: dict[str, tuple[Mapping[str, Any], Callable[..., Any]]] = {
        "depth": (methods.depth, partial(_read_depth, folder=path.resolve().parent)),
        "fusion": (methods.fusion, _read_fusion),
    }
    known: dict[str, dict[str, Any]] = {}
    for kind, (ours, read) in readers.items():
        known[kind] = dict(ours)
        for name, table in _table(content.pop(kind, {}), f"{path}: {kind}").items():
            place = f"{path}: [{kind}.{name}]"
            if name in ours:
                raise ValueError(f"{place}: {name} is a method of this program; choose another name")
            try:
                check_method_name(name)
            except ValueError as error:
                raise ValueError(f"{place}: {error}") from error
            known[kind][name] = read(_table(table, place), place)
    if content:
        raise ValueError(f"{path}: {', '.join(content)} is unknown, expected [depth.NAME] and [fusion.NAME]")
    return Methods(**known)


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise ValueError(f"{path}: there is no such file") from error
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ValueError(f"{path}: is not readable as TOML: {error}") from error


def _table(content: Any, place: str) -> dict[str, Any]:
    if not isinstance(content, dict):
        raise ValueError(f"{place} is {content!r}, expected a table")
    return dict(content)


def _read_depth(table: dict[str, Any], place: str, *, folder: Path) -> DepthMethod | Program:
    if ("method" in table) == ("command" in table):
        raise ValueError(f"{place}: expected either a method of this program or a command")
    if "command" not in table:
        method = _method(table, MATCHERS, place)
        return DepthMethod(method, _built(type(DEFAULTS[method]), table, place))
    if "output" not in table:
        raise ValueError(f"{place}: output is missing, the format of what the command writes")
    return replace(_built(Program, table, place, hidden=("folder",)), folder=str(folder))


def _read_fusion(table: dict[str, Any], place: str) -> FusionMethod:
    method = _method(table, FUSIONS, place)
    parameters = _built(SurfaceParameters, table, place)
    return FusionMethod(method, {name: getattr(parameters, name) for name in table})


def _method(table: dict[str, Any], known: Mapping[str, object], place: str) -> str:
    """Take the method out of a table."""
    method = table.pop("method", None)
    if not isinstance(method, str) or method not in known:
        raise ValueError(f"{place} method is {method!r}, expected one of {', '.join(known)}")
    return method


def _built(kind: type[Built], table: Mapping[str, Any], place: str, hidden: tuple[str, ...] = ()) -> Built:
    """Make an object of a dataclass from a table, each value of the type that the dataclass says."""
    kinds = {name: hint for name, hint in get_type_hints(kind).items() if name not in hidden}
    values = {}
    for name, value in table.items():
        if name not in kinds:
            raise ValueError(f"{place} {name} is unknown, expected {', '.join(kinds)}")
        values[name] = _value(value, kinds[name], f"{place} {name}")
    try:
        return kind(**values)
    except ValueError as error:
        raise ValueError(f"{place} {', '.join(table)}: {error}") from error


def _value(value: Any, kind: Any, place: str) -> Any:
    if is_dataclass(kind) and isinstance(kind, type):
        return _built(kind, _table(value, place), place)
    accepted, description = KINDS[kind]
    if type(value) not in accepted or (isinstance(value, float) and not isfinite(value)):  # a bool is an int, too
        raise ValueError(f"{place} is {value!r}, expected {description}")
    return float(value) if float in accepted else value
