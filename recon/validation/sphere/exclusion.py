"""Which reconstructions of a ball are spoilt by clusters of wrong depth, by a rule with numbers behind it.

A cluster that pulls a fit betrays itself when the part of the surface that it lies on is left out: the centre moves.
One that is too far off to pull it still leaves a part of the surface off together, where noise would average out. A cap
whose depth is wrong as a whole does not, only the other sensors' centres can tell. The limits were set on simulated
caps with seeds other than those that `bench/validation.py` reports caught and dropped shares of. They are those of a
sound sensor: where most samples of a sensor are beyond one, it is the sensor that is said to be, and only samples that
are much worse than the others are left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.validation.sampling import subsample
from recon.validation.sphere.model import SphereFit, SphereParameters
from recon.validation.sphere.refinement import moved_centre

N_SECTORS = 8
MAX_SECTOR_SHIFT = 1.0  # mm for a radius of 150 mm, the centre's shift when one of eight sectors is left out
MAX_RING_SHIFT = 2.5  # likewise for the inner or outer half of the cap; slices of whole disparities reach 2.4
MAX_SENSOR_SHIFT = 2.5  # likewise from the middle of the sensors' centres
REFERENCE_RADIUS = 150.0
N_RINGS = 3  # with the sectors, cells of equal numbers of points
COHERENT_CELLS = 4  # a sixth of the cells
MAX_COHERENT_ERROR = 2.2  # likewise of that many cells' median errors; of 95 % of good caps it is below 1.8
COHERENT_SCALE = 0.4  # of the points' scatter, beyond which that error must lie as well
MIN_SAMPLES = 4  # of one sensor, from which what is usual for it is known
USUAL_PERCENTILE = (
    25.0  # over a sensor's samples: what even the better ones show; a third of spoilt ones hardly moves it
)
LEAST_USUAL = 0.5  # of a limit; what is usual for a sound sensor lies below, and the limit stands
UNUSUAL = 5.0  # times what is usual, beyond which a sample is worse than its sensor
REMARKED = 0.6  # of a limit, from which on a value is remarked on
MAX_MISSING = 0.05  # of a ball's picture; of the studio's matt ball nothing is missing
MIN_SURFACE_SHARE = 0.55  # of the points around a ball; less and clusters of wrong depth outweigh its surface


@dataclass(frozen=True)
class Parts:
    """What the parts of a cap say about its fit, mm.

    Parameters
    ----------
    sector_shift, ring_shift : how far the centre moves when the worst of eight sectors, or the worse of the inner and
        the outer half, is left out
    coherent_error : by how much the worst sixth of its surface is off together: the fourth largest of the median errors
        of 24 cells
    """

    sector_shift: float
    ring_shift: float
    coherent_error: float


@dataclass(frozen=True)
class Finding:
    """One thing that is beyond its limit, or near it.

    Parameters
    ----------
    sentence : what was found, and the limit
    is_remark : whether it is only near the limit, or most samples of the same sensor are like that; it is then no
        reason to leave this one out
    """

    sentence: str
    is_remark: bool = False


def examine_parts(points: NDArray[np.float32], fit: SphereFit, parameters: SphereParameters | None = None) -> Parts:
    """Leave out parts of a cap (N, 3) in turn, and look at the errors of each."""
    parameters = parameters or SphereParameters()
    sample = subsample(points, parameters.seed)
    near = sample[np.abs(fit.errors(sample)) < 0.25 * fit.radius]
    offsets = (near - fit.centre) / np.linalg.norm(near - fit.centre, axis=1, keepdims=True)
    axis = offsets.mean(axis=0) / np.linalg.norm(offsets.mean(axis=0))
    across = np.linalg.svd(axis[None])[2][1:]
    turn = np.arctan2(offsets @ across[1], offsets @ across[0])
    sector = np.minimum(((turn + np.pi) / (2 * np.pi) * N_SECTORS).astype(int), N_SECTORS - 1)
    polar = offsets @ axis
    is_outer = polar < np.median(polar)
    reference = moved_centre(near, fit, parameters)
    sectors = [moved_centre(near[sector != k], fit, parameters) for k in range(N_SECTORS)]
    rings = [moved_centre(near[is_outer], fit, parameters), moved_centre(near[~is_outer], fit, parameters)]
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
    """What is beyond its limit, or near it, in each sensor's reconstruction of one placed ball; nothing for good ones.

    Parameters
    ----------
    fits, parts : per sensor; `parts` from `examine_parts`
    usual : per sensor, from `usual_parts`; without it whatever is beyond a limit is a reason to leave out
    """
    found: dict[str, list[Finding]] = {sensor: [] for sensor in fits}
    for sensor, own in parts.items():
        fit = fits[sensor]
        unit = fit.radius / REFERENCE_RADIUS
        if fit.surface_share < MIN_SURFACE_SHARE:
            share = f"only {fit.surface_share:.0%} of the points around the ball lie on it"
            found[sensor].append(Finding(f"{share}, under {MIN_SURFACE_SHARE:.0%}"))
        coherent_limit = max(MAX_COHERENT_ERROR * unit, COHERENT_SCALE * fit.scale)
        for name, limit, words in (
            ("sector_shift", MAX_SECTOR_SHIFT * unit, "without its worst sector the centre moves by {:.2f} mm"),
            ("ring_shift", MAX_RING_SHIFT * unit, "without its inner or outer half the centre moves by {:.2f} mm"),
            ("coherent_error", coherent_limit, "a sixth of its surface is off together by {:.2f} mm or more"),
        ):
            value = getattr(own, name)
            if value > REMARKED * limit:
                typical = getattr(usual[sensor], name) if usual and sensor in usual else None
                found[sensor].append(_beyond(words.format(value), value, limit, typical))
    for sensor, apart in sensor_shifts(fits).items():
        limit = MAX_SENSOR_SHIFT * fits[sensor].radius / REFERENCE_RADIUS
        if apart > limit:
            sentence = f"its centre is {apart:.2f} mm from that of the other sensors, over {limit:g} mm"
            found[sensor].append(Finding(sentence))
    return found


def _beyond(words: str, value: float, limit: float, typical: float | None) -> Finding:
    if value <= limit:
        return Finding(f"{words}, near the limit of {limit:.3g} mm", is_remark=True)
    if typical is None or typical < LEAST_USUAL * limit or value > UNUSUAL * typical:
        return Finding(f"{words}, over {limit:.3g} mm")
    sentence = f"{words}, over {limit:.3g} mm, but three in four samples of this sensor reach {typical:.2f} mm"
    return Finding(sentence, is_remark=True)


def missing_remark(missing: float | None) -> list[Finding]:
    """What is said of a reconstruction that has no points in a share of the ball's picture, None where it is unknown.

    Points that are not there pull no fit, so that it is no reason to leave the others out; but nobody should believe
    that the ratios hold where a highlight was left out.
    """
    if missing is None or missing <= MAX_MISSING:
        return []
    sentence = f"in {missing:.0%} of the ball's picture there are no points, over {MAX_MISSING:.0%}"
    return [Finding(f"{sentence}: ratios say nothing about it", is_remark=True)]


def usual_parts(samples: Sequence[Parts]) -> Parts | None:
    """What three in four of one sensor's reconstructions reach, None where there are too few to say what is usual.

    What a sensor does in most of its samples is its calibration or its resolution, no cluster of wrong depth that
    spoils single ones. To leave all of them out would leave nothing to tabulate; it is said instead.
    """
    if len(samples) < MIN_SAMPLES:
        return None
    names = ("sector_shift", "ring_shift", "coherent_error")
    return Parts(
        *(float(np.percentile([getattr(sample, name) for sample in samples], USUAL_PERCENTILE)) for name in names)
    )


def sensor_shifts(fits: Mapping[str, SphereFit]) -> dict[str, float]:
    """Distance of each sensor's centre from the sensors' middle, mm: the one that is nearest to most of them.

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
