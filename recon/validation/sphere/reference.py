"""Agreement of the fitted centres with those of another instrument, such as a LiDAR.

An instrument measures in its own frame. Then the rigid motion between both sets of centres is estimated first; it takes
six of the three numbers a place has, and whatever is shifted or turned as a whole shows nowhere. Centres in the
sensors' own frame are compared as they are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri  # scipy.stats takes half a second to import

from recon.geometry.rig import rigid, transformed
from recon.validation.clouds import MIN_POINTS, FitError, read_exactly
from recon.validation.registration.super4pcs import rigid_motions
from recon.validation.sampling import subsample
from recon.validation.sphere.cells import cap_of
from recon.validation.sphere.fit.consensus import fit_sphere
from recon.validation.sphere.fit.model import FRAMES, OWN, SENSORS, ReferenceSettings
from recon.validation.sphere.uncertainty import CONFIDENCE, coverage_factor, fit_uncertainty

MIN_PLACES = 3  # to determine a rigid motion
THIN = 0.02  # of the longest extent of the places: with less across it, they lie on a line
OTHER_UNIT = 2.0  # ratio of extents that no error explains; an inch has 2.54 cm
MORE_PLACES = "--keep some that were left out, or leave out --reference-centre"
EXPANDED = 2.0  # coverage factor of the normalised error, as in ISO 17043's E_n


@dataclass(frozen=True, eq=False)
class Centre:
    """A ball's measured centre.

    Parameters
    ----------
    place : float64 (3,), mm
    covariance : float64 (3, 3), mm^2; zero where it is not known
    """

    place: NDArray[np.float64]
    covariance: NDArray[np.float64]


def read_references(settings: ReferenceSettings, radius: float, n_samples: int, seed: int) -> list[Centre]:
    """Read the reference centres, or find the balls in the reference's scans.

    Parameters
    ----------
    settings : where they are
    radius : mm
    n_samples : how many there must be
    seed : of the search for balls

    Raises
    ------
    ValueError
        If a file cannot be read, a scan holds no ball, there are not as many centres as samples, or too few.
    """
    if settings.frame not in FRAMES:
        raise ValueError(f"the reference's frame is {settings.frame!r}, expected one of {', '.join(FRAMES)}")
    clouds = [read_exactly(path, settings.unit) for path in settings.files]
    if len(clouds) == 1 and (n_samples > 1 or len(clouds[0]) < MIN_POINTS):
        centres = [Centre(place, np.zeros((3, 3))) for place in clouds[0]]
    else:
        centres = [_scanned(path, cloud, radius, seed) for path, cloud in zip(settings.files, clouds, strict=True)]
    if len(centres) != n_samples:
        raise ValueError(
            f"there are {len(centres)} reference centres for {n_samples} placed balls; expected one for each, in "
            "their order: --reference-centre once per scan, or one file with a line x y z per ball"
        )
    if settings.frame == OWN and n_samples < MIN_PLACES:
        raise ValueError(
            f"there are reference centres of {n_samples} places in a frame of their own, which is unknown: that takes "
            f"at least {MIN_PLACES} places. Measure more places, or say --reference-frame sensors if the centres are "
            "in the frame of the clouds"
        )
    return centres


def mean_centre(centres: Sequence[Centre]) -> Centre:
    """Return the mean of several sensors' centres of one ball, whose errors are taken as independent."""
    covariance = np.sum([centre.covariance for centre in centres], axis=0) / len(centres) ** 2
    return Centre(np.mean([centre.place for centre in centres], axis=0), covariance)


def check_unit(references: Sequence[Centre], measured: Mapping[int, Centre], radius: float) -> None:
    """Refuse, by a FitError, references whose places extend so differently that they must be in another unit.

    Parameters
    ----------
    references : of each sample, from the first on
    measured : of the samples used, by number from 1
    radius : mm, of the ball; places that extend over less, as where a ball stays in place, do not tell
    """
    pairs = [(references[sample - 1].place, centre.place) for sample, centre in measured.items()]
    theirs, ours = (float(np.linalg.norm(np.std(places, axis=0))) for places in zip(*pairs, strict=True))
    if max(theirs, ours) > radius and theirs > 0 and not ours / OTHER_UNIT < theirs < ours * OTHER_UNIT:
        raise FitError(
            f"the reference's places extend over {theirs:.3g} mm, those in the clouds over {ours:.3g} mm "
            "(standard deviations): give the reference's unit with --reference-unit"
        )


