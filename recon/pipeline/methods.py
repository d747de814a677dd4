"""The methods that a run can use, by name: ours, and those of a methods file, which adds variants of ours and programs.

docs/depth.md shows a methods file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.capture.recording import GIVEN
from recon.depth import DEFAULTS, MATCHERS, Parameters, StereoPair, matched
from recon.depth.program import DepthProgram, match_by_program
from recon.fusion import FUSIONS
from recon.methods_file import Table, read_tables
from recon.surface import SurfaceParameters


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


@dataclass(frozen=True)
class GivenDepth:
    """The depth maps of the capture, as they are."""


AnyDepth = DepthMethod | DepthProgram | GivenDepth


def _depth_methods() -> dict[str, AnyDepth]:
    return {**{name: DepthMethod(name, DEFAULTS[name]) for name in MATCHERS}, GIVEN: GivenDepth()}


def _fusion_methods() -> dict[str, FusionMethod]:
    return {name: FusionMethod(name) for name in FUSIONS}


@dataclass(frozen=True)
class Methods:
    """Depth and fusion methods by name; those of this program unless others are given."""

    depth: Mapping[str, AnyDepth] = field(default_factory=_depth_methods)
    fusion: Mapping[str, FusionMethod] = field(default_factory=_fusion_methods)

    def check(self, depths: tuple[str, ...], fusions: tuple[str, ...]) -> None:
        """Raise a ValueError if one of these methods is not there."""
        for kind, names, known in (("depth", depths, self.depth), ("fusion", fusions, self.fusion)):
            for name in names:
                if name not in known:
                    raise ValueError(f"unknown {kind} method {name!r}, expected one of {', '.join(known)}")


def match(method: AnyDepth, pair: StereoPair, folder: Path) -> tuple[NDArray[np.float32], list[str]]:
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

    Raises
    ------
    ValueError
        If the method does not match pairs, or a program fails.
    """
    if isinstance(method, GivenDepth):
        raise ValueError(f"{GIVEN} takes the depth maps of a capture and matches no pairs; choose another method")
    if isinstance(method, DepthProgram):
        return match_by_program(pair, method, folder), []
    return matched(method.method, pair, method.parameters)


def depth_key(method: AnyDepth) -> dict[str, Any]:
    """Describe a depth method for a key, by what its result depends on."""
    if isinstance(method, DepthProgram):
        return {"command": method.command, "output": method.output}
    return asdict(method)


def describe_depth(method: AnyDepth) -> dict[str, Any]:
    """Describe a depth method for people."""
    return depth_key(method) | ({"timeout_s": method.timeout_s} if isinstance(method, DepthProgram) else {})


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
    ours = Methods()
    depth = {name: _depth_method(table) for name, table in read_tables(path, "depth", ours.depth).items()}
    fusion = {name: _fusion_method(table) for name, table in read_tables(path, "fusion", ours.fusion).items()}
    return Methods({**ours.depth, **depth}, {**ours.fusion, **fusion})


def _depth_method(table: Table) -> DepthMethod | DepthProgram:
    if ("method" in table.content) == ("command" in table.content):
        raise ValueError(f"{table.place}: expected either a method of this program or a command")
    if "command" in table.content:
        return table.program(DepthProgram)
    method = table.method(MATCHERS)
    return DepthMethod(method, table.built(type(DEFAULTS[method])))


def _fusion_method(table: Table) -> FusionMethod:
    method = table.method(FUSIONS)
    parameters = table.built(SurfaceParameters)
    return FusionMethod(method, {name: getattr(parameters, name) for name in table.content if name != "method"})
