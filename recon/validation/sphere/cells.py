"""The cells of a ball's visible cap: sectors around the line of sight, each divided into rings.

The exclusion rule leaves sectors and halves out, the bootstrap draws sectors, and what is the same in a cell of every
shot is calibration. Right and up are the same for all shots of a sensor, so cells can be compared between shots.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.validation.sampling import axes_facing
from recon.validation.sphere.fit.model import SphereFit

N_SECTORS = 8
N_RINGS = 3  # of equal numbers of points
NEAR = 0.25  # of the radius: points whose error is smaller belong to the cap


@dataclass(frozen=True, eq=False)
class Cap:
    """The points on and around the surface that a sensor saw.

    Parameters
    ----------
    points : float32 (N, 3), mm
    errors : float32 (N,), mm, signed
    axes : float64 (3, 3), whose rows are right, up and towards the sensor
    places : float64 (N, 3), directions from the centre along these axes
    ring_ends : float64 (N_RINGS - 1,), the places' third coordinate where the rings meet, from the rim inwards
    """

    points: NDArray[np.float32]
    errors: NDArray[np.float32]
    axes: NDArray[np.float64]
    places: NDArray[np.float64]
    ring_ends: NDArray[np.float64]

    @property
    def sector(self) -> NDArray[np.int64]:
        """The sector (N,) of each point."""
        return sector_at(self.places)

    @property
    def cell(self) -> NDArray[np.int64]:
        """The cell (N,) of each point: N_RINGS times its sector, plus its ring from the rim inwards."""
        return np.asarray(self.sector * N_RINGS + np.searchsorted(self.ring_ends, self.places[:, 2]))

    def medians(self) -> NDArray[np.float64]:
        """Return the median error of each cell, float64 (N_SECTORS N_RINGS,), mm; NaN where it has no points."""
        cell, medians = self.cell, np.full(N_SECTORS * N_RINGS, np.nan)
        for index in np.unique(cell):
            medians[index] = np.median(self.errors[cell == index])
        return medians


def cap_of(points: NDArray[np.float32], fit: SphereFit) -> Cap:
    """Return the cap of points (N, 3), mm, on and around a fitted sphere."""
    errors = fit.errors(points)
    near = np.abs(errors) < NEAR * fit.radius
    offsets = (points[near] - fit.centre).astype(np.float64)
    directions = offsets / np.linalg.norm(offsets, axis=1, keepdims=True)
    axes = axes_facing(directions.mean(axis=0))
    places = directions @ axes.T
    ring_ends = np.quantile(places[:, 2], np.arange(1, N_RINGS) / N_RINGS)
    return Cap(points[near], errors[near], axes, places, ring_ends)


def sector_at(places: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the sector (N,) of places (N, 3) along a cap's axes, counted from the left, counter-clockwise."""
    turn = np.arctan2(places[:, 1], places[:, 0]) + np.pi
    return np.minimum((turn / (2 * np.pi) * N_SECTORS).astype(np.int64), N_SECTORS - 1)
