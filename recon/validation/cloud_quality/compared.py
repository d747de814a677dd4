"""Two clouds to be compared, with what several measures need of them, computed once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from recon.validation.cloud_quality.neighbours import NearestGroups, lowest_first, nearest_groups
from recon.validation.cloud_quality.points import Places, PointSet, merged
from recon.validation.sampling import search_tree

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

TO_DISTORTED, TO_REFERENCE, SYMMETRIC = "reference_to_distorted", "distorted_to_reference", "symmetric"


@dataclass(frozen=True)
class Value:
    """What a measure says of two clouds.

    Parameters
    ----------
    measure : its name, in lower case, such as "d1_mse"
    value : may be infinite, as is the PSNR of two equal clouds
    unit : such as "mm", or "" for none
    better : "higher" or "lower"
    direction : which cloud's points were compared with the other: `TO_DISTORTED`, `TO_REFERENCE` or `SYMMETRIC`
    """

    measure: str
    value: float
    unit: str
    better: str
    direction: str = SYMMETRIC


@dataclass(frozen=True, eq=False)
class Prepared:
    """A cloud with its places and their search tree."""

    cloud: PointSet

    @cached_property
    def places(self) -> Places:
        """Where its points lie."""
        return merged(self.cloud.points)

    @cached_property
    def tree(self) -> cKDTree:
        """A search tree of its places."""
        return search_tree(self.places.points)


@dataclass(frozen=True, eq=False)
class Pair:
    """A reference and a distorted cloud.

    Parameters
    ----------
    reference, distorted : the clouds
    name : of the pair, such as "pm_fb 3"
    """

    reference: Prepared
    distorted: Prepared
    name: str = "pair"

    @cached_property
    def to_distorted(self) -> NearestGroups:
        """Nearest places of the distorted cloud to those of the reference."""
        return nearest_groups(self.reference.places.points, self.distorted.places.points, self.distorted.tree)

    @cached_property
    def to_reference(self) -> NearestGroups:
        """Nearest places of the reference to those of the distorted cloud."""
        return nearest_groups(self.distorted.places.points, self.reference.places.points, self.reference.tree)

    @cached_property
    def first_in_distorted(self) -> NDArray[np.int32]:
        """The distorted place, int32 (N,), nearest to each of the reference, of several the first."""
        return lowest_first(self.reference.places.points, self.distorted.places.points, self.distorted.tree, 1)[0][:, 0]

    @cached_property
    def first_in_reference(self) -> NDArray[np.int32]:
        """The place of the reference, int32 (M,), nearest to each distorted one, of several the first."""
        return lowest_first(self.distorted.places.points, self.reference.places.points, self.reference.tree, 1)[0][:, 0]


def both_ways(measure: str, to_distorted: float, to_reference: float, *, unit: str, better: str) -> list[Value]:
    """Return a measure's values in both directions and their worse one as the symmetric value.

    Parameters
    ----------
    measure, unit, better : as in `Value`
    to_distorted, to_reference : values by direction
    """
    worse = max if better == "lower" else min
    return [
        Value(measure, to_distorted, unit, better, TO_DISTORTED),
        Value(measure, to_reference, unit, better, TO_REFERENCE),
        Value(measure, worse(to_distorted, to_reference), unit, better, SYMMETRIC),
    ]
