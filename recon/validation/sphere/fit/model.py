"""Settings of an evaluation, and a fitted sphere."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.validation.measures import Subject
from recon.validation.sphere.fit.kernels import signed_errors

BAND_SHARE = 1 / 12  # of the radius: 12.5 mm, the threshold of the paper's table 4, for its 150 mm
# Tukey's constant in standard deviations of the inliers; a million points need no efficiency, so it is tighter than the
# usual 4.685, and clusters near the surface pull less.
CUTOFF = 2.5
OWN, SENSORS = "own", "sensors"
FRAMES = (OWN, SENSORS)  # of reference centres


@dataclass(frozen=True)
class ReferenceSettings:
    """Where the reference centres are.

    Parameters
    ----------
    files : one scan of the ball for each sample, in order; or one text file with a centre x y z a line
    unit : of their coordinates
    frame : "own" for the reference's own frame, "sensors" for that of the clouds
    """

    files: tuple[Path, ...]
    unit: str = "mm"
    frame: str = OWN


@dataclass(frozen=True)
class SphereSettings:
    """What is measured, and how.

    Parameters
    ----------
    radius : mm
    thresholds : mm, of the inlier curve
    method : a key of METHODS
    unit : of the clouds' coordinates
    viewpoints : where each sensor stands, mm; then only points on lines of sight that meet the ball are counted
    keep : names of reconstructions that are used whatever the exclusion rule says
    drop : names of reconstructions that are left out whatever it says
    reference : another instrument's centres to compare with
    subject : what the clouds show, in a study's words
    seed : of the fit and the bootstrap
    """

    radius: float
    thresholds: tuple[float, ...]
    method: str = "robust"
    unit: str = "mm"
    viewpoints: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    keep: tuple[str, ...] = ()
    drop: tuple[str, ...] = ()
    reference: ReferenceSettings | None = None
    subject: Subject = field(default_factory=Subject)
    seed: int = 1


@dataclass(frozen=True, eq=False)
class SphereFit:
    """A sphere in a cloud.

    Parameters
    ----------
    centre : float64 (3,), mm
    radius : mm, known
    free_radius : mm, the radius that suits the points best, a check of scale and curvature
    scale : mm, standard deviation of the points on the surface, robust
    coverage : share of the sphere's directions in which it has points
    surface_share : share of the points around the sphere that lie on it
    """

    centre: NDArray[np.float64]
    radius: float
    free_radius: float
    scale: float
    coverage: float
    surface_share: float

    @property
    def band(self) -> float:
        """How far from the surface a point may lie and still count for it, mm; more where the points scatter more."""
        return max(band_of(self.radius), CUTOFF * self.scale)

    def errors(self, points: NDArray[np.floating]) -> NDArray[np.float32]:
        """Return the signed errors (N,) of points (N, 3) to the known radius, mm; positive outside."""
        errors: NDArray[np.float32] = signed_errors(
            np.ascontiguousarray(points, dtype=np.float32), self.centre, self.radius
        )
        return errors


def surface_share(points: NDArray[np.floating], fit: SphereFit) -> float:
    """Return the share of points (N, 3), mm, that lie on a sphere, where all of them ought to."""
    return float(np.mean(np.abs(fit.errors(points)) < fit.band)) if len(points) else 0.0


def band_of(radius: float) -> float:
    """Return how far from a sphere's surface a point may lie and still count for it, mm."""
    return BAND_SHARE * radius
