"""Either renderer shows the captured colours where they belong, before the same background."""

from __future__ import annotations

from collections.abc import Iterator
from copy import deepcopy

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from recon.geometry.mesh import Mesh, Texture
from recon.geometry.rig import Camera, Rig, Sensor, look_at
from recon.render import offscreen
from recon.render.backdrop import backdrop, floor_shade
from recon.render.camera_path import camera_path
from recon.render.frames import (
    RENDERERS,
    choose_renderer,
    describe_renderer,
    render_frames,
    render_masked_frames,
    software_frames,
)
from recon.render.light import lit, lit_mesh
from recon.render.offscreen import NoRendererError, working_platform
from recon.render.scene import BACKGROUNDS, Scene, Shot, scene_around

BOUNDS = np.array([[-300.0, 0.0, -300.0], [300.0, 600.0, 300.0]])
CENTRE = BOUNDS.mean(axis=0)
SIZE = (192, 128)


@pytest.fixture(scope="module", params=list(RENDERERS))
def renderer(request: pytest.FixtureRequest) -> str:
    if request.param == "pyrender":
        need_opengl()
    return str(request.param)


def need_opengl() -> None:
    try:
        working_platform()
    except NoRendererError as error:
        pytest.skip(str(error))


def cameras(n: int = 3, size: tuple[int, int] = SIZE) -> tuple[Camera, ...]:
    K = np.array([[500.0, 0, 95.5], [0, 500.0, 63.5], [0, 0, 1]])
    sensors = []
    for number, azimuth in enumerate(np.deg2rad([-40, 0, 40])):
        place = CENTRE + np.array([1500 * np.sin(azimuth), 500, 1500 * np.cos(azimuth)])
        aside = 40 * np.array([np.cos(azimuth), 0, -np.sin(azimuth)])
        left, right = (Camera(K, SIZE, look_at(place + way * aside, CENTRE)) for way in (-1, 1))
        sensors.append(Sensor(f"S{number + 1}", left, right))
    return camera_path(Rig(tuple(sensors)), BOUNDS, n, size)


def coloured(body: trimesh.Trimesh, seed: int = 1) -> Mesh:
    """A body in smooth colours."""
    rng = np.random.default_rng(seed)
    waves = np.sin(body.vertices @ rng.normal(0, 0.01, (3, 3)))
    return Mesh(
        body.vertices.astype(np.float32),
        body.faces.astype(np.int32),
        body.vertex_normals.astype(np.float32),
        (150 + 80 * waves).astype(np.uint8),
    )


def ball(radius: float = 280.0, subdivisions: int = 4) -> Mesh:
    body = trimesh.creation.icosphere(subdivisions, radius)
    body.apply_translation((0, radius, 0))
    return coloured(body)


def uniform(mesh: Mesh, colour: tuple[int, int, int]) -> Mesh:
    return Mesh(mesh.vertices, mesh.faces, mesh.normals, np.full(mesh.vertices.shape, colour, dtype=np.uint8))


def picture(mesh: Mesh, background: str, renderer: str, size: tuple[int, int] = SIZE) -> NDArray[np.uint8]:
    path = cameras(3, size)
    scene = scene_around(BOUNDS, path, background)
    return next(render_frames([mesh], path[1:2], scene, renderer=renderer))


@pytest.mark.slow
@pytest.mark.parametrize("colour", [(200, 120, 60), (3, 250, 128), (255, 255, 255)])
def test_a_fully_ambient_render_returns_the_captured_colours(renderer: str, colour: tuple[int, int, int]) -> None:
    shown = picture(uniform(ball(), colour), "plain", renderer)
    assert np.abs(shown[64, 96].astype(int) - colour).max() <= 2
    assert shown[0, 0].tolist() == [128, 128, 128]


@pytest.mark.slow
def test_a_mask_marks_the_pixels_that_show_the_model(renderer: str) -> None:
    path = cameras(3)
    scene = scene_around(BOUNDS, path, "plain")
    shown = list(render_masked_frames([uniform(ball(), (200, 120, 60))] * 3, path, scene, renderer=renderer))
    for drawn, mask in shown:
        assert (mask == (drawn != 128).any(axis=2)).all(), "the plain background is grey throughout"
        assert 0.05 < mask.mean() < 0.9


