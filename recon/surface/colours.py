"""Colours of several sensors made to agree before their clouds are fused."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import Cloud
from recon.geometry.normals import vector_sums

SAME_SURFACE = 0.8  # cosine between the normals of two sensors' points that are the same place
SATURATED = (8, 247)  # bytes beyond these may have been clipped
MIN_SHARED_PLACES = 50  # fewer say nothing about three gains and offsets
PRIOR = 0.005  # of the shared places' weight, on gain 1 and offset 0: decides what the overlaps leave open
OFFSET_SCALE = 20.0  # bytes; as likely as a gain of 2
ROBUST_STEPS = 10
MAD_TO_SIGMA = 1.4826  # of a normal distribution

_Places = tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]


@dataclass(frozen=True, eq=False)
class SensorColours:
    """Correction of the sensors' colours: `gain * colour + offset`.

    Parameters
    ----------
    gain, offset : float64 (S, 3), per sensor and channel, sRGB bytes; their means over the sensors are 1 and 0
    """

    gain: NDArray[np.float64]
    offset: NDArray[np.float64]


def estimate_colours(clouds: Sequence[Cloud], place_mm: float) -> SensorColours:
    """Estimate gain and offset of each sensor from the places that more than one of them saw.

    Places are cubes `place_mm` wide; those where normals disagree or colours are clipped do not count, and others
    count less the less they fit (Huber's weights). Estimate once for a recording, so that colours stay steady in time.

    Raises
    ------
    ValueError
        If the sensors share too few places.
    """
    places = [_places(cloud, place_mm) for cloud in clouds]
    pairs = [(a, b, *_shared(places[a], places[b])) for a, b in combinations(range(len(clouds)), 2)]
    n_shared = sum(len(first) for *_, first, _ in pairs)
    if n_shared < MIN_SHARED_PLACES:
        raise ValueError(
            f"the sensors share {n_shared} places of {place_mm:g} mm, too few to compare their colours: "
            f"expected at least {MIN_SHARED_PLACES}"
        )
    solved = np.stack([_solve_channel(len(clouds), pairs, channel) for channel in range(3)], axis=-1)
    return SensorColours(solved[: len(clouds)], solved[len(clouds) :])


def balance_colours(clouds: Sequence[Cloud], colours: SensorColours) -> list[Cloud]:
    """Apply gain and offset of each sensor to its cloud."""
    return [
        Cloud(cloud.points, cloud.normals, _balanced(cloud.colours, gain, offset), cloud.sigma)
        for cloud, gain, offset in zip(clouds, colours.gain, colours.offset, strict=True)
    ]


def _balanced(colours: NDArray[np.uint8], gain: NDArray[np.float64], offset: NDArray[np.float64]) -> NDArray[np.uint8]:
    return np.asarray(np.clip(np.rint(colours * gain + offset), 0, 255), dtype=np.uint8)


def _places(cloud: Cloud, place_mm: float) -> _Places:
    """List the cubes (P, 3) that hold points, their mean colours (P, 3) and mean normals (P, 3)."""
    cubes, place = np.unique(np.floor(cloud.points / place_mm).astype(np.int64), axis=0, return_inverse=True)
    place = place.ravel()
    count = np.bincount(place)[:, None]
    colours, normals = (vector_sums(values, place, len(cubes)) / count for values in (cloud.colours, cloud.normals))
    return cubes, colours, normals


def _shared(a: _Places, b: _Places) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Pair the colours (P, 3), (P, 3) of the places that both sensors saw alike."""
    _, twice, count = np.unique(np.concatenate([a[0], b[0]]), axis=0, return_inverse=True, return_counts=True)
    in_both = count[twice.ravel()] == 2
    first, second = np.flatnonzero(in_both[: len(a[0])]), np.flatnonzero(in_both[len(a[0]) :])
    colour_a, colour_b = a[1][first], b[1][second]
    usable = (a[2][first] * b[2][second]).sum(axis=1) > SAME_SURFACE
    for colour in (colour_a, colour_b):
        usable &= ((colour > SATURATED[0]) & (colour < SATURATED[1])).all(axis=1)
    return colour_a[usable], colour_b[usable]


def _solve_channel(
    n_sensors: int, pairs: Sequence[tuple[int, int, NDArray[np.float64], NDArray[np.float64]]], channel: int
) -> NDArray[np.float64]:
    """Solve for the gains and offsets (2 S,) of a channel by iterated least squares, with means 1 and 0."""
    blocks = []
    for a, b, first, second in pairs:
        rows = np.zeros((len(first), 2 * n_sensors))
        rows[:, a], rows[:, b] = first[:, channel], -second[:, channel]
        rows[:, n_sensors + a], rows[:, n_sensors + b] = 1, -1
        blocks.append(rows)
    design = np.concatenate(blocks)
    neutral = np.repeat([1.0, 0.0], n_sensors)
    means = np.kron(np.eye(2), np.ones((1, n_sensors)))  # they stay 1 and 0
    stiffness = PRIOR * len(design) * np.repeat([OFFSET_SCALE**2, 1.0], n_sensors)
    weights = np.ones(len(design))
    change = np.zeros(2 * n_sensors)
    for _ in range(ROBUST_STEPS):
        normal = design.T @ (weights[:, None] * design) + np.diag(stiffness)
        system = np.block([[normal, means.T], [means, np.zeros((2, 2))]])
        target = np.concatenate([-design.T @ (weights * (design @ neutral)), np.zeros(2)])
        change = np.linalg.solve(system, target)[: 2 * n_sensors]
        residual = np.abs(design @ (neutral + change))
        limit = max(1.0, MAD_TO_SIGMA * float(np.median(residual)))
        weights = np.minimum(1.0, limit / np.maximum(residual, limit))
    return np.asarray(neutral + change)
