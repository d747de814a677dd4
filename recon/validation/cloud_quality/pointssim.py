"""PointSSIM: how similar the local dispersion of distances, normals, curvatures and colours is in two clouds.

Every point has a neighbourhood of its nearest points. The dispersion of a quantity over it is the point's feature. The
features of associated points, each of one cloud and its nearest of the other, are compared.

Source
------
E. Alexiou, T. Ebrahimi, "Towards a Point Cloud Structural Similarity Metric", ICMEW 2020, and its authors'
scripts: quantities, estimators of dispersion, relative difference and pooling.
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


def quartile_dispersion(quantities: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (q3 - q1) / (q3 + q1) of quantities (N, K), with quartiles at (i - 0.5) / K, as float64 (N,)."""
    q1, q3 = np.quantile(quantities, (0.25, 0.75), axis=1, method="hazen")
    return np.asarray((q3 - q1) / (q3 + q1))


def _median_deviation(quantities: NDArray[np.float64]) -> NDArray[np.float64]:
    middle = np.median(quantities, axis=1, keepdims=True)
    return np.asarray(np.median(np.abs(quantities - middle), axis=1))


def _mean_deviation(quantities: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.abs(quantities - quantities.mean(axis=1, keepdims=True)).mean(axis=1))


ESTIMATORS: dict[str, Callable[[NDArray[np.float64]], NDArray[np.float64]]] = {  # section 3.2; (N, K) to (N,)
    "STD": lambda q: q.std(axis=1, ddof=1),
    "VAR": lambda q: q.var(axis=1, ddof=1),
    "MeanAD": _mean_deviation,
    "MedianAD": _median_deviation,
    "COV": lambda q: q.std(axis=1, ddof=1) / q.mean(axis=1),
    "QCD": quartile_dispersion,
    "Mean": lambda q: q.mean(axis=1),
}
POOLINGS: dict[str, Callable[[NDArray[np.float64]], float]] = {  # NaN are similarities of points without a feature
    "Mean": lambda s: float(np.nanmean(s)),
    "MSE": lambda s: float(np.nanmean(s**2)),
    "RMSE": lambda s: float(np.sqrt(np.nanmean(s**2))),
}


@dataclass(frozen=True)
class PointSsimParameters:
    """Which variant of PointSSIM; the defaults are those that the paper recommends and its scripts have.

    Parameters
    ----------
    estimator : of dispersion, one of `ESTIMATORS`
    pooling : of similarities, one of `POOLINGS`
    neighbours : number of points of a neighbourhood, its own point included; 6 at least for normals and curvatures

    Raises
    ------
    ValueError
        If there is no such estimator or pooling, or there are too few neighbours.
    """

    estimator: str = "VAR"
    pooling: str = "Mean"
    neighbours: int = 12

    def __post_init__(self) -> None:
        for kind, name, known in (("estimator", self.estimator, ESTIMATORS), ("pooling", self.pooling, POOLINGS)):
            if name not in known:
                raise ValueError(f"unknown {kind} {name!r}, expected one of {', '.join(known)}")
        if self.neighbours < 3:
            raise ValueError(f"{self.neighbours} neighbours have no dispersion, expected 3 at least")


@dataclass(frozen=True, eq=False)
class Structure:
    """A cloud's neighbourhoods, K places each, and what is known at each of its M places.

    Parameters
    ----------
    prepared : the cloud; a ValueError says that it has fewer places than a neighbourhood
    neighbours : K
    """

    prepared: Prepared
    neighbours: int

    def __post_init__(self) -> None:
        if len(self) < self.neighbours:
            raise ValueError(
                f"{self.prepared.cloud.name}: has points at {len(self)} places, expected at least the "
                f"{self.neighbours} of a neighbourhood"
            )

    def __len__(self) -> int:
        return len(self.prepared.places.points)

    @cached_property
    def neighbourhoods(self) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
        """Rows int32 (M, K) of the nearest places, the place itself first, and their distances float64 (M, K)."""
        points = self.prepared.places.points
        return lowest_first(points, points, self.prepared.tree, self.neighbours)

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

    def features(self, measure: str, estimator: str) -> NDArray[np.float64]:
        """Compute the dispersion of a quantity over each neighbourhood, float64 (M,).

        Parameters
        ----------
        measure : one of `QUANTITIES`
        estimator : one of `ESTIMATORS`
        """
        quantity, estimate = QUANTITIES[measure], ESTIMATORS[estimator]
        chunks = (slice(first, first + CHUNK) for first in range(0, len(self), CHUNK))
        with np.errstate(divide="ignore", invalid="ignore"):  # relative dispersion about 0 does not exist
            return np.concatenate([estimate(quantity(self, chunk)) for chunk in chunks])


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


def pointssim(measure: str, pair: Pair, parameters: PointSsimParameters = PointSsimParameters()) -> list[Value]:
    """Measure how similar two clouds are in one quantity: 1 is best.

    Parameters
    ----------
    measure : one of `QUANTITIES`
    pair : the clouds
    parameters : the variant

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
    real, distorted = (_structure(cloud, parameters.neighbours) for cloud in (pair.reference, pair.distorted))
    features, others = (each.features(measure, parameters.estimator) for each in (real, distorted))
    to_distorted = similarity(features, others[pair.first_in_distorted])
    to_reference = similarity(features[pair.first_in_reference], others)
    if np.isnan(to_distorted).all() or np.isnan(to_reference).all():
        raise ValueError(f"{pair.name}: no two neighbourhoods have a {measure} to compare; are all points on a line?")
    pool = POOLINGS[parameters.pooling]
    return both_ways(measure, pool(to_distorted), pool(to_reference), unit="", better="higher")


@lru_cache(maxsize=2)  # the reference, which several clouds are compared with, and the last of these
def _structure(prepared: Prepared, neighbours: int) -> Structure:
    return Structure(prepared, neighbours)


def similarity(features: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the similarity of features (N,) of associated points, float64 (N,): 1 where they are equal."""
    with np.errstate(invalid="ignore"):  # a relative dispersion about 0 is infinite, and compares with nothing
        return np.asarray(1 - np.abs(features - others) / (np.maximum(np.abs(features), np.abs(others)) + TINY))