@pytest.mark.slow
def test_a_shadow_is_not_in_the_mask() -> None:
    path = cameras(1)
    scene = scene_around(BOUNDS, path, "studio")
    ((drawn, mask),) = render_masked_frames([ball()], path, scene, renderer="software")
    unshaded = backdrop(scene, path[0], np.zeros((2, 2), np.float32))
    shadow = (unshaded.astype(int) - drawn).min(axis=2) > 20
    assert (shadow & ~mask).sum() > 50


@pytest.mark.slow
def test_a_vertex_is_shown_where_the_camera_projects_it(renderer: str) -> None:
    path = cameras()
    for offset in ((0, 0, 0), (113, 57, -90), (-201, -140, 150)):
        body = trimesh.creation.icosphere(3, 40)
        body.apply_translation(CENTRE + offset)
        white = uniform(coloured(body), (255, 255, 255))
        shown = next(render_frames([white], path[:1], scene_around(BOUNDS, path, "plain"), renderer=renderer))
        light = shown[..., 0].astype(float) - 128
        rows, columns = np.mgrid[0 : SIZE[1], 0 : SIZE[0]]
        middle = np.array([(light * columns).sum(), (light * rows).sum()]) / light.sum()
        np.testing.assert_allclose(middle, path[0].project((CENTRE + offset)[None])[0], atol=0.12)


@pytest.mark.slow
def test_the_two_renderers_show_the_same_picture() -> None:
    need_opengl()
    shown = [(ball(), background) for background in BACKGROUNDS]
    for mesh, background in (*shown, (floor(1, is_textured=True), "plain")):
        ours, theirs = (picture(mesh, background, name).astype(int) for name in ("software", "pyrender"))
        difference = np.abs(ours - theirs).max(axis=2)
        assert difference.mean() < 0.2
        assert (difference > 2).mean() < 0.01  # only on outlines, where samples lie elsewhere in a pixel


@pytest.mark.slow
def test_the_inside_of_an_open_surface_is_seen_and_darker_than_its_outside(renderer: str) -> None:
    whole = uniform(ball(), (180, 180, 180))
    towards_camera = whole.normals[whole.faces].mean(axis=1)[:, 2]
    bowl = Mesh(whole.vertices, whole.faces[towards_camera < 0], whole.normals, whole.colours)
    outside, inside = (picture(mesh, "studio", renderer)[64, 96].astype(int) for mesh in (whole, bowl))
    assert (inside > 60).all()
    assert (inside < outside).all()


@pytest.mark.slow
def test_light_never_makes_a_captured_colour_brighter_and_leaves_its_hue() -> None:
    mesh = uniform(ball(), (200, 120, 60))
    scene = scene_around(BOUNDS, cameras())
    model = lit_mesh(mesh, scene)
    for side in (model.front, model.back):
        assert (side <= mesh.colours).all()
        ratio = side / mesh.colours
        assert np.ptp(ratio, axis=1).max() < 0.012
        assert ratio.min() > 0.6
    brightest = int(model.front[:, 0].argmax())
    assert mesh.normals[brightest] @ scene.to_light > 0.8


def test_a_surface_does_not_shade_itself_but_what_lies_behind_it() -> None:
    scene = scene_around(BOUNDS, cameras())
    near, far = trimesh.creation.icosphere(3, 60), trimesh.creation.icosphere(3, 60)
    near.apply_translation(CENTRE + scene.to_light * 200)
    far.apply_translation(CENTRE - scene.to_light * 100)
    both = uniform(coloured(trimesh.util.concatenate([near, far])), (200, 200, 200))
    facing = both.normals @ scene.to_light > 0.5
    front = lit_mesh(both, scene).front[:, 0].astype(int)
    half = len(near.vertices)
    assert front[:half][facing[:half]].min() > 170
    assert front[half:][facing[half:]].max() < front[:half][facing[:half]].min()


@pytest.mark.slow
def test_the_floor_is_darkest_where_the_model_touches_it(renderer: str) -> None:
    body = trimesh.creation.icosphere(3, 60)
    body.apply_translation((0, 60, 0))
    mesh, path = coloured(body), cameras()
    scene = scene_around(BOUNDS, path)
    with_model = next(render_frames([mesh], path[1:2], scene, renderer=renderer)).astype(int)
    lifted = Mesh(mesh.vertices + np.array([0, 500, 0], np.float32), mesh.faces, mesh.normals, mesh.colours)
    without = next(render_frames([lifted], path[1:2], scene, renderer=renderer)).astype(int)
    column, row = path[1].project(np.array([[10.0, 0.0, 70.0]]))[0].round().astype(int)  # just before the contact
    assert without[row, column, 0] - with_model[row, column, 0] >= 6
    assert np.abs(without[-1] - with_model[-1]).max() <= 12


