"""Either renderer shows a texture's colours where the mesh has them, near and far, as it would those of vertices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from recon.geometry.mesh import Mesh, Texture
from recon.geometry.rig import Camera, look_at
from recon.render.frames import RENDERERS, render_frames
from recon.render.rasterise import draw_model
from recon.render.scene import BACKGROUNDS, scene_around
from recon.render.texture import LARGEST_SIDE, drawable, mipmaps
from tests.recon.render.test_frames import BOUNDS, CENTRE, ball, cameras, need_opengl, picture, uniform

FOCAL, DISTANCE = 1000.0, 2000.0


@pytest.fixture(scope="module", params=[name for name in RENDERERS if name != "gsplat"])
def renderer(request: pytest.FixtureRequest) -> str:
    if request.param == "pyrender":
        need_opengl()
    return str(request.param)


def noise(height: int, width: int, seed: int = 0) -> NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def waves(size: int) -> NDArray[np.uint8]:
    """Smooth colours without a seam where the picture repeats."""
    turns = 2 * np.pi * np.arange(size) / size
    red, green = 128 + 100 * np.sin(3 * turns), 128 + 100 * np.cos(2 * turns)
    channels = np.broadcast_arrays(red[None], green[:, None], (red[:, None] + green[None]) / 2)
    return np.rint(np.stack(channels, axis=-1)).astype(np.uint8)


def with_texture(mesh: Mesh, pixels: NDArray[np.uint8], repeats: float = 1.0) -> Mesh:
    """A mesh with a picture wound around it as a cylinder, without a seam: every face has corners of its own."""
    corners = mesh.faces.ravel()
    x, y, z = (mesh.vertices[corners].astype(float) - mesh.vertices.mean(axis=0)).T
    around = (np.arctan2(x, z) / (2 * np.pi)).reshape(-1, 3)
    around -= np.round(around - around[:, :1])
    uv = repeats * np.stack([around.ravel(), y / np.ptp(y)], axis=1)
    return Mesh(
        mesh.vertices[corners],
        np.arange(len(corners)).reshape(-1, 3),
        mesh.normals[corners],
        np.zeros((len(corners), 3), np.uint8),  # never shown
        Texture(pixels, uv.astype(np.float32)),
    )


def wall(pixels: NDArray[np.uint8], scale: float, size: tuple[int, int]) -> tuple[Mesh, Camera]:
    """A triangle before a camera that fills its picture, each texel `scale` pixels wide; the texture's lower left
    corner lies in the picture's."""
    K = np.array([[FOCAL, 0, (size[0] - 1) / 2], [0, FOCAL, (size[1] - 1) / 2], [0, 0, 1]])
    camera = Camera(K, size, look_at(CENTRE + np.array([0, 0, DISTANCE]), CENTRE))
    reach = 2 * np.array(size)
    corners = np.array([[0, 0], [reach[0], 0], [0, reach[1]]])  # pixels from the lower left corner
    vertices = np.column_stack([(corners - np.array(size) / 2) * DISTANCE / FOCAL, np.zeros(3)]) + CENTRE
    uv = corners / (scale * np.array(pixels.shape[1::-1]))
    normals, colours = np.tile([0.0, 0.0, 1.0], (3, 1)), np.zeros((3, 3), np.uint8)
    return Mesh(vertices, np.array([[0, 1, 2]]), normals, colours, Texture(pixels, uv)), camera