def agreement(references: Sequence[Centre], measured: Mapping[int, Centre], frame: str) -> dict[str, Any]:
    """Compare measured centres with reference centres.

    Parameters
    ----------
    references : of each sample, from the first on
    measured : of the samples used, by number from 1
    frame : one of FRAMES, the references'

    Returns
    -------
    report : degrees of freedom, the residuals' standard deviation of one coordinate, the share that the fits' own
        uncertainties explain, and a row per sample

    Raises
    ------
    FitError
        If no place is used, or those used do not determine the motion between the frames.
    """
    if not measured:
        raise FitError(f"none of the placed balls is used, so that there is nothing to compare; {MORE_PLACES}")
    samples = sorted(measured)
    ours, theirs = (np.stack([centre.place for centre in centres]) for centres in (
        [measured[sample] for sample in samples], [references[sample - 1] for sample in samples]))  # fmt: skip
    motion, n_free = (np.eye(4), 0) if frame == SENSORS else (_motion(theirs, ours), 6)
    turn, dof = motion[:3, :3], 3 * len(samples) - n_free
    residuals = ours - transformed(theirs, motion)
    rows, squares = [], []
    for sample, residual in zip(samples, residuals, strict=True):
        covariance = measured[sample].covariance + turn @ references[sample - 1].covariance @ turn.T
        distance = float(np.linalg.norm(residual))
        along = residual / distance if distance else np.array([1.0, 0.0, 0.0])
        u = float(np.sqrt(along @ covariance @ along))
        e_n = distance / (EXPANDED * u) if u else None
        if np.linalg.matrix_rank(covariance) == 3:
            squares.append(float(residual @ np.linalg.solve(covariance, residual)))
        rows.append({"sample": sample, "residual_mm": np.round(residual, 4).tolist(), "distance_mm": distance,
                     "u_mm": u, "e_n": e_n})  # fmt: skip
    return {
        "frame": frame,
        "n_samples": len(samples),
        "degrees_of_freedom": dof,
        **_standard_deviation(residuals, dof),
        "mean_distance_mm": float(np.mean([row["distance_mm"] for row in rows])),
        "birge_ratio": float(np.sqrt(sum(squares) / dof)) if len(squares) == len(rows) else None,
        **(_scale(theirs, ours) if frame == OWN else {}),
        "sensors_from_reference": motion.tolist(),
        "samples": rows,
    }


def _standard_deviation(residuals: NDArray[np.float64], dof: int) -> dict[str, float]:
    """Return the standard deviation of a coordinate of residuals (N, 3), mm, with its 95 % interval by chi square."""
    total = float(np.sum(residuals**2))
    low, high = chdtri(dof, ((1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2))
    return {f"s{end}_mm": float(np.sqrt(total / n)) for end, n in (("", dof), ("_low", low), ("_high", high))}


def _scanned(path: Path, scan: NDArray[np.float64], radius: float, seed: int) -> Centre:
    """Find the ball in a scan, whose instrument may stand, or have its origin, far away."""
    origin = np.median(scan, axis=0)
    cloud = np.asarray(scan - origin, np.float32)
    try:
        fit = fit_sphere(cloud, radius, seed)
    except ValueError as error:
        raise ValueError(f"{path}: {str(error).replace('--unit', '--reference-unit')}") from error
    sample = subsample(cloud, seed)
    uncertainty = fit_uncertainty(sample, fit, cap_of(sample, fit), seed)
    return Centre(origin + fit.centre, np.zeros((3, 3)) if uncertainty is None else uncertainty.centre_covariance)


def _motion(theirs: NDArray[np.float64], ours: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rigid motion (4, 4) from their places (N, 3) to ours."""
    if len(ours) < MIN_PLACES:
        raise FitError(
            f"{len(ours)} of the placed balls are used, but a rigid motion takes at least {MIN_PLACES}; {MORE_PLACES}"
        )
    for name, places in (("reference", theirs), ("fitted", ours)):
        spread = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
        if spread[1] <= THIN * spread[0]:
            raise FitError(f"the {name} centres lie on a line, about which any turn fits: place a ball off that line")
    motion = rigid_motions(theirs, ours[None])[0]
    return rigid(motion[:, :3], motion[:, 3])


def _scale(theirs: NDArray[np.float64], ours: NDArray[np.float64]) -> dict[str, float]:
    """Return by how much our distances are longer than theirs, as a ratio, with its uncertainty.

    Source: Umeyama, "Least-squares estimation of transformation parameters between two point patterns" (1991).
    """
    x, y = theirs - theirs.mean(axis=0), ours - ours.mean(axis=0)
    turn = rigid_motions(x, y[None])[0, :, :3]
    size = float(np.sum(x**2))
    scale = float(np.sum(y * (x @ turn.T))) / size
    left, dof = float(np.sum((y - scale * x @ turn.T) ** 2)), 3 * len(ours) - 7
    return {"scale": scale, "u_scale": float(np.sqrt(left / dof / size)), "scale_coverage_factor": coverage_factor(dof)}
