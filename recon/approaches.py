"""Approaches: a depth method with a fusion method each. A study compares approaches on the same scenes."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

DEPTH_METHODS = ("id", "dr", "pm")  # Table 1; the default of a reconstruction
FUSION_METHODS = ("fa", "fb")  # Table 1
METHOD_NAME = re.compile(r"[a-z0-9][a-z0-9-]{0,49}")  # safe in names of files; no underscore, which parts methods


@dataclass(frozen=True, order=True)
class Approach:
    """One way from pictures to a model, by methods of any name; a ValueError if a name has not the form of one."""

    depth: str
    fusion: str

    def __post_init__(self) -> None:
        check_method_name(self.depth)
        check_method_name(self.fusion)

    def __str__(self) -> str:
        return f"{self.depth}_{self.fusion}"

    @property
    def levels(self) -> dict[str, str]:
        """The level of each factor, by the names in a manifest and in the factor analysis."""
        return {"depth": self.depth, "fusion": self.fusion}


def check_method_name(name: str) -> None:
    """Raise a ValueError if a method cannot be called this."""
    if not METHOD_NAME.fullmatch(name):
        raise ValueError(f"{name!r} is no name of a method; expected up to 50 of a-z, 0-9 and -, for example dr-sigma8")


def approaches(depths: Iterable[str], fusions: Iterable[str]) -> tuple[Approach, ...]:
    """Combine every depth method with every fusion method, in the order given."""
    fusions = tuple(fusions)
    return tuple(Approach(depth, fusion) for depth in depths for fusion in fusions)


def parse_approach(name: str) -> Approach:
    """Read an approach from DEPTH_FUSION such as "pm_fb", or raise a ValueError if that is not its form."""
    depth, separator, fusion = name.partition("_")
    if not separator:
        raise ValueError(f"{name!r} is not an approach, expected DEPTH_FUSION, for example pm_fb")
    return Approach(depth, fusion)
