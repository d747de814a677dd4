"""Points are round discs of one size in mm: seen at any distance, nearest first, lit and casting shadows as a mesh."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from recon.geometry.mesh import Cloud, Discs, Mesh
from recon.geometry.rig import Camera, look_at
from recon.render.backdrop import floor_shade
from recon.render.discs import LEAST_RADIUS, draw_discs
from recon.render.frames import RENDERERS, render_frames
from recon.render.heights import disc_heights
from recon.render.light import lit_discs, lit_mesh
from recon.render.rasterise import SAMPLE_X, SAMPLE_Y, SUBPIXELS
from recon.render.scene import BACKGROUNDS, scene_around
from tests.recon.render.test_frames import BOUNDS, CENTRE, ball, cameras, need_opengl

SAMPLES = np.stack([SAMPLE_X, SAMPLE_Y], axis=1) / SUBPIXELS
WHITE = np.full((1, 3), 252, np.uint8)  # a multiple of four: coverage by n samples is exactly 63 n


@pytest.fixture(scope="module", params=[name for name in RENDERERS if name != "gsplat"])
def renderer(request: pytest.FixtureRequest) -> str:
    if request.param == "pyrender":
        need_opengl()
    return str(request.param)


def drawn(
    points: NDArray[np.floating], colours: NDArray[np.uint8], reach: tuple[float, float], *, threads: int = 1
) -> NDArray[np.uint8]:
    picture = np.zeros((20, 24, 3), np.uint8)
    draw_discs(picture, np.asarray(points, np.float32), colours, reach, threads=threads)
    return picture


def discs_of(mesh: Mesh, radius_mm: float) -> Discs:
    return Discs(Cloud(mesh.vertices, mesh.normals, mesh.colours), radius_mm)


def single(colour: tuple[int, int, int], place: NDArray[np.floating], radius_mm: float) -> Discs:
    return Discs(Cloud(place[None], np.array([[0.0, 0.0, 1.0]]), np.array([colour], np.uint8)), radius_mm)


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 60))
def test_the_picture_is_that_of_a_slow_sampler(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform([-4, -4, 500], [28, 24, 2000], (n, 3)).astype(np.float32)
    points[n // 2 :, 2] = points[: n - n // 2, 2]  # some are as near as others
    colours = rng.integers(0, 256, (n, 3), dtype=np.uint8)
    reach = tuple(rng.uniform(200, 3000, 2))
    expected = np.zeros((20, 24, 3))
    on_an_edge = np.zeros((20, 24), bool)
    for y, x in np.ndindex(20, 24):
        for place in SAMPLES + np.array([x, y]):
            radii = np.maximum(np.array(reach) / points[:, 2:], LEAST_RADIUS)
            distance = np.linalg.norm((place - points[:, :2]) / radii, axis=1)
            on_an_edge[y, x] |= (np.abs(distance - 1) < 1e-4).any()
            covering = np.flatnonzero(distance <= 1)
            if len(covering):
                expected[y, x] += colours[covering[points[covering, 2].argmin()]] / len(SAMPLES)
    difference = np.abs(drawn(points, colours, reach) - expected).max(axis=2)
    assert difference[~on_an_edge].max() <= 0.51


@pytest.mark.slow
@given(x=st.floats(1, 22), y=st.floats(1, 18), depth=st.floats(10, 1e6))
def test_a_disc_is_seen_however_far_it_is(x: float, y: float, depth: float) -> None:
    assert drawn(np.array([[x, y, depth]]), WHITE, (1e-3, 1e-3)).any()


@pytest.mark.parametrize("radius", [1.0, 2.5, 7.0])
def test_a_disc_covers_the_area_of_a_circle(radius: float) -> None:
    places = np.random.default_rng(1).uniform([9, 9], [12, 12], (60, 2))
    areas = [drawn(np.array([[*place, 100.0]]), WHITE, (100 * radius,) * 2)[..., 0].sum() / 252 for place in places]
    assert np.mean(areas) == pytest.approx(np.pi * radius**2, rel=0.02)


def test_a_disc_behind_the_camera_or_far_outside_draws_nothing() -> None:
    points = np.array([[9, 9, -5], [9, 9, 0], [1e12, 9, 5], [np.nan, 9, 5], [900, 9, 5]])
    assert not drawn(points, np.repeat(WHITE, 5, axis=0), (10.0, 10.0)).any()


@pytest.mark.parametrize("threads", [2, 3, 7])
def test_the_picture_is_the_same_bit_by_bit_for_any_number_of_threads(threads: int) -> None:
    rng = np.random.default_rng(5)
    points = rng.uniform([-4, -4, 500], [28, 24, 600], (500, 3))
    colours = rng.integers(0, 256, (500, 3), dtype=np.uint8)
    alone, together = (drawn(points, colours, (900.0, 1100.0), threads=n) for n in (1, threads))
    assert np.array_equal(alone, together)


@pytest.mark.slow
def test_a_disc_has_its_size_in_mm_at_any_distance_and_is_round(renderer: str) -> None:
    K = np.array([[400.0, 0, 63.5], [0, 400.0, 47.5], [0, 0, 1]])
    for distance in (1000.0, 2000.0):
        camera = Camera(K, (128, 96), look_at(CENTRE + np.array([0, 0, distance]), CENTRE))
        model = single((252, 252, 252), CENTRE, 60.0)
        frame = next(render_frames([model], [camera], scene_around(BOUNDS, [camera], "plain"), renderer=renderer))
        light = (frame[..., 0].astype(float) - 128) / (252 - 128)
        radius = 400 * 60 / distance
        assert light.sum() == pytest.approx(np.pi * radius**2, rel=0.02)
        rows, columns = np.mgrid[0:96, 0:128] - np.array([47.5, 63.5])[:, None, None]
        distances = np.hypot(rows, columns)
        assert light[distances > 1.06 * radius + 1].max() == 0  # the corners of pyrender's polygons reach farthest
        assert light[distances < 0.97 * radius - 1].min() == 1


@pytest.mark.slow
def test_the_two_renderers_show_the_same_discs() -> None:
    need_opengl()
    path, mesh = cameras(), ball(subdivisions=5)
    for background in BACKGROUNDS:
        scene = scene_around(BOUNDS, path, background)
        ours, theirs = (
            next(render_frames([discs_of(mesh, 12.0)], path[1:2], scene, renderer=name)).astype(int)
            for name in ("software", "pyrender")
        )
        difference = np.abs(ours - theirs).max(axis=2)
        assert difference.mean() < 0.3
        assert (difference > 4).mean() < 0.02  # at edges of discs, which pyrender draws with corners


def test_discs_are_lit_and_shaded_as_the_mesh_whose_vertices_they_are() -> None:
    mesh, scene = ball(subdivisions=5), scene_around(BOUNDS, cameras())
    for radius in (6.0, 12.0):
        difference = lit_mesh(mesh, scene).front.astype(int) - lit_discs(discs_of(mesh, radius), scene).colours
        assert np.abs(difference).max() <= 1
    shade, discs_shade = floor_shade(mesh, scene), floor_shade(discs_of(mesh, 6.0), scene)
    assert np.abs(shade - discs_shade).max() < 0.1 * shade.max()  # discs reach beyond the outline by their radius
    assert np.abs(shade - discs_shade).mean() < 0.05 * shade.mean()


def test_a_disc_shades_what_lies_behind_it() -> None:
    scene = scene_around(BOUNDS, cameras())
    behind = CENTRE - scene.to_light * 150
    place = np.array([behind, CENTRE, behind + np.cross(scene.to_light, [0, 1, 0]) * 80])
    model = Discs(Cloud(place, np.tile(scene.to_light, (3, 1)), np.full((3, 3), 200, np.uint8)), 20.0)
    shaded, shading, beside = lit_discs(model, scene).colours[:, 0].astype(int)
    assert shaded < 0.85 * shading
    assert beside == shading


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), radius=st.floats(0.1, 5))
def test_heights_of_discs_are_those_of_a_slow_search(seed: int, radius: float) -> None:
    points = np.random.default_rng(seed).uniform([-3, -3, 0], [15, 13, 9], (20, 3)).astype(np.float32)
    heights = disc_heights(points, radius, (10, 12))
    for y, x in np.ndindex(10, 12):
        distance = np.hypot(*(points[:, :2] - [x, y]).T)
        inner, outer = (
            points[distance <= max(radius, np.sqrt(0.5)) + margin, 2].min(initial=np.inf) for margin in (-1e-4, 1e-4)
        )
        assert outer <= heights[y, x] <= inner


def test_a_cloud_without_points_is_named_by_its_frame() -> None:
    path, model = cameras(2), discs_of(ball(subdivisions=1), 5.0)
    empty = Discs(model.cloud.select(np.zeros(len(model.cloud), bool)), 5.0)
    with pytest.raises(ValueError, match="frame 1: the cloud has no points"):
        list(render_frames([model, empty], path, scene_around(BOUNDS, path), renderer="software"))


@pytest.mark.slow
def test_a_film_may_show_meshes_and_discs_in_turn(renderer: str) -> None:
    path, mesh = cameras(3), ball()
    scene = scene_around(BOUNDS, path)
    models = [mesh, discs_of(mesh, 12.0), mesh]
    mixed = [frame.copy() for frame in render_frames(models, path, scene, renderer=renderer)]
    for number, model in enumerate(models):
        alone = next(render_frames([model], path[number : number + 1], scene, renderer=renderer))
        assert np.array_equal(mixed[number], alone)
