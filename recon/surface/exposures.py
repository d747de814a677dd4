"""What makes the photographs of several cameras agree: a gain for each, and a matrix where their colours differ.

Cameras of one make differ in exposure and white balance, which gains of red, green and blue take away. Those of
different makes see a colour as other mixtures of the three. A matrix for each camera, in linear light, takes that away,
too; it is used only if it explains places that it was not estimated from.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import Mesh
from recon.geometry.srgb import light_of, light_of_bytes, srgb_bytes
from recon.surface.colours import MAD_TO_SIGMA, MIN_SHARED_PLACES, SATURATED
from recon.surface.photographs import Photograph, prepare, qualities, sampled

GAIN_SIGMA = 0.05  # of the logarithm of a gain: cameras of one studio are exposed alike
LEAST_SPREAD = 0.02  # of logarithms of ratios: what pixels round off
MATRIX_SIGMA = 0.1  # of an entry beside what is the same: of other makes, not of another world
LEAST_ERROR = 0.004  # linear, of 1: what two shots of a place differ by at best
MOST_PLACES = 20_000  # of a pair of cameras
STRETCH = 200  # vertices in a row, which are near each other, are either estimated from or held out
MATRICES_GAIN = 0.97  # of the error on what was held out is left, or less, where matrices are used; honest: 1.00
ROUNDS = 5  # of Huber's weights

_Pair = tuple[int, int, NDArray[np.float64], NDArray[np.float64]]  # two cameras, and linear colours (P, 3) of each


@dataclass(frozen=True, eq=False)
class Exposure:
    """How a camera's colours are changed: by gains of its bytes, then by a matrix in linear light.

    Parameters
    ----------
    gain : float64 (3,)
    matrix : float64 (3, 3); None for none
    """

    gain: NDArray[np.float64]
    matrix: NDArray[np.float64] | None = None

    def on(self, pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Change colours, uint8 (..., 3)."""
        table = np.rint(np.clip(np.arange(256)[:, None] * self.gain, 0, 255)).astype(np.uint8)
        changed = np.asarray(cv2.LUT(pixels, table[None]), np.uint8)
        if self.matrix is None:
            return changed
        return srgb_bytes(light_of_bytes()[changed] @ self.matrix.T)


def exposed(photograph: Photograph, exposure: Exposure) -> Photograph:
    """Change the colours of a photograph."""
    return replace(photograph, pixels=exposure.on(photograph.pixels))


def compare_exposures(mesh: Mesh, photographs: Sequence[Photograph], tolerance_mm: float) -> list[Exposure]:
    """Estimate for each camera what makes the cameras agree on the vertices which several see.

    The ratios in which two cameras see colours differ by place where the light differs, not the exposure: the more they
    differ, the less they count against `GAIN_SIGMA`. A camera that shares too little with others keeps the gain 1.

    Parameters
    ----------
    mesh : whose vertices are compared
    photographs : V of them, one per camera
    tolerance_mm : how far surfaces may lie behind each other and count as one
    """
    seen = [_colours_of_vertices(mesh, photograph, tolerance_mm) for photograph in photographs]
    exposures = [Exposure(gain) for gain in _gains(seen)]
    matrices = _matrices([colours * exposure.gain for colours, exposure in zip(seen, exposures, strict=True)])
    if matrices is None:
        return exposures
    return [Exposure(exposure.gain, matrix) for exposure, matrix in zip(exposures, matrices, strict=True)]


def _gains(seen: Sequence[NDArray[np.float32]]) -> NDArray[np.float64]:
    """Estimate the gains (V, 3) of cameras that see the colours (N, 3), NaN where they do not see a vertex."""
    n = len(seen)
    normal, target = np.tile(np.eye(n) / GAIN_SIGMA**2, (3, 1, 1)), np.zeros((3, n))
    for a, b in combinations(range(n), 2):
        ratio = np.log(seen[a] / seen[b])
        ratio = ratio[np.isfinite(ratio).all(axis=1)]
        if len(ratio) < MIN_SHARED_PLACES:
            continue
        middle = np.median(ratio, axis=0)
        spread = MAD_TO_SIGMA * np.median(np.abs(ratio - middle), axis=0)
        weight = 1 / np.maximum(spread, LEAST_SPREAD) ** 2
        for i, j, sign in ((a, a, 1), (b, b, 1), (a, b, -1), (b, a, -1)):
            normal[:, i, j] += sign * weight
        target[:, a] -= weight * middle
        target[:, b] += weight * middle
    return np.asarray(np.exp(np.linalg.solve(normal, target[..., None])[..., 0]).T)