def shown(mesh: Mesh, camera: Camera, renderer: str, background: str = "plain") -> NDArray[np.uint8]:
    return next(render_frames([mesh], [camera], scene_around(BOUNDS, [camera], background), renderer=renderer))


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(16, 16), (7, 5), (1, 1), (3, 64)])
def test_without_light_a_texture_shows_its_texels_and_repeats_beyond_its_edges(
    renderer: str, shape: tuple[int, int]
) -> None:
    pixels = noise(*shape)
    for scale, size in ((1, (64, 48)), (3, (63, 48))):
        mesh, camera = wall(pixels, scale, size)
        rows, columns = size[1] // scale, size[0] // scale
        expected = np.tile(pixels, (rows // shape[0] + 1, columns // shape[1] + 1, 1))[-rows:, :columns]
        assert np.array_equal(shown(mesh, camera, renderer)[scale // 2 :: scale, scale // 2 :: scale], expected)


@pytest.mark.slow
def test_a_texture_seen_from_afar_is_averaged_instead_of_flickering(renderer: str) -> None:
    pixels = noise(512, 512)
    for scale in (1 / 8, 1 / 11):
        mesh, camera = wall(pixels, scale, (40, 30))
        far = shown(mesh, camera, renderer).astype(float)
        assert abs(far.mean() - pixels.mean()) < 2
        assert far.std() < 1.3 * pixels.std() * scale / (2 / 3)  # bilinear averages of n texels vary as 1 / sqrt(n)


@pytest.mark.slow
@pytest.mark.parametrize("background", list(BACKGROUNDS))
def test_a_texture_of_one_colour_is_lit_as_vertices_of_that_colour(renderer: str, background: str) -> None:
    for colour in ((200, 120, 60), (255, 255, 255)):
        mesh = uniform(ball(subdivisions=3), colour)
        pixels = np.full((4, 6, 3), colour, np.uint8)
        textured = replace(mesh, texture=Texture(pixels, mesh.vertices[:, :2]))
        difference = picture(mesh, background, renderer).astype(int) - picture(textured, background, renderer)
        assert np.abs(difference).max() <= 1


def test_a_texture_of_the_vertices_colours_gives_the_same_picture() -> None:
    """Colours that are linear in place are the same between vertices and between texels."""
    mesh = ball()
    share = 0.1 + 0.8 * (mesh.vertices - BOUNDS[0]) / (BOUNDS[1] - BOUNDS[0])  # away from where the picture repeats
    ramp = (np.arange(256) + 0.5)[None, :] * 0.9
    pixels = np.stack(np.broadcast_arrays(ramp, ramp[:, ::-1].T, 128.0), axis=-1)
    places = share[:, :2].astype(np.float32)
    colours = 0.9 * 256 * np.column_stack([places, np.full(len(places), 128 / (0.9 * 256))])
    coloured = replace(mesh, colours=np.rint(colours).astype(np.uint8))
    textured = replace(mesh, texture=Texture(np.rint(pixels).astype(np.uint8), places))
    for background in BACKGROUNDS:
        ours, other = (picture(model, background, "software").astype(int) for model in (coloured, textured))
        difference = np.abs(ours - other).max(axis=2)
        assert (
            difference > 2
        ).mean() < 0.001  # on the outline, where a face is so oblique that its texture is averaged
        assert difference.max() <= 10


@pytest.mark.slow
def test_the_two_renderers_show_the_same_texture() -> None:
    need_opengl()
    textures = ((256, 1.0), (100, 2.5), (1024, 4.0))
    for background, (size, repeats) in zip(BACKGROUNDS, textures, strict=True):
        mesh = with_texture(ball(), waves(size), repeats)
        ours, theirs = (picture(mesh, background, name).astype(int) for name in ("software", "pyrender"))
        difference = np.abs(ours - theirs).max(axis=2)
        assert difference.mean() < 0.5
        assert (difference > 4).mean() < 0.025  # on outlines, and where faces are small: a pixel is sampled elsewhere


def test_either_side_of_a_textured_mesh_is_seen_and_lit() -> None:
    mesh, camera = wall(waves(64), 2.0, (40, 30))
    front, back = (
        shown(model, camera, "software", "studio").astype(int)
        for model in (mesh, replace(mesh, faces=mesh.faces[:, ::-1]))
    )
    assert (back <= front).all()
    assert back.mean() < 0.9 * front.mean()


@pytest.mark.parametrize("pixels", [noise(1, 1), noise(1, 9), noise(7, 2), noise(64, 64)], ids=lambda p: str(p.shape))
def test_levels_halve_a_texture_down_to_its_mean(pixels: NDArray[np.uint8]) -> None:
    levels = mipmaps(Texture(pixels, np.zeros((3, 2), np.float32)))
    sizes = levels.levels[:, 1:]
    assert sizes[0].tolist() == list(pixels.shape[:2])
    assert sizes[-1].tolist() == [1, 1]
    assert np.array_equal(sizes[1:], np.maximum(sizes[:-1] // 2, 1))
    assert np.array_equal(levels.texels[: pixels.shape[0] * pixels.shape[1]], pixels.reshape(-1, 3))
    assert len(levels.texels) == sizes.prod(axis=1).sum()
    assert (
        np.abs(levels.texels[-1] - pixels.reshape(-1, 3).mean(axis=0)).max() <= len(sizes) / 2 + 20 * (sizes % 2).any()
    )


def test_a_texture_too_large_for_opengl_is_halved() -> None:
    uv = np.zeros((3, 2), np.float32)
    assert drawable(Texture(noise(5, LARGEST_SIDE + 2), uv)).pixels.shape == (2, LARGEST_SIDE // 2 + 1, 3)
    fits = Texture(noise(5, LARGEST_SIDE), uv)
    assert drawable(fits) is fits


@pytest.mark.parametrize("threads", [2, 5])
def test_a_textured_picture_is_the_same_bit_by_bit_for_any_number_of_threads(threads: int) -> None:
    path, mesh = cameras(1, (320, 200)), with_texture(ball(), noise(100, 64), 3.0)
    scene = scene_around(BOUNDS, path)
    alone, together = (next(render_frames([mesh], path, scene, renderer="software", threads=n)) for n in (1, threads))
    assert np.array_equal(alone, together)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), size=st.sampled_from([(1, 1), (8, 8), (5, 13), (300, 200)]))
def test_texels_are_those_of_a_slow_sampler(seed: int, size: tuple[int, int]) -> None:
    """A face that covers the whole picture, sampled at each pixel's centre with derivatives by differences."""
    rng = np.random.default_rng(seed)
    outline = np.array([[-40, -40], [90, -30], [-30, 95]]) + rng.integers(-9, 10, (3, 2))
    points = np.column_stack([outline, rng.uniform(500, 2000, 3)]).astype(np.float32)
    uv = rng.uniform(-3, 3, (3, 2)).astype(np.float32)
    texture = Texture(noise(*size, seed=seed % 1000), uv)
    drawn = np.zeros((12, 16, 3), np.uint8)
    white = np.full((3, 3), 255, np.uint8)
    draw_model(drawn, points, np.array([[0, 1, 2]], np.int32), white, white, texture=mipmaps(texture))
    y, x = np.mgrid[0:12, 0:16].astype(float)

    def places(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        edges = np.linalg.inv(np.vstack([points[:, :2].T.astype(float), np.ones(3)]))
        through = np.stack([x, y, np.ones_like(x)], axis=-1) @ edges.T / points[:, 2]
        return np.asarray(through / through.sum(axis=-1, keepdims=True) @ uv)

    step = 1e-4
    across = (places(x + step, y) - places(x - step, y)) / (2 * step) * size[::-1]
    down = (places(x, y + step) - places(x, y - step)) / (2 * step) * size[::-1]
    footprint = np.maximum(np.linalg.norm(across, axis=-1), np.linalg.norm(down, axis=-1))
    expected = sampled(texture, places(x, y), np.log2(footprint))
    assert np.abs(drawn - expected).max() <= 0.51


def sampled(texture: Texture, uv: NDArray[np.float64], size: NDArray[np.float64]) -> NDArray[np.float64]:
    """Colours (..., 3) at places (..., 2), between the levels (...) of a texture."""
    levels = mipmaps(texture)
    size = np.clip(size, 0, len(levels.levels) - 1)
    colours = []
    for start, height, width in levels.levels.tolist():
        image = levels.texels[start : start + height * width].reshape(height, width, 3).astype(float)
        column, row = uv[..., 0] * width - 0.5, (1 - uv[..., 1]) * height - 0.5
        left, top = np.floor(column).astype(int), np.floor(row).astype(int)
        s, t = (column - left)[..., None], (row - top)[..., None]
        around = [image[(top + i) % height, (left + j) % width] for i in (0, 1) for j in (0, 1)]
        colours.append((1 - t) * ((1 - s) * around[0] + s * around[1]) + t * ((1 - s) * around[2] + s * around[3]))
    lower = np.minimum(np.floor(size).astype(int), len(colours) - 1)
    upper = np.minimum(lower + 1, len(colours) - 1)
    stack, share = np.stack(colours), (size - lower)[..., None]
    rows, columns = np.indices(size.shape)
    return np.asarray((1 - share) * stack[lower, rows, columns] + share * stack[upper, rows, columns])
