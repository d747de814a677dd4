"""Triangles between samples of different sign, without cracks and without inventing what was not sampled."""

from __future__ import annotations

from collections import Counter

import numba
import numpy as np
import pytest
from skimage.measure import marching_cubes as skimage_marching_cubes

from recon.surface.blocks import neighbours_in
from recon.surface.marching_cubes import edge_corners, march, triangle_table


def blocks_of(shape: tuple[int, int, int]) -> np.ndarray:
    return np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 3).astype(np.int64)


def in_blocks(dense: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A dense array (8 X, 8 Y, 8 Z, ...) as blocks (B, 8, 8, 8, ...) and their coordinates."""
    blocks = blocks_of((dense.shape[0] // 8, dense.shape[1] // 8, dense.shape[2] // 8))
    return np.stack([dense[8 * x : 8 * x + 8, 8 * y : 8 * y + 8, 8 * z : 8 * z + 8] for x, y, z in blocks]), blocks


def marched(
    dense: np.ndarray, gradient: np.ndarray | None = None, colour: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Vertices, faces, normals and colours of a dense field (8 X, 8 Y, 8 Z)."""
    field, blocks = in_blocks(dense.astype(np.float32))
    up = np.broadcast_to(np.float32([0, 0, 1]), (*dense.shape, 3))
    directions, _ = in_blocks(up if gradient is None else gradient.astype(np.float32))
    shades, _ = in_blocks(100 * up if colour is None else colour.astype(np.float32))
    lowest = blocks.min(axis=0) - 1
    keys = ((blocks - lowest) @ [2**36, 2**18, 1]).astype(np.int64)
    order = np.argsort(keys)
    return march(
        field[order],
        *(np.ascontiguousarray(np.moveaxis(part[order], -1, 1)) for part in (directions, shades)),
        blocks[order],
        neighbours_in(blocks[order], keys[order], lowest),
    )


def coordinates(n: int) -> np.ndarray:
    return np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1).astype(float)


def edge_uses(faces: np.ndarray) -> Counter[tuple[int, int]]:
    return Counter((int(a), int(b)) for face in faces for a, b in zip(face, np.roll(face, -1), strict=True))


def is_closed(faces: np.ndarray) -> bool:
    """Whether every edge is walked exactly once in each direction."""
    uses = edge_uses(faces)
    return all(count == 1 and uses[b, a] == 1 for (a, b), count in uses.items())


@pytest.mark.parametrize("case", range(256))
def test_each_case_uses_exactly_the_edges_that_change_sign(case: int) -> None:
    used = {int(edge) for triangle in triangle_table()[case] for edge in triangle if edge >= 0}
    crossed = {edge for edge, (a, b) in enumerate(edge_corners()) if (case >> a & 1) != (case >> b & 1)}
    assert used == crossed


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_any_field_gives_a_closed_surface_across_blocks(seed: int) -> None:
    dense = np.random.default_rng(seed).normal(size=(16, 16, 24))
    for axis in range(3):  # outside all around
        np.moveaxis(dense, axis, 0)[[0, -1]] = 1.0
    _, faces, _, _ = marched(dense)
    assert len(faces) > 5000
    assert is_closed(faces)


def test_a_level_equal_to_samples_leaves_no_hole_and_no_degenerate_triangle() -> None:
    dense = np.abs(coordinates(16) - 8).max(axis=-1) - 4  # a cube whose sides lie on samples
    vertices, faces, _, _ = marched(dense)
    assert is_closed(faces)
    corners = vertices[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    assert area.min() > 0


def test_a_sphere_has_its_area_and_volume_and_looks_outwards() -> None:
    centre = np.array([12.3, 11.9, 12.1])
    vertices, faces, _, _ = marched(np.linalg.norm(coordinates(24) - centre, axis=-1) - 8)
    corners = vertices[faces] - centre
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert is_closed(faces)
    assert (cross * corners.mean(axis=1)).sum(axis=1).min() > 0
    assert np.linalg.norm(cross, axis=1).sum() / 2 == pytest.approx(4 * np.pi * 64, rel=0.01)
    assert np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6 == pytest.approx(
        4 / 3 * np.pi * 512, rel=0.01
    )


def test_vertices_lie_where_scikit_image_puts_them() -> None:
    rng = np.random.default_rng(4)
    smooth = sum(
        rng.normal() * np.sin(coordinates(16) @ rng.uniform(-0.5, 0.5, 3) + rng.uniform(0, 6)) for _ in range(6)
    )
    vertices, *_ = marched(np.asarray(smooth))
    theirs, *_ = skimage_marching_cubes(np.asarray(smooth, np.float32), 0.0)
    assert len(vertices) == len(np.unique(np.round(theirs, 4), axis=0))
    order, their_order = (np.lexsort(np.round(points, 2).T) for points in (vertices, theirs))
    assert np.abs(vertices[order] - theirs[their_order]).max() < 2e-3


def test_no_face_touches_a_sample_without_a_value() -> None:
    dense = coordinates(16)[..., 2] - 7.4
    dense[5, 6, 7] = np.nan
    vertices, faces, _, _ = marched(dense)
    corners = vertices[faces].mean(axis=1)
    hole = (np.abs(corners[:, 0] - 5) < 1) & (np.abs(corners[:, 1] - 6) < 1)
    assert not hole.any()
    assert len(faces) == 2 * (15 * 15 - 4)


def test_normals_and_colours_are_mixed_as_the_distance_is() -> None:
    dense = coordinates(16)[..., 2] - 7.25
    gradient = np.zeros((16, 16, 16, 3))
    gradient[..., 0] = coordinates(16)[..., 2] >= 8
    gradient[..., 2] = coordinates(16)[..., 2] < 8
    colour = np.repeat(10.0 * coordinates(16)[..., 2:], 3, axis=-1)
    vertices, _, normals, colours = marched(dense, gradient, colour)
    assert np.allclose(vertices[:, 2], 7.25)
    assert np.allclose(normals, np.array([0.25, 0, 0.75]) / np.hypot(0.25, 0.75), atol=1e-6)
    assert (colours == 73).all()  # 72.5, rounded half up


def test_opposite_directions_leave_a_unit_normal() -> None:
    dense = coordinates(8)[..., 2] - 3.5
    gradient = np.zeros((8, 8, 8, 3))
    gradient[..., 2] = np.where(coordinates(8)[..., 2] < 4, 1.0, -1.0)
    *_, normals, _ = marched(dense, gradient)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1)


def test_the_result_does_not_depend_on_the_number_of_threads() -> None:
    dense = np.random.default_rng(0).normal(size=(16, 16, 16))
    several = marched(dense)
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        single = marched(dense)
    finally:
        numba.set_num_threads(threads)
    assert all(np.array_equal(a, b) for a, b in zip(several, single, strict=True))
