"""Approaches: a depth method with a fusion method each. A study compares approaches on the same scenes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

DEPTH_METHODS = ("id", "dr", "pm")  # Table 1; the default of a reconstruction
FUSION_METHODS = ("fa", "fb")  # Table 1


@dataclass(frozen=True, order=True)
class Approach:
    """One way from pictures to a model; a ValueError if a method is not one of the paper's."""

    depth: str
    fusion: str

    def __post_init__(self) -> None:
        if self.depth not in DEPTH_METHODS:
            raise ValueError(f"unknown depth method {self.depth!r}, expected one of {', '.join(DEPTH_METHODS)}")
        if self.fusion not in FUSION_METHODS:
            raise ValueError(f"unknown fusion method {self.fusion!r}, expected one of {', '.join(FUSION_METHODS)}")

    def __str__(self) -> str:
        return f"{self.depth}_{self.fusion}"

    @property
    def levels(self) -> dict[str, str]:
        """The level of each factor, by the names in a manifest and in the factor analysis."""
        return {"depth": self.depth, "fusion": self.fusion}


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
