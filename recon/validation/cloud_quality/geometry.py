"""Distances between clouds: D1, D2 and their largest values as MPEG's pc_error computes them, Chamfer and F-score.

Source
------
D. Tian, H. Ochimizu, C. Feng, R. Cohen, A. Vetro, "Geometric distortion metrics for point cloud compression", ICIP
2017: the point-to-point (D1) and the point-to-plane (D2) error. Rules that it does not state, such as the 3 in the
PSNR, are those of MPEG's program pc_error (mpeg-pcc-dmetric 0.14.1).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from recon.geometry.normals import vector_sums
from recon.render.encoding.quality import psnr_db
from recon.validation.cloud_quality.compared import Pair, Prepared, Value, both_ways
from recon.validation.cloud_quality.neighbours import NearestGroups
from recon.validation.truth.evaluation import compared

COINCIDENT = 1e-10  # squared unit of length; nearer neighbours do not count for the peak (pc_error)
THRESHOLD_SHARE = 0.01  # of the longest side: Tatarchenko et al., "What do single-view 3D networks learn?" (2019), 5.2


def intrinsic_peak(reference: Prepared) -> float | None:
    """Return the largest distance of a place to its nearest neighbour; None if there are not two places apart.

    It is the peak that pc_error takes if none is given. It depends on how the reference was sampled.
    """
    points = reference.places.points
    if len(points) < 2:
        return None
    near = np.asarray(reference.tree.query(points.astype(np.float64), [2], workers=-1)[1])[:, 0]
    squared = np.square((points - points[near]).astype(np.float64)).sum(axis=1)
    squared = squared[squared > COINCIDENT]
    return float(np.sqrt(squared.max())) if len(squared) else None


def d1(pair: Pair, peak: float | None, unit: str) -> list[Value]:
    """Measure the squared distance from point to point: its mean (D1), PSNR and maximum.

    Parameters
    ----------
    pair : the clouds
    peak : in the unit of length; None to leave out the PSNR
    unit : of length

    Convention
    ----------
    Duplicates are merged first. The symmetric mse is the larger, the symmetric PSNR the smaller of both directions. The
    PSNR is 10 log10(3 p^2 / mse), with a 3 for the three axes. `d1_hausdorff_squared` is the largest squared distance.

    Source
    ------
    Tian et al. (2017), the point-to-point error; the 3 is that of pc_error.
    """
    return _distances("d1", (pair.to_distorted.squared, pair.to_reference.squared), peak, unit)


def d2(pair: Pair, peak: float | None, unit: str) -> list[Value]:
    """Measure the squared distance from point to plane: its mean (D2), PSNR and maximum.

    Parameters
    ----------
    pair : the clouds; the reference must have normals
    peak, unit : as for `d1`

    Convention
    ----------
    As for `d1`. The difference is projected on the normal at the neighbour; of several nearest neighbours, the squares
    are averaged. The distorted cloud's own normals are not used: `derived_normals`.

    Raises
    ------
    ValueError
        If the reference has no normals.

    Source
    ------
    Tian et al. (2017), the point-to-plane error.
    """
    normals = _reference_normals(pair)
    derived = derived_normals(pair, normals)
    real, distorted = pair.reference.places.points, pair.distorted.places.points
    projected = (
        _projected(pair.to_distorted, real, distorted, derived),
        _projected(pair.to_reference, distorted, real, normals),
    )
    return _distances("d2", projected, peak, unit)


def derived_normals(pair: Pair, normals: NDArray[np.float32]) -> NDArray[np.float32]:
    """Derive normals of the distorted places, float32 (M, 3), from those of the reference's places, float32 (N, 3).

    Every place of the reference gives its normal to the nearest distorted place, to all of them if several are exactly
    as near. A distorted place takes the mean of what it was given, not made unit length again; if it was given none,
    the mean of the normals at its own nearest places.
    """
    forward, backward = pair.to_distorted, pair.to_reference
    given, receivers = forward.rows[forward.is_exact], forward.members[forward.is_exact]
    n = len(backward.counts)
    n_given = np.bincount(receivers, minlength=n)
    sums = vector_sums(normals[given], receivers, n)
    takers, sources = backward.rows[backward.is_exact], backward.members[backward.is_exact]
    has_none = n_given[takers] == 0
    sums += vector_sums(normals[sources[has_none]], takers[has_none], n)
    n_given = n_given + np.bincount(takers[has_none], minlength=n)
    return np.asarray(sums / n_given[:, None], np.float32)


def chamfer(pair: Pair, unit: str) -> list[Value]:
    """Measure the mean distance, not squared, to the nearest point; symmetric is the mean of both directions.

    Every point of a cloud counts, those at one place as often as they are there.

    Source
    ------
    Mescheder et al., "Occupancy Networks" (2019), section 4 and supplement 2.2: Chamfer-L1, the mean of accuracy and
    completeness. Others square the distances, or add the directions instead of averaging them.
    """
    summary = compared(*_of_every_point(pair), ())
    to_reference, to_distorted = summary["accuracy"]["mean_mm"], summary["completeness"]["mean_mm"]
    *directed, worse = both_ways("chamfer", to_distorted, to_reference, unit=unit, better="lower")
    return [*directed, Value("chamfer", (to_distorted + to_reference) / 2, unit, "lower", worse.direction)]


def f_score(pair: Pair, threshold: float) -> list[Value]:
    """Measure the share of points nearer than a threshold: precision, recall and, symmetric, their harmonic mean.

    Precision is distorted to reference, recall reference to distorted. Every point counts, as in `chamfer`.

    Parameters
    ----------
    pair : the clouds
    threshold : in the unit of length

    Source
    ------
    Knapitsch et al., "Tanks and Temples" (2017): precision, recall and F-score at a distance.
    """
    score = compared(*_of_every_point(pair), (threshold,))["scores"][0]
    recall, precision, _ = both_ways("f_score", score["recall"], score["precision"], unit="share", better="higher")
    return [recall, precision, Value("f_score", score["f_score"], "share", "higher")]


def _distances(
    name: str, squared: tuple[NDArray[np.float64], NDArray[np.float64]], peak: float | None, unit: str
) -> list[Value]:
    """Return mean, PSNR and maximum of squared distances in both directions."""
    means = [float(each.mean()) for each in squared]
    largest = [float(each.max()) for each in squared]
    area = f"{unit}²"
    values = both_ways(f"{name}_mse", means[0], means[1], unit=area, better="lower")
    values += both_ways(f"{name}_hausdorff_squared", largest[0], largest[1], unit=area, better="lower")
    if peak is not None:
        for part, (a, b) in (("psnr_db", means), ("hausdorff_psnr_db", largest)):
            ratios = psnr_db(a, 3 * peak**2), psnr_db(b, 3 * peak**2)
            values += both_ways(f"{name}_{part}", *ratios, unit="dB", better="higher")
    return values


def _projected(
    groups: NearestGroups,
    points: NDArray[np.float32],
    others: NDArray[np.float32],
    normals: NDArray[np.float32],
) -> NDArray[np.float64]:
    """Compute mean squared projections (N,) of points' differences to their neighbours on the neighbours' normals."""
    differences = (points[groups.rows] - others[groups.members]).astype(np.float64)
    return groups.mean(np.square(np.einsum("ij,ij->i", differences, normals[groups.members])))


def _reference_normals(pair: Pair) -> NDArray[np.float32]:
    normals = pair.reference.cloud.normals
    if normals is None:
        raise ValueError(
            f"{pair.reference.cloud.name}: has no normals (nx, ny, nz other than 0), which D2 takes from the reference"
        )
    return pair.reference.places.first(normals)


def _of_every_point(pair: Pair) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return distances of all points of the distorted cloud to the reference, and the other way."""
    return (
        np.repeat(np.sqrt(pair.to_reference.squared), pair.distorted.places.counts),
        np.repeat(np.sqrt(pair.to_distorted.squared), pair.reference.places.counts),
    )