def _matrices(seen: Sequence[NDArray[np.floating]]) -> NDArray[np.float64] | None:
    """Estimate the matrices (V, 3, 3) of cameras that see the colours (N, 3); None where they would not help."""
    known, held_out = (_pairs(seen, part) for part in (0, 1))
    if sum(len(first) for *_, first, _ in held_out) < MIN_SHARED_PLACES:
        return None
    before, after = (_error(held_out, matrices) for matrices in (_same(len(seen)), _solved(len(seen), known)))
    return _solved(len(seen), known + held_out) if after <= MATRICES_GAIN * before else None


def _pairs(seen: Sequence[NDArray[np.floating]], part: int) -> list[_Pair]:
    """List what two cameras see of the same vertices, in every other stretch of them."""
    n_vertices = len(seen[0]) if seen else 0
    is_in_part = np.arange(n_vertices) // STRETCH % 2 == part
    pairs: list[_Pair] = []
    for a, b in combinations(range(len(seen)), 2):
        places = np.flatnonzero(is_in_part & np.isfinite(seen[a]).all(axis=1) & np.isfinite(seen[b]).all(axis=1))
        if len(places) >= MIN_SHARED_PLACES:
            places = places[:: -(-len(places) // MOST_PLACES)]
            first, second = (light_of(seen[camera][places] / 255) for camera in (a, b))
            pairs.append((a, b, first, second))
    return pairs


def _same(n_cameras: int) -> NDArray[np.float64]:
    return np.tile(np.eye(3), (n_cameras, 1, 1))


def _error(pairs: Sequence[_Pair], matrices: NDArray[np.float64]) -> float:
    """Return the mean difference between cameras after their matrices."""
    return float(np.mean(np.concatenate([np.abs(x @ matrices[a].T - y @ matrices[b].T) for a, b, x, y in pairs])))


def _solved(n_cameras: int, pairs: Sequence[_Pair]) -> NDArray[np.float64]:
    """Solve for the matrices, whose mean changes nothing, by iterated least squares; the prior keeps them near it."""
    matrices = _same(n_cameras)
    for _ in range(ROUNDS):
        normal, target = np.eye(3 * n_cameras) / MATRIX_SIGMA**2, np.zeros((3 * n_cameras, 3))
        for a, b, x, y in pairs:
            residual = np.linalg.norm(x @ matrices[a].T - y @ matrices[b].T, axis=1)
            error = max(LEAST_ERROR, MAD_TO_SIGMA * float(np.median(residual)))
            # one place says little that its neighbours do not: a pair counts as if `MIN_SHARED_PLACES` were seen
            weight = error / np.maximum(residual, error) / error**2 * (MIN_SHARED_PLACES / len(x))
            rows = np.concatenate([x, -y], axis=1)  # (P, 6)
            place = np.r_[3 * a : 3 * a + 3, 3 * b : 3 * b + 3]
            normal[np.ix_(place, place)] += rows.T @ (weight[:, None] * rows)
            target[place] -= rows.T @ (weight[:, None] * (x - y))
        means = np.tile(np.eye(3), (1, n_cameras))  # of the changes, which stay 0: else all would turn grey and agree
        system = np.block([[normal, means.T], [means, np.zeros((3, 3))]])
        change = np.linalg.solve(system, np.concatenate([target, np.zeros((3, 3))]))[: 3 * n_cameras]  # (3 V, 3)
        matrices = _same(n_cameras) + change.reshape(n_cameras, 3, 3).transpose(0, 2, 1)
    return matrices


def _colours_of_vertices(mesh: Mesh, photograph: Photograph, tolerance_mm: float) -> NDArray[np.float32]:
    """Return the vertices' colours in a photograph, float32 (N, 3), NaN where it does not show them or is clipped."""
    colours = np.full_like(mesh.vertices, np.nan)
    views = prepare(mesh, [photograph], tolerance_mm)
    for view, quality in zip(views, qualities(views, mesh.vertices, mesh.normals, tolerance_mm), strict=True):
        is_seen = quality > 0
        seen = sampled(view.coarse, view.photograph.camera.project(mesh.vertices[is_seen]))
        is_usable = ((seen > SATURATED[0]) & (seen < SATURATED[1])).all(axis=1, keepdims=True)
        colours[is_seen] = np.where(is_usable, seen, np.nan)
    return colours
