"""The exclusion rule: which reconstructions of a ball are spoilt by clusters of wrong depth.

A cluster that pulls a fit shows when its part of the surface is left out: the centre moves. One that is too far off to
pull the fit shows in the median error of its part, where noise would average out. A cap whose depth is wrong as a whole
shows neither; only the other sensors' centres can tell. The limits were set on simulated caps, with other seeds than
those of the shares that `bench/validation.py` reports. Every reconstruction is judged by itself and the others of its
ball, so that a verdict does not depend on how many balls are measured; what most of a sensor's share is said of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from recon.validation.sphere.cells import N_SECTORS, Cap
from recon.validation.sphere.fit.model import SphereFit
from recon.validation.sphere.fit.refinement import moved_centre

MAX_SECTOR_SHIFT = 1.0  # mm for a radius of 150 mm, the centre's shift when one of eight sectors is left out
MAX_RING_SHIFT = 2.5  # mm likewise, for the inner or outer half of the cap; slices of whole disparities reach 2.4
MAX_SENSOR_SHIFT = 3.5  # mm likewise, from the other sensors' centres; a calibration shifts them by up to 2.6
REFERENCE_RADIUS = 150.0
COHERENT_CELLS = 4  # a sixth of the 24 cells
MAX_COHERENT_ERROR = 2.2  # mm likewise, median error of that many cells; below 1.8 for 95 % of good caps
SECTOR_SCALE, RING_SCALE, COHERENT_SCALE = 0.3, 0.7, 0.7  # of the points' scatter, which values must exceed as well
MIN_SAMPLES = 4  # of a sensor, to know its constant offset
MOST = 0.5  # of a sensor's reconstructions; more that are left out speak against the sensor
REMARKED = 0.6  # of a limit; values beyond get a remark
MAX_MISSING = 0.05  # of a ball's picture; nothing is missing of the studio's matt ball
PART_WORDS = {  # by field of `Parts`
    "sector_shift": "without its worst sector the centre moves by {:.2f} mm",
    "ring_shift": "without its inner or outer half the centre moves by {:.2f} mm",
    "coherent_error": "a sixth of its surface is off together by {:.2f} mm or more",
}
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
    is_remark : whether it is no reason to leave the reconstruction out, because it is only near the limit
    """

    sentence: str
    is_remark: bool = False


def examine_parts(cap: Cap, fit: SphereFit) -> Parts:
    """Leave out the parts of a cap in turn, and compare their errors."""
    sector, is_outer = cap.sector, cap.places[:, 2] < np.median(cap.places[:, 2])
    reference = moved_centre(cap.points, fit)
    sectors = [moved_centre(cap.points[sector != k], fit) for k in range(N_SECTORS)]
    rings = [moved_centre(cap.points[is_outer], fit), moved_centre(cap.points[~is_outer], fit)]
    medians = cap.medians()
    sizes = np.sort(np.abs(medians[np.isfinite(medians)]))
    return Parts(
        max(float(np.linalg.norm(centre - reference)) for centre in sectors),
        max(float(np.linalg.norm(centre - reference)) for centre in rings),
        float(sizes[-COHERENT_CELLS]) if len(sizes) >= COHERENT_CELLS else 0.0,
    )


def findings(
    fits: Mapping[str, SphereFit],
    parts: Mapping[str, Parts],
    offsets: Mapping[str, NDArray[np.float64]] | None = None,
) -> dict[str, list[Finding]]:
    """Return what exceeds its limit, or nearly so, in each sensor's reconstruction of one placed ball.

    Parameters
    ----------
    fits : by sensor
    parts : by sensor, from `examine_parts`
    offsets : float64 (3,), mm, by sensor, from `sensor_offsets`: the calibration's part of its distance to the others
    """
    by_sensor: dict[str, list[Finding]] = {sensor: [] for sensor in fits}
    for sensor, shifts in parts.items():
        by_sensor[sensor] += _findings_in_parts(fits[sensor], shifts)
    for sensor, finding in _findings_between(fits, offsets or {}):
        by_sensor[sensor].append(finding)
    return by_sensor


def part_limits(fit: SphereFit) -> dict[str, float]:
    """Return the limit of each field of a fit's `Parts`, mm."""
    unit = fit.radius / REFERENCE_RADIUS
    limits = {
        "sector_shift": (MAX_SECTOR_SHIFT, SECTOR_SCALE),
        "ring_shift": (MAX_RING_SHIFT, RING_SCALE),
        "coherent_error": (MAX_COHERENT_ERROR, COHERENT_SCALE),
    }
    return {name: max(limit * unit, share * fit.scale) for name, (limit, share) in limits.items()}


