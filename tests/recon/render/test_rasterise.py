"""The software rasteriser covers every sample once, shows the nearest face, and does so for any number of threads."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from recon.render.heights import triangle_heights
from recon.render.rasterise import SAMPLE_X, SAMPLE_Y, SUBPIXELS, draw_model

NOTHING, ON_AN_EDGE = -1, -2
BRIGHT = 252  # a multiple of four: coverage by n samples is exactly 63 n


def drawn(
    points: NDArray[np.float32],
    faces: NDArray[np.int32],
    colours: NDArray[np.uint8] | None = None,
    *,
    back: NDArray[np.uint8] | None = None,
    shape: tuple[int, int] = (32, 40),
    threads: int = 1,
) -> NDArray[np.uint8]:
    picture = np.zeros((*shape, 3), dtype=np.uint8)
    colours = np.full((len(points), 3), BRIGHT, dtype=np.uint8) if colours is None else colours
    draw_model(picture, points, faces, colours, colours if back is None else back, threads=threads)
    return picture


def sheet(seed: int, n: int, *, grid: float) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """A triangulated sheet over the picture and beyond, its corners on multiples of `grid` pixels."""
    rng = np.random.default_rng(seed)
    corners = np.array([[-9, -9], [49, -9], [-9, 41], [49, 41]])
    plane = np.unique(np.concatenate([corners, np.round(rng.uniform(-8, 40, (n, 2)) / grid) * grid]), axis=0)
    faces = Delaunay(plane).simplices.astype(np.int32)
    depth = rng.uniform(900, 1100, len(plane))
    return np.column_stack([plane, depth]).astype(np.float32), faces


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(5, 120), grid=st.sampled_from([1.0, 0.5, 0.125, 1 / 256]))
def test_neighbouring_faces_cover_every_sample_exactly_once(seed: int, n: int, grid: float) -> None:
    points, faces = sheet(seed, n, grid=grid)
    assert (drawn(points, faces) == BRIGHT).all()
    alone = np.sum([drawn(points, face[None]) for face in faces], axis=0, dtype=np.int64)
    assert (alone == BRIGHT).all()


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_picture_is_that_of_a_slow_ray_caster(seed: int) -> None:
    rng = np.random.default_rng(seed)
    places = np.column_stack([rng.uniform(-4, 20, 18), rng.uniform(-4, 16, 18), rng.uniform(500, 3000, 18)])
    points = (np.round(places * SUBPIXELS) / SUBPIXELS).astype(np.float32)
    faces = np.arange(18, dtype=np.int32).reshape(6, 3)
    front, back = rng.integers(0, 256, (2, 18, 3)).astype(np.uint8)
    picture = drawn(points, faces, front, back=back, shape=(12, 16))
    assert np.nanmax(np.abs(picture - ray_cast(points, faces, front, back, (12, 16)))) <= 1


def ray_cast(
    points: NDArray[np.float32],
    faces: NDArray[np.int32],
    front: NDArray[np.uint8],
    back: NDArray[np.uint8],
    shape: tuple[int, int],
) -> NDArray[np.float64]:
    """Sample by sample and face by face: the same picture, slowly; NaN where a sample lies on an edge."""
    picture = np.zeros((*shape, 3))
    for y in range(shape[0]):
        for x in range(shape[1]):
            places = [(x + dx / SUBPIXELS, y + dy / SUBPIXELS) for dx, dy in zip(SAMPLE_X, SAMPLE_Y, strict=True)]
            seen = [nearest_face(points, faces, place) for place in places]
            if ON_AN_EDGE in seen:
                picture[y, x] = np.nan
            for face in set(seen) - {NOTHING, ON_AN_EDGE}:
                middle = np.mean([place for place, other in zip(places, seen, strict=True) if other == face], axis=0)
                weights = weights_at(points[faces[face]], middle)
                through = weights / points[faces[face], 2]
                a, b, c = points[faces[face], :2].astype(float)
                is_front = np.linalg.det([b - a, c - a]) < 0
                colours = (front if is_front else back)[faces[face]]
                picture[y, x] += seen.count(face) / 4 * (through / through.sum() @ colours)
    return np.rint(picture)


def nearest_face(points: NDArray[np.float32], faces: NDArray[np.int32], place: tuple[float, float]) -> int:
    best, found = 0.0, NOTHING
    for number, face in enumerate(faces):
        weights = weights_at(points[face], np.array(place))
        if np.abs(weights).min() < 1e-9:
            return ON_AN_EDGE
        inverse_depth = float(weights @ (1 / points[face, 2]))
        if (weights > 0).all() and inverse_depth > best:
            best, found = inverse_depth, number
    return found


def weights_at(corners: NDArray[np.float32], place: NDArray[np.float64]) -> NDArray[np.float64]:
    system = np.vstack([corners[:, :2].T.astype(float), np.ones(3)])
    return np.asarray(np.linalg.solve(system, [*place, 1]))


@pytest.mark.parametrize("threads", [2, 3, 7])
def test_the_picture_is_the_same_bit_by_bit_for_any_number_of_threads(threads: int) -> None:
    rng = np.random.default_rng(5)
    middles = rng.uniform([0, 0, 900], [300, 200, 1100], (4000, 1, 3))
    points = (middles + rng.normal(0, 6, (4000, 3, 3))).reshape(-1, 3).astype(np.float32)
    faces = np.arange(len(points), dtype=np.int32).reshape(-1, 3)
    colours = rng.integers(0, 256, points.shape).astype(np.uint8)
    one, several = (drawn(points, faces, colours, shape=(200, 300), threads=n) for n in (1, threads))
    assert np.array_equal(one, several)


def test_either_side_of_a_face_shows_its_own_colour() -> None:
    points = np.array([[2, 2, 100], [30, 2, 100], [2, 28, 100]], dtype=np.float32)  # clockwise in the picture: front
    front, back = np.full((3, 3), 40, np.uint8), np.full((3, 3), 200, np.uint8)
    for order, expected in (((0, 2, 1), 40), ((0, 1, 2), 200)):
        faces = np.array([order], dtype=np.int32)
        assert drawn(points, faces, front, back=back)[8, 8, 0] == expected


def test_a_face_that_reaches_behind_the_camera_is_left_out() -> None:
    points = np.array([[2, 2, 100], [30, 2, -5], [2, 28, 100]], dtype=np.float32)
    assert not drawn(points, np.array([[0, 1, 2]], dtype=np.int32)).any()


def test_faces_without_area_or_far_outside_draw_nothing() -> None:
    points = np.array([[2, 2, 9], [12, 12, 9], [22, 22, 9], [1e9, 0, 9], [1e9, 8, 9], [2e9, 4, 9]], dtype=np.float32)
    assert not drawn(points, np.array([[0, 1, 2], [0, 0, 1], [3, 4, 5]], dtype=np.int32)).any()


def test_heights_are_those_of_the_lowest_surface() -> None:
    corners = np.array([[-5, -5], [60, -5], [-5, 60]])
    plane = corners @ [0.5, -0.25] + 100
    points = np.concatenate([np.column_stack([corners, plane]), np.column_stack([corners, plane + 7])])
    faces = np.array([[3, 4, 5], [0, 1, 2]], dtype=np.int32)
    heights = triangle_heights(points.astype(np.float32), faces, (20, 24))
    y, x = np.mgrid[0:20, 0:24]
    np.testing.assert_allclose(heights, 0.5 * x - 0.25 * y + 100, atol=1e-3)
    assert np.isinf(triangle_heights(points.astype(np.float32), faces[:0], (4, 4))).all()