def test_the_shadow_on_the_floor_lies_away_from_the_light_and_ends_before_the_map_does() -> None:
    scene = scene_around(BOUNDS, cameras())
    body = trimesh.creation.box((40, 600, 40))
    body.apply_translation((0, 300, 0))
    shade = floor_shade(coloured(body), scene)
    grid = scene.floor_grid(np.array([0.0, 1.0, 0.0]))
    z, x = np.mgrid[0 : shade.shape[0], 0 : shade.shape[1]] * grid.texel - scene.floor_reach
    middle = np.array([(shade * x).sum(), (shade * z).sum()]) / shade.sum()
    along = scene.to_light[[0, 2]] / np.linalg.norm(scene.to_light[[0, 2]])
    assert middle @ along < -100
    assert abs(middle @ [-along[1], along[0]]) < 10
    foot = np.unravel_index(shade.argmax(), shade.shape)
    assert max(abs(x[foot]), abs(z[foot])) < 50
    border = np.concatenate([shade[[0, -1]].ravel(), shade[:, [0, -1]].ravel()])
    assert not border.any()


def test_a_part_of_the_path_shows_what_the_whole_path_showed() -> None:
    path = cameras(6)
    scene = scene_around(BOUNDS, path)
    whole = [frame.copy() for frame in render_frames([ball()] * 6, path, scene, renderer="software")]
    part = [frame.copy() for frame in render_frames([ball()] * 3, path[3:], scene, renderer="software")]
    assert all(np.array_equal(a, b) for a, b in zip(whole[3:], part, strict=True))


def test_frames_are_the_same_bit_by_bit_for_any_number_of_threads() -> None:
    path = cameras(2, (320, 200))
    scene = scene_around(BOUNDS, path)
    one, three = (
        [frame.copy() for frame in render_frames([ball()] * 2, path, scene, renderer="software", threads=threads)]
        for threads in (1, 3)
    )
    assert np.array_equal(one, three)


def test_meshes_may_come_in_turn_or_by_number() -> None:
    path = cameras(3)
    scene = scene_around(BOUNDS, path, "plain")
    models = [ball(100 + 60 * k) for k in range(3)]
    in_turn = [frame.copy() for frame in render_frames(iter(models), path, scene, renderer="software")]
    by_number = [frame.copy() for frame in render_frames(lambda k: models[k], path, scene, renderer="software")]
    assert np.array_equal(in_turn, by_number)
    assert not np.array_equal(in_turn[0], in_turn[2])


def test_the_renderer_is_chosen_once_and_named() -> None:
    assert choose_renderer("software") == describe_renderer("software") == "software"
    assert choose_renderer("auto") in RENDERERS
    with pytest.raises(ValueError, match="no renderer 'vulkan'; expected auto or one of pyrender, software"):
        choose_renderer("vulkan")


def test_a_mesh_without_faces_is_named_by_its_frame() -> None:
    path, mesh = cameras(2), ball(100, 1)
    empty = Mesh(mesh.vertices, mesh.faces[:0], mesh.normals, mesh.colours)
    with pytest.raises(ValueError, match="frame 1: a mesh of 42 vertices has no faces"):
        list(render_frames([mesh, empty], path, scene_around(BOUNDS, path), renderer="software"))


def test_meshes_that_end_early_and_unknown_backgrounds_are_refused() -> None:
    path = cameras(3)
    with pytest.raises(ValueError, match="ended after 2 of 3 frames"):
        list(render_frames([ball()] * 2, path, scene_around(BOUNDS, path), renderer="software"))
    with pytest.raises(ValueError, match="no background 'beach'; expected one of studio"):
        scene_around(BOUNDS, path, "beach")
    with pytest.raises(ValueError, match="needs the cameras"):
        scene_around(BOUNDS, ())


