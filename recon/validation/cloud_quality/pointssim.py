"""PointSSIM: how similar the local dispersion of distances, normals, curvatures and colours is in two clouds.

Every point has a neighbourhood of its nearest points. The dispersion of a quantity over it is the point's feature. The
features of associated points, each of one cloud and its nearest of the other, are compared.

Source
------
E. Alexiou, T. Ebrahimi, "Towards a Point Cloud Structural Similarity Metric", ICMEW 2020, and its authors'
scripts: quantities, their variance as the dispersion, relative difference, and its mean, as both recommend.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from recon.validation.cloud_quality.colour import BT709
from recon.validation.cloud_quality.compared import Pair, Prepared, Value, both_ways
from recon.validation.cloud_quality.neighbours import CHUNK, lowest_first
from recon.validation.cloud_quality.quadric import fit_quadrics

TINY = float(np.finfo(np.float64).eps)  # keeps the similarity of two zeros defined
NEIGHBOURS = 12  # points of a neighbourhood, its own point included, as the paper recommends and its scripts have


@dataclass(frozen=True, eq=False)
class Structure:
    """A cloud's neighbourhoods, K = `NEIGHBOURS` places each, and what is known at each of its M places.

    Parameters
    ----------
    prepared : the cloud; a ValueError says that it has fewer places than a neighbourhood
    """

    prepared: Prepared

    def __post_init__(self) -> None:
        if len(self) < NEIGHBOURS:
            raise ValueError(
                f"{self.prepared.cloud.name}: has points at {len(self)} places, expected at least the "
                f"{NEIGHBOURS} of a neighbourhood"
            )

    def __len__(self) -> int:
        return len(self.prepared.places.points)

    @cached_property
    def neighbourhoods(self) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
        """Rows int32 (M, K) of the nearest places, the place itself first, and their distances float64 (M, K)."""
        points = self.prepared.places.points
        return lowest_first(points, points, self.prepared.tree, NEIGHBOURS)

    @cached_property
    def fits(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Estimated normals float64 (M, 3) and curvatures float64 (M,), one over the unit of length."""
        return fit_quadrics(self.prepared.places.points, self.neighbourhoods[0])

    @cached_property
    def file_normals(self) -> NDArray[np.float64]:
        """The file's normals float64 (M, 3); a ValueError says that there are none."""
        if self.prepared.cloud.normals is None:
            raise ValueError(f"{self.prepared.cloud.name}: has no normals (nx, ny, nz other than 0)")
        return self.prepared.places.first(self.prepared.cloud.normals).astype(np.float64)

    @cached_property
    def luma(self) -> NDArray[np.float64]:
        """Rounded luma of BT.709 float64 (M,), 0 to 255; a ValueError says that there are no colours."""
        if self.prepared.cloud.colours is None:
            raise ValueError(f"{self.prepared.cloud.name}: has no colours (red, green, blue of 8 bits)")
        red, green, blue = np.floor(self.prepared.places.mean(self.prepared.cloud.colours) + 0.5).T
        weighted = BT709[0, 0] * red + BT709[0, 1] * green + BT709[0, 2] * blue  # in this order: exact halves round off
        return np.asarray(np.floor(weighted + 0.5))

    def features(self, measure: str) -> NDArray[np.float64]:
        """Compute the variance of a quantity, one of `QUANTITIES`, over each neighbourhood, float64 (M,)."""
        quantity = QUANTITIES[measure]
        chunks = (slice(first, first + CHUNK) for first in range(0, len(self), CHUNK))
        return np.concatenate([quantity(self, chunk).var(axis=1, ddof=1) for chunk in chunks])


def _distances(structure: Structure, chunk: slice) -> NDArray[np.float64]:
    """Return the distances to the neighbours (C, K - 1)."""
    return structure.neighbourhoods[1][chunk, 1:]


def _similar_normals(normals: NDArray[np.float64], structure: Structure, chunk: slice) -> NDArray[np.float64]:
    """Return the similarities to the neighbours' normals (C, K - 1), from 0 at a right angle to 1."""
    rows = structure.neighbourhoods[0][chunk, 1:]
    lengths = np.linalg.norm(normals, axis=1)
    cosines = np.einsum("cki,ci->ck", normals[rows], normals[chunk]) / (lengths[rows] * lengths[chunk, None])
    return np.asarray(1 - 2 * np.arccos(np.minimum(np.abs(cosines), 1)) / np.pi)


def _curvatures(structure: Structure, chunk: slice) -> NDArray[np.float64]:
    """Return the curvatures (C, K) at the place and its neighbours."""
    return structure.fits[1][structure.neighbourhoods[0][chunk]]


def _luma(structure: Structure, chunk: slice) -> NDArray[np.float64]:
    """Return the luma (C, K) at the place and its neighbours."""
    return structure.luma[structure.neighbourhoods[0][chunk]]


QUANTITIES: dict[str, Callable[[Structure, slice], NDArray[np.float64]]] = {  # section 3.1, by the measure's name
    "pointssim_geometry": _distances,
    "pointssim_normals": lambda structure, chunk: _similar_normals(structure.fits[0], structure, chunk),
    "pointssim_curvature": _curvatures,
    "pointssim_colour": _luma,
    "pointssim_normals_from_files": lambda structure, chunk: _similar_normals(structure.file_normals, structure, chunk),
}


def pointssim(measure: str, pair: Pair) -> list[Value]:
    """Measure how similar two clouds are in one quantity: 1 is best.

    Parameters
    ----------
    measure : one of `QUANTITIES`
    pair : the clouds

    Convention
    ----------
    Points at one place are one point, with their mean colour, rounded. Symmetric is the smaller value of both
    directions. Scores of features that can be negative, such as mean curvatures, can be negative.

    Raises
    ------
    ValueError
        If a cloud lacks what is compared, or has fewer points than a neighbourhood.

    Source
    ------
    Alexiou and Ebrahimi (2020): relative difference of features, pooled over the points.
    """
    features, others = (_structure(cloud).features(measure) for cloud in (pair.reference, pair.distorted))
    to_distorted = similarity(features, others[pair.first_in_distorted])
    to_reference = similarity(features[pair.first_in_reference], others)
    if np.isnan(to_distorted).all() or np.isnan(to_reference).all():
        raise ValueError(f"{pair.name}: no two neighbourhoods have a {measure} to compare; are all points on a line?")
    means = float(np.nanmean(to_distorted)), float(np.nanmean(to_reference))
    return both_ways(measure, *means, unit="", better="higher")


@lru_cache(maxsize=2)  # the reference, which several clouds are compared with, and the last of these
def _structure(prepared: Prepared) -> Structure:
    return Structure(prepared)


def similarity(features: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the similarity of features (N,) of associated points, float64 (N,): 1 where they are equal."""
    with np.errstate(invalid="ignore"):  # a relative dispersion about 0 is infinite, and compares with nothing
        return np.asarray(1 - np.abs(features - others) / (np.maximum(np.abs(features), np.abs(others)) + TINY))
