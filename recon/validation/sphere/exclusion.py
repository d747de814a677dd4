"""The exclusion rule: which reconstructions of a ball are spoilt by clusters of wrong depth.

A cluster that pulls a fit shows when its part of the surface is left out: the centre moves. One that is too far off to
pull the fit shows in the median error of its part, where noise would average out. A cap whose depth is wrong as a whole
shows neither; only the other sensors' centres can tell. The limits were set on simulated caps, with other seeds than
those of the shares that `bench/validation.py` reports. They are limits of a sound sensor: where most samples of a
sensor exceed one, the report says so of the sensor, and only samples that are much worse than its others are left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.validation.sampling import subsample
from recon.validation.sphere.model import SphereFit
from recon.validation.sphere.refinement import moved_centre

N_SECTORS = 8
MAX_SECTOR_SHIFT = 1.0  # mm for a radius of 150 mm, the centre's shift when one of eight sectors is left out
MAX_RING_SHIFT = 2.5  # mm likewise, for the inner or outer half of the cap; slices of whole disparities reach 2.4
MAX_SENSOR_SHIFT = 2.5  # mm likewise, from the other sensors' centres
REFERENCE_RADIUS = 150.0
N_RINGS = 3  # with the sectors, cells of equal numbers of points
COHERENT_CELLS = 4  # a sixth of the cells
MAX_COHERENT_ERROR = 2.2  # mm likewise, median error of that many cells; below 1.8 for 95 % of good caps
COHERENT_SCALE = 0.4  # of the points' scatter; the median error must exceed this as well
MIN_SAMPLES = 4  # of a sensor, to know what is usual for it
USUAL_PERCENTILE = 25.0  # of a sensor's samples; spoilt ones hardly move it, even if they are a third
LEAST_USUAL = 0.5  # of a limit; a sensor whose usual value is lower is sound, and the limit holds
UNUSUAL = 5.0  # times the usual value; a sample beyond is worse than its sensor
REMARKED = 0.6  # of a limit; values beyond get a remark
MAX_MISSING = 0.05  # of a ball's picture; nothing is missing of the studio's matt ball
MIN_SURFACE_SHARE = 0.55  # of the points around a ball; with less, clusters of wrong depth outweigh its surface


@dataclass(frozen=True)
class Parts:
    """What the parts of a cap say about its fit.

    Parameters
    ----------
    sector_shift : mm, how far the centre moves without the worst of eight sectors
    ring_shift : mm, how far it moves without the inner or the outer half, whichever is worse
    coherent_error : mm, by how much the worst sixth of the surface is off together: the fourth largest of the median
        errors of 24 cells
    """

    sector_shift: float
    ring_shift: float
    coherent_error: float


@dataclass(frozen=True)
class Finding:
    """A value beyond its limit, or near it.

    Parameters
    ----------
    sentence : with the value and the limit
    is_remark : whether it is no reason to leave the reconstruction out, because it is only near the limit, or usual
        for the sensor
    """

    sentence: str
    is_remark: bool = False


def examine_parts(points: NDArray[np.float32], fit: SphereFit, seed: int = 1) -> Parts:
    """Leave out the parts of a cap in turn, and compare their errors.

    Parameters
    ----------
    points : float32 (N, 3), mm
    fit : their sphere
    seed : of the sample
    """
    sample = subsample(points, seed)
    near = sample[np.abs(fit.errors(sample)) < 0.25 * fit.radius]
    offsets = (near - fit.centre) / np.linalg.norm(near - fit.centre, axis=1, keepdims=True)
    axis = offsets.mean(axis=0) / np.linalg.norm(offsets.mean(axis=0))
    across = np.linalg.svd(axis[None])[2][1:]
    turn = np.arctan2(offsets @ across[1], offsets @ across[0])
    sector = np.minimum(((turn + np.pi) / (2 * np.pi) * N_SECTORS).astype(int), N_SECTORS - 1)
    polar = offsets @ axis
    is_outer = polar < np.median(polar)
    reference = moved_centre(near, fit)
    sectors = [moved_centre(near[sector != k], fit) for k in range(N_SECTORS)]
    rings = [moved_centre(near[is_outer], fit), moved_centre(near[~is_outer], fit)]
    return Parts(
        max(float(np.linalg.norm(centre - reference)) for centre in sectors),
        max(float(np.linalg.norm(centre - reference)) for centre in rings),
        _coherent_error(fit.errors(near), sector, polar),
    )


def _coherent_error(errors: NDArray[np.float32], sector: NDArray[np.int64], polar: NDArray[np.floating]) -> float:
    ring = np.searchsorted(np.quantile(polar, np.arange(1, N_RINGS) / N_RINGS), polar)
    cells = sector * N_RINGS + ring
    medians = [np.median(errors[cells == cell]) for cell in range(N_SECTORS * N_RINGS) if (cells == cell).any()]
    return float(np.sort(np.abs(medians))[-COHERENT_CELLS]) if len(medians) >= COHERENT_CELLS else 0.0


def findings(
    fits: Mapping[str, SphereFit], parts: Mapping[str, Parts], usual: Mapping[str, Parts] | None = None
) -> dict[str, list[Finding]]:
    """Return what exceeds its limit, or nearly so, in each sensor's reconstruction of one placed ball.

    Parameters
    ----------
    fits : by sensor
    parts : by sensor, from `examine_parts`
    usual : by sensor, from `usual_parts`; without it every value beyond a limit is a reason to leave out
    """
    by_sensor: dict[str, list[Finding]] = {sensor: [] for sensor in fits}
    for sensor, shifts in parts.items():
        fit = fits[sensor]
        unit = fit.radius / REFERENCE_RADIUS
        if fit.surface_share < MIN_SURFACE_SHARE:
            share = f"only {fit.surface_share:.0%} of the points around the ball lie on it"
            by_sensor[sensor].append(Finding(f"{share}, under {MIN_SURFACE_SHARE:.0%}"))
        coherent_limit = max(MAX_COHERENT_ERROR * unit, COHERENT_SCALE * fit.scale)
        for name, limit, words in (
            ("sector_shift", MAX_SECTOR_SHIFT * unit, "without its worst sector the centre moves by {:.2f} mm"),
            ("ring_shift", MAX_RING_SHIFT * unit, "without its inner or outer half the centre moves by {:.2f} mm"),
            ("coherent_error", coherent_limit, "a sixth of its surface is off together by {:.2f} mm or more"),
        ):
            value = getattr(shifts, name)
            if value > REMARKED * limit:
                typical = getattr(usual[sensor], name) if usual and sensor in usual else None
                by_sensor[sensor].append(_beyond(words.format(value), value, limit, typical))
    for sensor, apart in sensor_shifts(fits).items():
        limit = MAX_SENSOR_SHIFT * fits[sensor].radius / REFERENCE_RADIUS
        if apart > limit:
            sentence = f"its centre is {apart:.2f} mm from that of the other sensors, over {limit:g} mm"
            by_sensor[sensor].append(Finding(sentence))
    return by_sensor


def _beyond(words: str, value: float, limit: float, typical: float | None) -> Finding:
    if value <= limit:
        return Finding(f"{words}, near the limit of {limit:.3g} mm", is_remark=True)
    if typical is None or typical < LEAST_USUAL * limit or value > UNUSUAL * typical:
        return Finding(f"{words}, over {limit:.3g} mm")
    sentence = f"{words}, over {limit:.3g} mm, but three in four samples of this sensor reach {typical:.2f} mm"
    return Finding(sentence, is_remark=True)


def missing_remark(missing: float | None) -> list[Finding]:
    """Return a remark on a reconstruction without points in a share of the ball's picture, None where that is unknown.

    Missing points pull no fit, so they are no reason to leave the others out; but the ratios say nothing about, for
    example, a highlight that was left out.
    """
    if missing is None or missing <= MAX_MISSING:
        return []
    sentence = f"in {missing:.0%} of the ball's picture there are no points, over {MAX_MISSING:.0%}"
    return [Finding(f"{sentence}: ratios say nothing about it", is_remark=True)]


def usual_parts(samples: Sequence[Parts]) -> Parts | None:
    """Return what three in four of one sensor's reconstructions reach, None where there are too few.

    What most samples of a sensor show comes from its calibration or its resolution, not from clusters of wrong depth,
    which spoil single ones. To leave all of them out would leave nothing to tabulate: they get a remark instead.
    """
    if len(samples) < MIN_SAMPLES:
        return None
    names = ("sector_shift", "ring_shift", "coherent_error")
    return Parts(
        *(float(np.percentile([getattr(sample, name) for sample in samples], USUAL_PERCENTILE)) for name in names)
    )


def sensor_shifts(fits: Mapping[str, SphereFit]) -> dict[str, float]:
    """Return how far each sensor's centre is from those of the others, mm: the mean distance to the nearer half.

    With two sensors nobody can say which is wrong: both get the distance between them. With one there is none.
    """
    if len(fits) < 2:
        return {}
    centres = np.stack([fit.centre for fit in fits.values()])
    apart = np.linalg.norm(centres[:, None] - centres, axis=2)
    if len(fits) == 2:
        return dict.fromkeys(fits, float(apart[0, 1]))
    others = np.sort(apart, axis=1)[:, 1 : 1 + len(fits) // 2]  # the nearer half of the others
    return dict(zip(fits, map(float, others.mean(axis=1)), strict=True))
