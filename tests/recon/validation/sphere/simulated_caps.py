"""Simulated reconstructions of a ball whose place is known, to measure the fits and the exclusion rule with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SPOILS = ("none", "wedge", "patch", "rim", "pushed")
UNSEEN_SPOILS = ("ramp", "bulge")  # that no limit of the exclusion rule was set with


@dataclass(frozen=True)
class CapParameters:
    """What a stereo sensor makes of a ball.

    Parameters
    ----------
    radius, distance : mm; of the ball, and from the sensor to its centre
    n_points : of the cap
    opening_deg : full angle of the cap that is reconstructed, seen from the ball's centre
    noise : standard deviation of depth, mm
    outliers : share of the points that lie in clusters of wrong depth
    depth_step : mm between slices of whole disparities; 0 for depths in between
    spoil : one of SPOILS or UNSEEN_SPOILS, a cluster of wrong depth or a depth that is wrong throughout
    spoil_mm : how wrong the depth is there; it grows smoothly into the cluster
    """

    radius: float = 150.0
    distance: float = 2500.0
    n_points: int = 1_000_000
    opening_deg: float = 120.0
    noise: float = 4.0
    outliers: float = 0.05
    depth_step: float = 0.0
    spoil: str = "none"
    spoil_mm: float = 12.0


def simulate_cap(
    parameters: CapParameters, rng: np.random.Generator, towards: NDArray[np.float64] | None = None
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """A reconstructed cap and the true centre of its ball.

    Parameters
    ----------
    towards : float64 (3,), direction from the ball to its sensor; z where None

    Returns
    -------
    points : float32 (N, 3), mm
    centre : float64 (3,), mm
    """
    p = parameters
    cosine = rng.uniform(np.cos(np.deg2rad(p.opening_deg / 2)), 1.0, p.n_points)
    azimuth = rng.uniform(0.0, 2 * np.pi, p.n_points)
    sine = np.sqrt(1 - cosine**2)
    normals = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=1)
    points = p.radius * normals
    rays = points - (0.0, 0.0, p.distance)
    depth = -rays[:, 2]
    wrong = depth + rng.normal(0.0, p.noise, p.n_points) + _clusters(normals, p, rng) + _spoil(normals, p, rng)
    if p.depth_step:
        per_step = p.distance**2 / p.depth_step  # depth = per_step / disparity
        wrong = per_step / np.rint(per_step / wrong)
    points = (0.0, 0.0, p.distance) + rays * (wrong / depth)[:, None]
    centre = rng.uniform(-300.0, 300.0, 3)
    return (points @ _frame(towards) + centre).astype(np.float32), centre


def _clusters(normals: NDArray[np.float64], p: CapParameters, rng: np.random.Generator) -> NDArray[np.float64]:
    """Depth errors (N,) of a share of the points, in discs of 4 to 12 degrees 15 to 90 mm off."""
    error, wanted = np.zeros(len(normals)), p.outliers * len(normals)
    while np.count_nonzero(error) < wanted:
        middle = normals[rng.integers(len(normals))]
        near = (normals @ middle > np.cos(np.deg2rad(rng.uniform(4.0, 12.0)))) & (error == 0)
        near &= rng.random(len(normals)) < rng.uniform(0.5, 1.0)
        room = int(np.ceil(wanted)) - np.count_nonzero(error)
        chosen = np.flatnonzero(near)[: max(room, 0)]
        error[chosen] = rng.choice((-1.0, 1.0)) * rng.uniform(15.0, 90.0) + rng.normal(0.0, 5.0, len(chosen))
    return error


def _spoil(normals: NDArray[np.float64], p: CapParameters, rng: np.random.Generator) -> NDArray[np.float64]:
    """Depth errors (N,) of one large cluster."""
    sign = rng.choice((-1.0, 1.0))
    if p.spoil == "none":
        return np.zeros(len(normals))
    if p.spoil == "pushed":
        return np.full(len(normals), sign * p.spoil_mm)
    half = np.deg2rad(p.opening_deg / 2)
    polar = np.arccos(np.clip(normals[:, 2], -1, 1)) / half
    if p.spoil == "wedge":
        turn = np.angle(np.exp(1j * (np.arctan2(normals[:, 1], normals[:, 0]) - rng.uniform(0, 2 * np.pi))))
        share = np.where(np.abs(turn) < rng.uniform(0.35, 0.8), np.minimum(polar / 0.5, 1.0), 0.0)
    elif p.spoil == "patch":
        at = rng.uniform(0.2, 0.7) * half
        turn = rng.uniform(0, 2 * np.pi)
        middle = np.array([np.sin(at) * np.cos(turn), np.sin(at) * np.sin(turn), np.cos(at)])
        angle = np.arccos(np.clip(normals @ middle, -1, 1))
        share = np.clip((rng.uniform(0.35, 0.6) * half - angle) / (0.1 * half), 0.0, 1.0)
    elif p.spoil == "rim":
        share = np.clip((polar - rng.uniform(0.6, 0.8)) / 0.15, 0.0, 1.0)
    elif p.spoil == "ramp":
        across = rng.uniform(0, 2 * np.pi)
        share = (normals[:, 0] * np.cos(across) + normals[:, 1] * np.sin(across)) / np.sin(half)
    elif p.spoil == "bulge":
        share = 1 - polar**2
    else:
        known = ", ".join((*SPOILS, *UNSEEN_SPOILS))
        raise ValueError(f"there is no way {p.spoil!r} to spoil a cap; expected one of {known}")
    return np.asarray(sign * p.spoil_mm * share)


def _frame(towards: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """Rows: axes x, y, z of the sensor's frame in the world, z along `towards`."""
    if towards is None:
        return np.eye(3)
    z = towards / np.linalg.norm(towards)
    x = np.cross((0.0, 1.0, 0.0) if abs(z[1]) < 0.9 else (1.0, 0.0, 0.0), z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])
