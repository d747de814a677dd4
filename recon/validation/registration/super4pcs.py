"""Super4PCS: registration of a rigid model to a cloud without a starting guess.

Source: Mellado, Aiger, Mitra (2014). The model is searched for bases that are congruent to one of four coplanar points
of the cloud: no rigid motion changes the diagonals' lengths, where they cross, and their angle. Each congruent base
gives a motion; the motion that brings most of the cloud onto the model wins.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.geometry.rig import rigid
from recon.validation.registration.congruent import congruent_bases, overlaps, pairs_at_distance

MOST_PAIRS = 20_000
MIN_SAMPLE = 20
LARGEST_GRID = 96  # cells along the longest side of the model's surroundings
FLATTEST = 0.3  # sine between the base's sides; below, its points are nearly in line
BASE_TRIES = 200
PER_TRIAL, N_CANDIDATES = 3, 12  # motions that are kept of each base, and of all bases


@dataclass(frozen=True)
class Super4PCSParameters:
    """How long and how finely to search.

    Parameters
    ----------
    delta : mm, how far from the model its points may lie; also the tolerance of congruence
    overlap : share of the cloud that belongs to the model; the widest bases are this share of the cloud's extent
    n_samples : points of the cloud and of the model that are used
    n_trials : bases that are tried
    n_congruent : congruent bases that are checked per trial
    seed : of samples and bases; the same one gives the same result on every machine
    """

    delta: float
    overlap: float = 0.6
    n_samples: int = 400
    n_trials: int = 30
    n_congruent: int = 2000
    seed: int = 1

    def __post_init__(self) -> None:
        if not self.delta > 0:
            raise ValueError(f"delta is {self.delta} mm, expected more than zero")
        if not 0 < self.overlap <= 1:
            raise ValueError(f"overlap is {self.overlap}, expected more than 0 and at most 1")
        if self.n_trials < 1 or self.n_congruent < 1 or self.n_samples < MIN_SAMPLE:
            raise ValueError(
                f"n_trials {self.n_trials} and n_congruent {self.n_congruent} must be at least 1, "
                f"n_samples {self.n_samples} at least {MIN_SAMPLE}"
            )


def super4pcs(
    model: NDArray[np.floating], cloud: NDArray[np.floating], parameters: Super4PCSParameters
) -> NDArray[np.float64]:
    """Register a model to a cloud: cloud_from_model, float64 (C, 4, 4), of the best motions; they may be nearly alike.

    Parameters
    ----------
    model, cloud : floating (M, 3) and (N, 3), mm
    parameters : of the search

    Raises
    ------
    ValueError
        If either has too few points, or no base of the cloud is congruent to one of the model.
    """
    rng = np.random.default_rng(parameters.seed)
    model_sample = _spread(model, parameters.n_samples, rng)
    cloud_sample = _spread(cloud, parameters.n_samples, rng)
    near, low, cell = _surroundings(np.asarray(model, dtype=np.float64), parameters.delta)
    best: list[tuple[float, NDArray[np.float64]]] = []
    for _ in range(parameters.n_trials):
        motions = _motions(_base(cloud_sample, model_sample, parameters, rng), model_sample, parameters, rng)
        if not len(motions):
            continue
        shares = overlaps(motions, cloud_sample, near, low, cell)
        best += [(float(shares[index]), motions[index]) for index in np.argsort(-shares, kind="stable")[:PER_TRIAL]]
    best.sort(key=lambda candidate: -candidate[0])
    if not best or best[0][0] <= 0:
        raise ValueError(
            f"no base of the cloud is congruent to one of the model in {parameters.n_trials} trials; delta "
            f"{parameters.delta:g} mm may be too small, or the model is not in the cloud"
        )
    return np.stack([np.linalg.inv(rigid(motion[:, :3], motion[:, 3])) for _, motion in best[:N_CANDIDATES]])


def _motions(
    base: NDArray[np.float64], model: NDArray[np.float64], parameters: Super4PCSParameters, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return the motions (T, 3, 4) that bring the base (4, 3) onto congruent points of the model."""
    a, b, c, d = base
    at = _crossing(base)
    length_ab, length_cd = float(np.linalg.norm(b - a)), float(np.linalg.norm(d - c))
    if min(length_ab, length_cd) <= parameters.delta:  # a cloud too small to say anything
        return np.zeros((0, 3, 4))
    cosine = float((b - a) @ (d - c)) / (length_ab * length_cd)
    first = pairs_at_distance(model, length_ab, parameters.delta, MOST_PAIRS)
    second = pairs_at_distance(model, length_cd, parameters.delta, MOST_PAIRS)
    most = 20 * parameters.n_congruent
    bases = congruent_bases(model, first, rng.permutation(second), at, cosine, parameters.delta, most)
    if len(bases) > parameters.n_congruent:
        bases = bases[rng.choice(len(bases), parameters.n_congruent, replace=False)]
    return rigid_motions(base, model[bases])


