"""Sensors that agree: what others look through goes, what they measured as well is averaged."""

from __future__ import annotations

import numpy as np

from recon.cloud import merge_clouds
from recon.fusion import view_of_cloud
from recon.fusion.agreement import agreed
from recon.geometry.mesh import Cloud
from recon.geometry.rig import Camera, look_at

SIZE = (160, 120)
K = np.array([[300.0, 0, 80], [0, 300.0, 60], [0, 0, 1]])
SIGMA = 1.0
CAMERAS = [Camera(K, SIZE, look_at((x, 0, 1000), (0, 0, 0)), np.zeros(0)) for x in (-300, 0, 300)]


def plane(camera: Camera, height: float = 0.0, *, half: float = 100.0) -> Cloud:
    """A square around the origin as a camera measures it, a point a pixel, `height` mm nearer than it is."""
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
    rays = np.stack([columns, rows, np.ones_like(rows)], axis=-1).reshape(-1, 3) @ np.linalg.inv(K).T @ camera.rotation
    points = camera.centre + rays * ((height - camera.centre[2]) / rays[:, 2])[:, None]
    points = points[(np.abs(points[:, :2]) < half).all(axis=1)]
    normals = np.tile([0.0, 0, 1], (len(points), 1))
    return Cloud(points, normals, np.full((len(points), 3), 90, np.uint8), np.full(len(points), SIGMA, np.float32))


def test_measurements_of_one_surface_meet_at_their_mean() -> None:
    clouds = [plane(camera, height) for camera, height in zip(CAMERAS, (-2.0, 0.0, 2.0), strict=True)]
    after = agreed(clouds, CAMERAS)
    for cloud in after:
        inside = (np.abs(cloud.points[:, :2]) < 80).all(axis=1)
        assert np.abs(cloud.points[inside, 2]).max() < 0.1
        assert np.allclose(cloud.sigma[inside], SIGMA / 3**0.5, rtol=0.01), "three times as certain"


def test_a_certain_sensor_moves_others_more_than_itself() -> None:
    rough = plane(CAMERAS[0], 3.0)
    rough = Cloud(rough.points, rough.normals, rough.colours, 3 * rough.sigma)
    after, exact = agreed([rough, plane(CAMERAS[1])], CAMERAS[:2])
    inside = (np.abs(after.points[:, :2]) < 80).all(axis=1)
    assert np.allclose(after.points[inside, 2], 0.3, atol=0.05)
    inside = (np.abs(exact.points[:, :2]) < 80).all(axis=1)
    assert np.allclose(exact.points[inside, 2], 0.3, atol=0.05)


def test_points_stay_in_their_pixels() -> None:
    clouds = [plane(camera, height) for camera, height in zip(CAMERAS, (-2.0, 0.0, 2.0), strict=True)]
    for before, after, camera in zip(clouds, agreed(clouds, CAMERAS), CAMERAS, strict=True):
        assert np.allclose(camera.project(before.points), camera.project(after.points), atol=0.01)
        assert np.isfinite(view_of_cloud(after, camera).depth).sum() == len(before)


def test_what_floats_before_another_sensors_surface_goes() -> None:
    floating = plane(CAMERAS[0], 100.0, half=10.0)
    clouds = [merge_clouds([plane(CAMERAS[0]), floating]), plane(CAMERAS[1])]
    first, second = agreed(clouds, CAMERAS[:2])
    assert first.points[:, 2].max() < 50
    assert len(second) == len(clouds[1]), "what is hidden behind it contradicts nothing"


def test_what_as_many_sensors_measured_as_look_through_stays() -> None:
    clouds = [merge_clouds([plane(camera), plane(camera, 100.0, half=20.0)]) for camera in CAMERAS[:2]]
    kept = agreed([*clouds, plane(CAMERAS[2])], CAMERAS)
    assert (kept[0].points[:, 2] > 50).sum() > 50


def test_sensors_that_see_different_things_change_nothing() -> None:
    left, right = plane(CAMERAS[0]), plane(CAMERAS[1])
    clouds = [left.select(left.points[:, 0] < -20), right.select(right.points[:, 0] > 20)]
    for before, after in zip(clouds, agreed(clouds, CAMERAS[:2]), strict=True):
        assert np.allclose(before.points, after.points, atol=1e-3)


def test_a_cloud_without_points_or_without_errors_is_left_alone() -> None:
    nothing, unknown = plane(CAMERAS[0]).select(np.zeros(0, int)), plane(CAMERAS[2], 2.0)
    unknown = Cloud(unknown.points, unknown.normals, unknown.colours)
    after = agreed([nothing, plane(CAMERAS[1]), unknown], CAMERAS)
    assert len(after[0]) == 0
    assert after[2] is unknown
    assert np.allclose(after[1].points[:, 2], 0, atol=1e-3)