def test_without_opengl_the_error_names_the_packages_and_auto_does_without(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(offscreen, "PROBE", "raise ImportError('Unable to load EGL library')")
    monkeypatch.delenv("PYOPENGL_PLATFORM", raising=False)
    working_platform.cache_clear()
    try:
        with pytest.raises(NoRendererError, match=r"Unable to load EGL.*libegl1.*libosmesa6.*software renderer"):
            choose_renderer("pyrender")
        assert choose_renderer("auto") == "software"
    finally:
        working_platform.cache_clear()


@pytest.mark.slow
def test_pyrender_can_be_started_again_after_it_was_closed() -> None:
    need_opengl()
    first, again = (picture(ball(), "studio", "pyrender") for _ in range(2))
    assert np.array_equal(first, again)


@pytest.mark.slow
def test_memory_does_not_grow_with_frames(renderer: str) -> None:
    path = cameras(1)
    scene = scene_around(BOUNDS, path)
    body = ball(150, 5)

    def models(n: int) -> Iterator[Mesh]:
        for _ in range(n):
            yield deepcopy(body)

    def used_mib(n: int) -> float:
        for _ in render_frames(models(n), path * n, scene, renderer=renderer):
            pass
        with open("/proc/self/statm") as file:  # noqa: PTH123  # not a file on disk
            return int(file.read().split()[1]) * 4096 / 2**20

    used_mib(30)  # until allocators and drivers have what they keep
    before = used_mib(10)
    assert used_mib(90) - before < 30  # keeping every mesh would take 60 MiB


def test_a_mesh_around_the_camera_is_drawn_as_far_as_it_lies_before_it() -> None:
    path = cameras(1)
    body = trimesh.creation.icosphere(5, 400)
    body.apply_translation(path[0].centre)
    body.vertices[0] = path[0].centre + path[0].rotation[0] * 50  # beside the camera, at no depth at all
    scene = scene_around(BOUNDS, path, "plain")
    shown = next(render_frames([uniform(coloured(body), (200, 20, 20))], path, scene, renderer="software"))
    assert (shown == (200, 20, 20)).all()


@pytest.mark.parametrize("is_textured", [False, True])
def test_a_face_that_reaches_behind_the_camera_is_drawn_as_its_pieces_before_it_are(is_textured: bool) -> None:
    path = cameras()
    coarse, fine = (floor(n, is_textured=is_textured) for n in (1, 400))
    scene = scene_around(BOUNDS, path, "plain")
    for camera in path:
        assert camera.points_in_camera(coarse.vertices)[:, 2].min() < 0
        drawn, expected = (next(render_frames([mesh], [camera], scene, renderer="software")) for mesh in (coarse, fine))
        difference = np.abs(drawn.astype(int) - expected).max(axis=2)
        assert (drawn[-1] != 128).any(axis=1).all()  # the floor reaches the picture's lower edge
        assert (difference > 2).mean() < 0.005
        assert difference.mean() < 0.5  # the fine floor's colours are whole numbers at more places


def floor(n: int, *, is_textured: bool) -> Mesh:
    """A square floor of n x n squares, 8 m wide, in colours that grow from side to side."""
    across = np.linspace(0, 1, n + 1)
    u, v = (grid.ravel() for grid in np.meshgrid(across, across))
    vertices = np.column_stack([8000 * u - 4000, np.ones(len(u)), 8000 * v - 4000]).astype(np.float32)
    corner = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    faces = np.concatenate([corner[:, None] + [0, n + 1, 1], corner[:, None] + [1, n + 1, n + 2]]).astype(np.int32)
    colours = np.rint(np.column_stack([255 * u, 255 * v, 0 * u])).astype(np.uint8)
    pixels = np.zeros((64, 64, 3), np.uint8)
    pixels[..., 0], pixels[..., 1] = np.arange(64) * 4, np.arange(64)[:, None] * 4
    texture = Texture(pixels, np.column_stack([u, v]) * 0.9 + 0.05) if is_textured else None
    return Mesh(vertices, faces, np.tile(np.float32([0, 1, 0]), (len(u), 1)), colours, texture)


def test_a_shot_is_drawn_over_its_picture() -> None:
    path = cameras(1)
    scene: Scene = scene_around(BOUNDS, path, "plain")
    canvas = np.full((*SIZE[::-1], 3), 7, dtype=np.uint8)
    shown = next(software_frames([Shot(lit(ball(100), scene), path[0], canvas)]))
    assert shown is canvas
    assert (canvas[0, 0] == 7).all()
