"""Approaches: a depth method, a fusion method and where colours come from. A study compares them on the same scenes."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product

DEPTH_METHODS = ("id", "dr", "pm")  # Table 1; the default of a reconstruction
FUSION_METHODS = ("fa", "fb")  # Table 1
VERTICES, PHOTOGRAPHS = "vertices", "photographs"
COLOURS = (VERTICES, PHOTOGRAPHS)  # of the clouds' points, as in the paper, or at the photographs' resolution
METHOD_NAME = re.compile(r"[a-z0-9][a-z0-9-]{0,49}")  # safe in names of files; no underscore, which parts methods


@dataclass(frozen=True, order=True)
class Approach:
    """One way from pictures to a model, by methods of any name; a ValueError if a name has not the form of one."""

    depth: str
    fusion: str
    colour: str = VERTICES

    def __post_init__(self) -> None:
        check_method_name(self.depth)
        check_method_name(self.fusion)
        check_colours((self.colour,))

    def __str__(self) -> str:
        return "_".join((self.depth, self.fusion, *([] if self.colour == VERTICES else [self.colour])))

    @property
    def levels(self) -> dict[str, str]:
        """The level of each factor of the paper, by the names in a manifest and in the factor analysis."""
        return {"depth": self.depth, "fusion": self.fusion}


def check_method_name(name: str) -> None:
    """Raise a ValueError if a method cannot be called this."""
    if not METHOD_NAME.fullmatch(name):
        raise ValueError(f"{name!r} is no name of a method; expected up to 50 of a-z, 0-9 and -, for example dr-sigma8")
    if name == "all":
        raise ValueError("'all' is what results call everything together; choose another name")


def check_colours(names: Sequence[str]) -> None:
    """Raise a ValueError if there are no such sources of colours, or none at all."""
    if not names:
        raise ValueError(f"no colours were chosen, expected some of {', '.join(COLOURS)}")
    for name in names:
        if name not in COLOURS:
            raise ValueError(f"unknown colour {name!r}, expected one of {', '.join(COLOURS)}")


def approaches(
    depths: Iterable[str], fusions: Iterable[str], colours: Iterable[str] = (VERTICES,)
) -> tuple[Approach, ...]:
    """Combine every depth method with every fusion method and every source of colours, in the order given.

    Parameters
    ----------
    depths, fusions : names of methods
    colours : of `COLOURS`
    """
    return tuple(Approach(*parts) for parts in product(depths, fusions, colours))


def parse_approach(name: str) -> Approach:
    """Read an approach from DEPTH_FUSION or DEPTH_FUSION_photographs, or raise a ValueError if it has another form."""
    depth, separator, fusion = name.partition("_")
    if not separator:
        raise ValueError(f"{name!r} is not an approach, expected DEPTH_FUSION, for example pm_fb")
    plain = fusion.removesuffix(f"_{PHOTOGRAPHS}")
    return Approach(depth, plain, VERTICES if plain == fusion else PHOTOGRAPHS)


def levels_of(names: Iterable[str]) -> dict[str, dict[str, str]]:
    """Return the level of each factor for approaches that are compared; `colour` is one where they differ in it."""
    parsed = {name: parse_approach(name) for name in names}
    has_colour = len({approach.colour for approach in parsed.values()}) > 1
    return {
        name: approach.levels | ({"colour": approach.colour} if has_colour else {}) for name, approach in parsed.items()
    }
