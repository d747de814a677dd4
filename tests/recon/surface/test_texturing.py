"""A mesh gets its colours from the photographs that see it, wherever one does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from recon.geometry.mesh import Mesh, merge_meshes
from recon.geometry.normals import surface_normals
from recon.geometry.rig import Camera, look_at
from recon.surface.exposures import Exposure, compare_exposures, exposed
from recon.surface.photographs import Photograph, prepare, qualities, sampled
from recon.surface.texturing import textured
from recon.validation.views.image_quality import psnr
from recon.validation.views.novel_view import rendered

RADIUS, DISTANCE, SIZE, TOLERANCE = 100.0, 900.0, (240, 240), 4.0
GREY = 100
Paint = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def fine(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Colours that change within a few pixels, between vertices."""
    return np.asarray(120 + 70 * np.sin(points / 2.5 + (0, 1, 2)))


def broad(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(120 + 50 * np.sin(points / 20 + (0, 1, 2)))


def red(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.tile([200.0, 10, 10], (len(points), 1))


def camera_at(azimuth_deg: float) -> Camera:
    angle = np.deg2rad(azimuth_deg)
    K = np.array([[900.0, 0, 119.5], [0, 900, 119.5], [0, 0, 1]])
    return Camera(K, SIZE, look_at(DISTANCE * np.array([np.sin(angle), 0.2, np.cos(angle)]), np.zeros(3)))


def looking_away() -> Camera:
    camera = camera_at(0)
    return Camera(camera.K, SIZE, look_at(camera.centre, 2 * camera.centre))


def ball(radius: float = RADIUS, centre: tuple[float, float, float] = (0, 0, 0), n: int = 40) -> Mesh:
    """A ball of grey vertices, about eight pixels apart."""
    around, down = np.meshgrid(np.linspace(0, 2 * np.pi, 2 * n, endpoint=False), np.linspace(0.02, np.pi - 0.02, n))
    normals = np.stack([np.sin(down) * np.sin(around), np.cos(down), np.sin(down) * np.cos(around)], axis=-1)
    number = np.arange(2 * n * n).reshape(n, 2 * n)
    here, right = number[:-1], np.roll(number, -1, axis=1)[:-1]
    below, across = number[1:], np.roll(number, -1, axis=1)[1:]
    faces = np.concatenate([np.stack([here, below, right], -1), np.stack([right, below, across], -1)]).reshape(-1, 3)
    vertices = (radius * normals.reshape(-1, 3) + centre).astype(np.float32)
    grey = np.full((len(vertices), 3), GREY, np.uint8)
    return Mesh(vertices, faces.astype(np.int32), surface_normals(vertices, faces), grey)


def photograph(
    camera: Camera, paint: Paint, radius: float = RADIUS, centre: tuple[float, float, float] = (0, 0, 0)
) -> Photograph:
    """What a camera sees of a painted ball, by the rays of its pixels; black beside it."""
    columns, rows = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    rays = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ np.linalg.inv(camera.K).T @ camera.rotation
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    start = camera.centre - centre
    along = (rays * start).sum(axis=-1)
    under_root = along**2 - start @ start + radius**2
    mask = under_root > 0
    points = (start + (-along - np.sqrt(np.maximum(under_root, 0)))[..., None] * rays)[mask]
    pixels = np.zeros((*mask.shape, 3), np.uint8)
    pixels[mask] = np.rint(paint(points))
    return Photograph(camera, pixels, mask)


def photographs(paint: Paint) -> list[Photograph]:
    return [photograph(camera_at(azimuth), paint) for azimuth in (-40, -34, 0, 6, 40, 46)]


def likeness(mesh: Mesh, truth: Photograph) -> float:
    picture, covered, _ = rendered(mesh, truth.camera)
    assert truth.mask is not None
    value = psnr(picture, truth.pixels, covered & truth.mask)
    assert value is not None
    return value


@pytest.mark.slow
def test_a_texture_is_as_sharp_as_the_photographs_between_the_cameras_and_leaves_the_shape() -> None:
    mesh = ball()
    painted = replace(mesh, colours=np.rint(fine(mesh.vertices.astype(float))).astype(np.uint8))
    seen = textured(mesh, photographs(fine), TOLERANCE)
    between = photograph(camera_at(20), fine)
    assert likeness(seen, between) > likeness(painted, between) + 6
    assert likeness(seen, between) > 22

    def triangles(shape: Mesh) -> NDArray[np.float32]:
        return np.unique(shape.vertices[shape.faces].reshape(-1, 9), axis=0)

    assert np.array_equal(triangles(seen), triangles(mesh))


def test_a_camera_counts_by_the_square_of_its_pixels_on_the_surface() -> None:
    finer = camera_at(0)
    coarser = Camera(finer.K * [[1 / 3, 1, 1], [1, 1 / 3, 1], [1, 1, 1]], SIZE, finer.cam_from_world)
    views = prepare(ball(), [photograph(camera, fine) for camera in (finer, coarser)], TOLERANCE)
    towards = finer.centre[None] / np.linalg.norm(finer.centre)
    (best,), (other,) = qualities(views, RADIUS * towards, towards, TOLERANCE)
    assert best == pytest.approx(1, rel=0.01)
    assert other == pytest.approx(1 / 9, rel=0.01)


def test_what_no_camera_sees_keeps_the_colours_of_the_vertices() -> None:
    picture, _, _ = rendered(textured(ball(), photographs(fine), TOLERANCE), camera_at(180))
    assert (np.abs(picture[90:150, 100:140].astype(int) - GREY) <= 1).all()
    picture, covered, _ = rendered(textured(ball(), [photograph(looking_away(), fine)], TOLERANCE), camera_at(0))
    assert (np.abs(picture[covered].astype(int) - GREY) <= 1).all()


def test_a_mesh_between_the_pixels_centres_keeps_the_colours_of_the_vertices() -> None:
    seen = textured(ball(radius=1e-2), [photograph(camera_at(0), fine)], TOLERANCE)
    assert seen.texture is not None
    assert (seen.texture.at_vertices() == GREY).all()


@pytest.mark.slow
def test_a_camera_of_another_exposure_leaves_no_seam() -> None:
    mesh, even = ball(), photographs(broad)
    gains = np.array([1, 1, 0.7, 0.7, 1, 1])[:, None] * np.ones(3)
    uneven = [exposed(one, Exposure(gain)) for one, gain in zip(even, gains, strict=True)]
    estimated = compare_exposures(mesh, uneven, TOLERANCE)
    agreed = np.array([one.gain for one in estimated]) * gains
    assert agreed.max() / agreed.min() < 1.05
    middle = photograph(camera_at(20), broad)

    def unevenness(seen: list[Photograph]) -> float:
        picture, covered, _ = rendered(textured(mesh, seen, TOLERANCE), middle.camera)
        low, high = np.percentile(picture[covered] / np.maximum(middle.pixels[covered], 1.0), (5, 95))
        return float(high / low)

    balanced = [exposed(*both) for both in zip(uneven, estimated, strict=True)]
    assert unevenness(uneven) > 1.12
    assert unevenness(balanced) < 1.08


def test_light_that_moves_with_the_camera_is_not_taken_for_its_exposure() -> None:
    mesh, even = ball(), photographs(broad)
    ramp = np.linspace(0.5, 1, even[2].pixels.shape[1])[:, None]  # from the left of the picture to its right
    lit = [replace(one, pixels=(one.pixels * ramp).astype(np.uint8)) for one in even[2:4]]
    estimated = compare_exposures(mesh, [*even[:2], *lit, *even[4:]], TOLERANCE)
    assert np.abs(np.log([one.gain for one in estimated])).max() < 0.12  # the light is 0.29 on average


def test_cameras_that_share_nothing_keep_their_exposure() -> None:
    opposite = [photograph(camera_at(azimuth), broad) for azimuth in (0, 180)]
    assert all(np.allclose(one.gain, 1) for one in compare_exposures(ball(), opposite, TOLERANCE))


@pytest.mark.slow
def test_cameras_that_mix_the_colours_otherwise_agree_after_their_matrices() -> None:
    mesh, even = ball(n=80), photographs(broad)
    mixing = Exposure(np.ones(3), np.array([[0.8, 0.15, 0.05], [0.1, 0.85, 0.05], [0.0, 0.2, 0.8]]))
    seen = [exposed(one, mixing) if number in (2, 3) else one for number, one in enumerate(even)]
    estimated = compare_exposures(mesh, seen, TOLERANCE)
    corrected = [exposed(*both) for both in zip(seen, estimated, strict=True)]

    def difference(pictures: list[Photograph]) -> float:
        views = prepare(mesh, pictures, TOLERANCE)
        quality = qualities(views, mesh.vertices, mesh.normals, TOLERANCE)
        both = np.flatnonzero((quality[1] > 0) & (quality[2] > 0))
        colours = [sampled(view.coarse, view.photograph.camera.project(mesh.vertices[both])) for view in views[1:3]]
        return float(np.abs(colours[0].astype(float) - colours[1]).mean())

    gains_alone = [exposed(one, Exposure(each.gain)) for one, each in zip(seen, estimated, strict=True)]
    assert difference(corrected) < 0.4 * difference(gains_alone)


def test_where_a_mask_cuts_the_object_other_cameras_give_the_colours() -> None:
    whole = photographs(broad)
    cut = []
    for one in whole[2:4]:
        assert one.mask is not None
        mask, pixels = one.mask.copy(), one.pixels.copy()
        mask[:, 100:140], pixels[:, 100:140] = False, 0
        cut.append(replace(one, mask=mask, pixels=pixels))
    mesh = textured(ball(), [*whole[:2], *cut, *whole[4:]], TOLERANCE)
    assert likeness(mesh, whole[2]) > 30


def test_what_stands_in_front_does_not_colour_what_is_behind() -> None:
    small, place = 30.0, (0.0, 0.0, 250.0)
    both = []
    for azimuth in (-30, 0, 30):
        back, front = photograph(camera_at(azimuth), broad), photograph(camera_at(azimuth), red, small, place)
        assert front.mask is not None
        assert back.mask is not None
        pixels = np.where(front.mask[..., None], front.pixels, back.pixels)
        both.append(Photograph(back.camera, pixels, back.mask | front.mask))
    mesh = textured(merge_meshes([ball(), ball(small, place)]), both, TOLERANCE)
    aside = photograph(camera_at(15), broad)
    picture, _, _ = rendered(mesh, aside.camera)
    front = photograph(aside.camera, red, small, place).mask
    assert aside.mask is not None
    assert front is not None
    beside = aside.mask & ~(np.asarray(np.hypot(*np.gradient(front.astype(float)))) > 0) & ~front
    wrong = np.abs(picture[beside].astype(int) - aside.pixels[beside]).max(axis=1) > 60
    assert wrong.mean() < 0.01
    is_red = picture[front][:, 0].astype(int) - picture[front][:, 1] > 100
    assert is_red.mean() > 0.9


@pytest.mark.slow
def test_too_many_texels_make_a_coarser_texture(monkeypatch: pytest.MonkeyPatch) -> None:
    full = textured(ball(), photographs(broad), TOLERANCE).texture
    monkeypatch.setattr("recon.surface.texturing.MOST_TEXELS", 6 * 60 * 60)
    mesh = textured(ball(), photographs(broad), TOLERANCE)
    assert full is not None
    assert mesh.texture is not None
    assert mesh.texture.pixels.size < 0.35 * full.pixels.size
    assert likeness(mesh, photograph(camera_at(20), broad)) > 28


def test_what_the_mesh_lacks_is_not_painted_on_what_is_behind() -> None:
    """A small ball that was not reconstructed stands before the big one: only the middle camera sees it there."""
    seen = photographs(broad)
    for number in (2, 3):
        hand = photograph(seen[number].camera, red, radius=14, centre=(0, 0, 160))
        pixels = np.where(hand.pixels.any(axis=-1, keepdims=True), hand.pixels, seen[number].pixels)
        seen[number] = replace(seen[number], pixels=pixels)
    mesh = ball()
    camera = camera_at(3)
    picture, covered, _ = rendered(textured(mesh, seen, TOLERANCE), camera)
    truth = photograph(camera, broad)
    worst = np.abs(picture.astype(int) - truth.pixels)[80:160, 80:160].max()
    assert covered[80:160, 80:160].all()
    assert worst < 60  # the red ball is 150 levels off