def rigid_motions(sources: NDArray[np.float64], targets: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rigid motions (T, 3, 4) that bring points (K, 3) nearest to each of targets (T, K, 3).

    Source: Arun, Huang, Blostein, "Least-squares fitting of two 3-D point sets" (1987).
    """
    middle, middles = sources.mean(axis=0), targets.mean(axis=1)
    covariance = np.einsum("ki,tkj->tij", sources - middle, targets - middles[:, None])
    u, _, vt = np.linalg.svd(covariance)
    turn = np.swapaxes(vt, 1, 2) @ np.swapaxes(u, 1, 2)
    flip = np.where(np.linalg.det(turn) < 0, -1.0, 1.0)
    vt[:, 2] *= flip[:, None]
    turn = np.swapaxes(vt, 1, 2) @ np.swapaxes(u, 1, 2)
    return np.concatenate([turn, (middles - turn @ middle)[:, :, None]], axis=2)


def _base(
    cloud: NDArray[np.float64], model: NDArray[np.float64], parameters: Super4PCSParameters, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Draw four nearly coplanar points (4, 3) whose diagonals ab and cd cross, as wide as the overlap allows."""
    widest = parameters.overlap * min(_extent(cloud), _extent(model))
    best, best_gap = cloud[:4], np.inf
    for _ in range(BASE_TRIES):
        a, b, c = cloud[rng.choice(len(cloud), 3, replace=False)]
        sides = np.array([np.linalg.norm(b - a), np.linalg.norm(c - a), np.linalg.norm(c - b)])
        normal = np.cross(b - a, c - a)
        size = float(np.linalg.norm(normal))
        if sides.max() > widest or sides.min() < widest / 4 or size < FLATTEST * sides[0] * sides[1]:
            continue
        fourth, gap = _fourth(cloud, np.stack([a, b, c]), normal / size, widest)
        if gap < best_gap:
            best, best_gap = np.stack([a, b, c, fourth]), gap
        if best_gap < parameters.delta / 2:
            break
    return best


def _fourth(
    cloud: NDArray[np.float64], triangle: NDArray[np.float64], normal: NDArray[np.float64], widest: float
) -> tuple[NDArray[np.float64], float]:
    """Return the point nearest to the triangle's plane that makes ab and cd cross, and its distance to the plane."""
    a, b, c = triangle
    in_plane = np.stack([b - a, c - a], axis=1)
    s, t = np.linalg.lstsq(in_plane, (cloud - a).T, rcond=None)[0]
    crossing = s / np.where(np.abs(1 - t) < 1e-9, np.inf, 1 - t)  # where cd meets ab, as a share of ab
    suits = (t < -0.25) & (crossing > 0.1) & (crossing < 0.9)
    suits &= np.linalg.norm(cloud - c, axis=1) < widest
    if not suits.any():
        return c, np.inf
    gaps = np.where(suits, np.abs((cloud - a) @ normal), np.inf)
    return cloud[int(np.argmin(gaps))], float(gaps.min())


def _crossing(base: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where the lines ab and cd are nearest to each other, as a share (2,) of each length."""
    a, b, c, d = base
    return np.asarray(np.linalg.lstsq(np.stack([b - a, c - d], axis=1), c - a, rcond=None)[0])


def _surroundings(model: NDArray[np.float64], delta: float) -> tuple[NDArray[np.bool_], NDArray[np.float64], float]:
    """Return which cells of a grid around the model lie within delta of its points, the lowest corner and the cell."""
    from scipy.spatial import cKDTree

    low, high = model.min(axis=0) - delta, model.max(axis=0) + delta
    cell = max(delta / 2, float((high - low).max()) / LARGEST_GRID)
    shape = np.ceil((high - low) / cell).astype(int)
    centres = low + (np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1) + 0.5) * cell
    distances, _ = cKDTree(model).query(centres.reshape(-1, 3), distance_upper_bound=delta)
    return np.isfinite(distances).reshape(shape), low, cell


def _spread(points: NDArray[np.floating], n: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw about n of the points, evenly spread over the surface: one from each occupied cell of a grid."""
    if len(points) < MIN_SAMPLE:
        raise ValueError(f"registering needs at least {MIN_SAMPLE} points, found {len(points)}")
    chosen = rng.permutation(len(points)) if len(points) <= 50 * n else rng.choice(len(points), 50 * n, replace=False)
    few: NDArray[np.float64] = points[chosen].astype(np.float64)
    cell = _extent(few) / (2 * n**0.5)
    _, first = np.unique(np.floor((few - few.min(axis=0)) / cell).astype(np.int64), axis=0, return_index=True)
    first = rng.permutation(first) if len(first) >= MIN_SAMPLE else np.arange(len(few))
    return few[first[:n]]


def _extent(points: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(np.ptp(points, axis=0)))
