"""Holes in the sensors' views: surfaces go on inside the masks, by their planes, so far and no farther."""

from __future__ import annotations

import numpy as np

from recon.cloud import merge_clouds
from recon.fusion.filling import fill_holes
from recon.geometry.mesh import Cloud
from recon.surface.photographs import Photograph
from tests.recon.fusion.test_agreement import CAMERAS, SIZE, plane

CAMERA = CAMERAS[1]  # which looks straight at the plane; a pixel is 3.3 mm wide there
PIXELS = np.random.default_rng(1).integers(0, 256, (SIZE[1], SIZE[0], 3)).astype(np.uint8)


def seen(mask: np.ndarray | None) -> Photograph:
    return Photograph(CAMERA, PIXELS, mask)


def whole_mask() -> np.ndarray:
    mask = np.zeros((SIZE[1], SIZE[0]), bool)
    columns, rows = np.rint(CAMERA.project(plane(CAMERA).points)).astype(int).T
    mask[rows, columns] = True
    return mask


def with_hole(half: float) -> Cloud:
    cloud = plane(CAMERA)
    return cloud.select((np.abs(cloud.points[:, :2]) >= half).any(axis=1))


def test_a_hole_in_a_plane_is_filled_by_the_plane_in_the_pictures_colours() -> None:
    (filled,) = fill_holes([with_hole(15.0)], [seen(whole_mask())], 16)
    assert len(filled) > 20
    assert np.abs(filled.points[:, 2]).max() < 1e-3
    assert (np.abs(filled.points[:, :2]) < 16).all()
    columns, rows = np.rint(CAMERA.project(filled.points)).astype(int).T
    assert np.array_equal(filled.colours, PIXELS[rows, columns])


def test_a_hole_is_filled_up_to_the_stated_number_of_pixels() -> None:
    cloud = with_hole(50.0)
    for reach in (2, 4):
        (filled,) = fill_holes([cloud], [seen(whole_mask())], reach)
        depth = 50.0 - np.abs(filled.points[:, :2]).max(axis=1)
        assert depth.max() <= (reach + 1) * 1000 / 300 + 0.01
        assert depth.max() > (reach - 2) * 1000 / 300


def test_behind_a_foreground_the_background_goes_on() -> None:
    post = plane(CAMERA, 200.0, half=20.0)
    wall = plane(CAMERA)
    wall = wall.select(np.abs(wall.points[:, 0]) > 45)  # the post hides what lies nearer to the middle
    (filled,) = fill_holes([merge_clouds([wall, post])], [seen(whole_mask())], 30)
    assert len(filled) > 100
    assert np.abs(filled.points[:, 2]).max() < 1, "nothing grows from the post, nor between it and the wall"


def test_nothing_is_filled_outside_the_mask_or_without_one() -> None:
    cloud, nowhere = with_hole(15.0), np.zeros((SIZE[1], SIZE[0]), bool)
    assert [len(each) for each in fill_holes([cloud], [seen(nowhere), seen(None)], 16)] == [0, 0]


def test_what_another_sensor_measured_is_no_hole() -> None:
    patch = plane(CAMERAS[0], half=20.0)
    (filled,) = fill_holes([with_hole(15.0), patch], [seen(whole_mask())], 16)
    assert len(filled) == 0


def test_without_any_points_there_is_nothing_to_continue() -> None:
    nothing = plane(CAMERA).select(np.zeros(0, int))
    assert [len(each) for each in fill_holes([nothing], [seen(whole_mask())], 16)] == [0]