def _findings_in_parts(fit: SphereFit, shifts: Parts) -> Iterator[Finding]:
    if fit.surface_share < MIN_SURFACE_SHARE:
        share = f"only {fit.surface_share:.0%} of the points around the ball lie on it"
        yield Finding(f"{share}, under {MIN_SURFACE_SHARE:.0%}")
    for name, limit in part_limits(fit).items():
        value = getattr(shifts, name)
        if value > REMARKED * limit:
            yield _beyond(PART_WORDS[name].format(value), value, limit)


def _findings_between(
    fits: Mapping[str, SphereFit], offsets: Mapping[str, NDArray[np.float64]]
) -> Iterator[tuple[str, Finding]]:
    """Yield sensors whose centres are far from the others'."""
    centres = {sensor: fit.centre for sensor, fit in fits.items()}
    residual = sensor_shifts({sensor: centre - offsets.get(sensor, 0.0) for sensor, centre in centres.items()})
    for sensor, apart in sensor_shifts(centres).items():
        limit = MAX_SENSOR_SHIFT * fits[sensor].radius / REFERENCE_RADIUS
        if max(apart, residual[sensor]) > REMARKED * limit:
            finding = _beyond(f"its centre is {apart:.2f} mm from that of the other sensors", apart, limit)
            beside = f"; {residual[sensor]:.2f} mm without what is the same in most samples, its calibration"
            yield sensor, replace(finding, sentence=finding.sentence + (beside if offsets else ""))


def _beyond(words: str, value: float, limit: float) -> Finding:
    if value <= limit:
        return Finding(f"{words}, near the limit of {limit:.3g} mm", is_remark=True)
    return Finding(f"{words}, over {limit:.3g} mm")


def sensor_remarks(left_out: Mapping[str, Sequence[bool]]) -> list[str]:
    """Say of which sensors most reconstructions are left out: that is no matter of single clusters of wrong depth.

    Parameters
    ----------
    left_out : by sensor, of each of its reconstructions
    """
    return [
        f"{sum(each)} of {len(each)} reconstructions by {sensor} are left out: its calibration or resolution does not "
        "keep the limits of a sound sensor; the rows `all` have its points"
        for sensor, each in left_out.items()
        if len(each) > 1 and sum(each) > MOST * len(each)
    ]


def missing_remark(missing: float | None) -> list[Finding]:
    """Return a remark on a reconstruction without points in a share of the ball's picture, None where that is unknown.

    Missing points pull no fit, so they are no reason to leave the others out; but the ratios say nothing about, for
    example, a highlight that was left out.
    """
    if missing is None or missing <= MAX_MISSING:
        return []
    sentence = f"in {missing:.0%} of the ball's picture there are no points, over {MAX_MISSING:.0%}"
    return [Finding(f"{sentence}: ratios say nothing about it", is_remark=True)]


def sensor_offsets(samples: Sequence[Mapping[str, NDArray[np.float64]]]) -> dict[str, NDArray[np.float64]]:
    """Return where each sensor sees the balls, (3,), mm from the middle of all sensors: the median over the samples.

    That is calibration, no cluster of wrong depth. None is known of a sensor with fewer than four samples.

    Parameters
    ----------
    samples : centres (3,), mm, by sensor, for each placed ball
    """
    apart: dict[str, list[NDArray[np.float64]]] = {}
    for centres in samples:
        if len(centres) > 1:
            middle = np.median(np.stack(list(centres.values())), axis=0)
            for sensor, centre in centres.items():
                apart.setdefault(sensor, []).append(centre - middle)
    return {sensor: np.median(shifts, axis=0) for sensor, shifts in apart.items() if len(shifts) >= MIN_SAMPLES}


def sensor_shifts(centres_by_sensor: Mapping[str, NDArray[np.float64]]) -> dict[str, float]:
    """Return how far each centre (3,), mm, is from those of the others, mm: the mean distance to the nearer half.

    With two sensors nobody can say which is wrong: both get the distance between them. With one there is none.
    """
    if len(centres_by_sensor) < 2:
        return {}
    centres = np.stack(list(centres_by_sensor.values()))
    apart = np.linalg.norm(centres[:, None] - centres, axis=2)
    if len(centres) == 2:
        return dict.fromkeys(centres_by_sensor, float(apart[0, 1]))
    others = np.sort(apart, axis=1)[:, 1 : 1 + len(centres) // 2]  # the nearer half of the others
    return dict(zip(centres_by_sensor, map(float, others.mean(axis=1)), strict=True))
