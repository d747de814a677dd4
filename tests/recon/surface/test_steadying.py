"""Rims that jump between frames come to rest, and what moves does not trail."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import Mesh
from recon.surface.holes import rim_edges
from recon.surface.steadying import steady_rims

N, VOXEL = 40, 5.0  # vertices along a side of a square, mm between them


def square(shift: tuple[float, float] = (0.0, 0.0), jagged: float = 0.0, seed: int = 0) -> Mesh:
    """A flat square whose rims are jagged by some mm in its plane."""
    y, x = np.indices((N, N))
    vertices = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3) * VOXEL
    number = np.arange(N * N).reshape(N, N)
    a, b, c, d = (corner.ravel() for corner in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)
    rim = np.unique(rim_edges(faces))
    vertices[rim, :2] += np.random.default_rng(seed).normal(0, jagged, (len(rim), 2))
    normals = np.tile(np.float32([0, 0, 1]), (N * N, 1))
    places = (vertices + np.array([*shift, 0])).astype(np.float32)
    return Mesh(places, faces, normals, np.full((N * N, 3), 128, np.uint8))


def change(first: Mesh, second: Mesh) -> float:
    """How far the corresponding vertices of two rims lie from each other across the left rim, mm."""
    left = np.arange(2 * N, N * N - 2 * N, N)
    return float(np.abs(first.vertices[left, 0] - second.vertices[left, 0]).mean())


def test_rims_that_jump_between_frames_come_to_rest() -> None:
    frames = [square(jagged=2.0, seed=seed) for seed in range(6)]
    steadied = [steady_rims(frames[n], [*frames[n - 2 : n], *frames[n + 1 : n + 3]], VOXEL) for n in (2, 3)]
    assert change(*steadied) < 0.5 * change(frames[2], frames[3])


def test_what_moves_evenly_stays_where_it_is() -> None:
    before, now, after = (square((6.0 * n, 0.0)) for n in (-1, 0, 1))
    moved: NDArray[np.float32] = steady_rims(now, [before, after], VOXEL).vertices - now.vertices
    left = np.arange(4 * N, N * N - 4 * N, N)
    assert np.abs(moved[left, 0]).max() < 0.1 * 6.0


def test_what_lies_elsewhere_draws_no_rim() -> None:
    now = square()
    far = square((0.0, 3 * N * VOXEL))
    assert np.array_equal(steady_rims(now, [far, far], VOXEL).vertices, now.vertices)


def test_what_is_far_from_a_rim_does_not_move() -> None:
    now = square()
    moved = steady_rims(now, [square((4.0, 0.0)), square((4.0, 0.0))], VOXEL).vertices - now.vertices
    assert np.abs(moved.reshape(N, N, 3)[:, 0, 0]).min() > 1.0
    assert not moved.reshape(N, N, 3)[10:-10, 10:-10].any()


def test_a_surface_without_rims_or_without_others_stays_as_it_is() -> None:
    now = square()
    empty = replace(now, faces=np.zeros((0, 3), np.int32))
    assert np.array_equal(steady_rims(empty, [now, now], VOXEL).vertices, now.vertices)
    for others in ([], [empty, empty]):
        assert np.array_equal(steady_rims(now, others, VOXEL).vertices, now.vertices)
