"""A disparity map of a known scene becomes points that lie on it, with its normals and colours."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recon.capture.rectify import Rectification
from recon.cloud import CloudParameters, back_project, cloud_from_disparity, fit_planes, merge_clouds, support
from recon.geometry.mesh import Cloud
from recon.geometry.rig import Camera, look_at, rigid

SIZE = (80, 60)
MAPS = (np.zeros((60, 80), np.float32), np.zeros((60, 80), np.float32))
WHOLE = CloudParameters(erode_px=0, min_support=0.2, min_cosine=0.0)


def studio_sensor() -> Rectification:
    """A sensor 600 mm from the origin, rotated, with its principal points apart."""
    pose = look_at((300.0, 200.0, 500.0), (0.0, 0.0, 0.0))
    K = np.array([[200.0, 0, 41.0], [0, 200.0, 28.5], [0, 0, 1]])
    K_right = K.copy()
    K_right[0, 2] += 12.0
    right = rigid(np.eye(3), (-75.0, 0, 0)) @ pose
    return Rectification("S1", Camera(K, SIZE, pose), Camera(K_right, SIZE, right), 40, MAPS, MAPS)


def rays(sensor: Rectification) -> np.ndarray:
    """World directions (H, W, 3) of depth 1 along the viewing direction."""
    columns, rows = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    pixels = np.stack([columns, rows, np.ones_like(rows)], axis=-1)
    return np.asarray(pixels @ np.linalg.inv(sensor.left.K).T @ sensor.left.rotation)


def disparity_of_plane(sensor: Rectification, normal: np.ndarray, distance: float) -> np.ndarray:
    """Disparity of the plane normal . X = distance."""
    depth = (distance - normal @ sensor.left.centre) / (rays(sensor) @ normal)
    return np.asarray(sensor.focal * sensor.baseline / depth + sensor.offset, dtype=np.float32)


def picture(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (SIZE[1], SIZE[0], 3), dtype=np.uint8)


def towards(sensor: Rectification, *, tilt: tuple[float, float]) -> np.ndarray:
    normal = sensor.left.rotation.T @ np.array([tilt[0], tilt[1], -1.0])
    return np.asarray(normal / np.linalg.norm(normal))


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(a=st.floats(-0.8, 0.8), b=st.floats(-0.8, 0.8), distance=st.floats(-60, 60))
def test_a_plane_becomes_points_on_it_with_its_normal(a: float, b: float, distance: float) -> None:
    sensor = studio_sensor()
    normal = towards(sensor, tilt=(a, b))
    cloud = cloud_from_disparity(disparity_of_plane(sensor, normal, distance), picture(), sensor, WHOLE)
    assert len(cloud) == SIZE[0] * SIZE[1]
    assert np.abs(cloud.points @ normal - distance).max() < 0.01
    assert np.degrees(np.arccos(np.clip(cloud.normals @ normal, -1, 1))).max() < 0.2


def test_every_point_projects_to_the_pixel_it_came_from_and_has_its_colour() -> None:
    sensor = studio_sensor()
    image = picture()
    cloud = cloud_from_disparity(disparity_of_plane(sensor, towards(sensor, tilt=(0.2, 0)), 0.0), image, sensor)
    columns, rows = np.rint(sensor.left.project(cloud.points)).astype(int).T
    assert np.abs(sensor.left.project(cloud.points) - np.stack([columns, rows], 1)).max() < 1e-3
    assert np.array_equal(cloud.colours, image[rows, columns])


def test_normals_stay_good_under_noise() -> None:
    sensor = studio_sensor()
    normal = towards(sensor, tilt=(0.3, -0.2))
    noise = np.random.default_rng(1).normal(0, 0.1, (SIZE[1], SIZE[0])).astype(np.float32)
    cloud = cloud_from_disparity(disparity_of_plane(sensor, normal, 0.0) + noise, picture(), sensor)
    assert np.degrees(np.arccos(cloud.normals @ normal)).mean() < 8.0


def test_sigma_is_the_points_spread_along_the_line_of_sight() -> None:
    sensor = studio_sensor()
    normal = towards(sensor, tilt=(0.0, 0.0))
    noise = np.random.default_rng(1).normal(0, 0.2, (SIZE[1], SIZE[0])).astype(np.float32)
    parameters = CloudParameters(disparity_sigma_px=1e-6)
    cloud = cloud_from_disparity(disparity_of_plane(sensor, normal, 0.0) + noise, picture(), sensor, parameters)
    along = cloud.points - sensor.left.centre
    error = np.linalg.norm(along, axis=1) * (1 - (0.0 - normal @ sensor.left.centre) / (along @ normal))
    assert cloud.sigma is not None
    assert np.sqrt((error**2).mean()) == pytest.approx(np.sqrt((cloud.sigma**2).mean()), rel=0.05)


def test_a_step_between_two_planes_has_no_points_in_the_air() -> None:
    sensor = studio_sensor()
    normal = towards(sensor, tilt=(0.0, 0.0))
    disparity = disparity_of_plane(sensor, normal, -40.0)
    disparity[:, 40:] = disparity_of_plane(sensor, normal, 40.0)[:, 40:]
    disparity[:, 39] = 0.5 * (disparity[:, 38] + disparity[:, 40])
    cloud = cloud_from_disparity(disparity, picture(), sensor)
    assert np.minimum(np.abs(cloud.points @ normal - 40), np.abs(cloud.points @ normal + 40)).max() < 0.1
    assert (cloud.normals @ normal).min() > 0.999
    assert len(cloud) > 0.9 * disparity.size


def test_the_rim_of_the_mask_is_eroded_and_the_rim_of_a_gap_is_not() -> None:
    sensor = studio_sensor()
    disparity = disparity_of_plane(sensor, towards(sensor, tilt=(0.0, 0.0)), 0.0)
    disparity[:, :30] = np.nan  # the mask ends at column 30
    disparity[20:23, 50:53] = np.nan  # a gap of nine pixels
    cloud = cloud_from_disparity(disparity, picture(), sensor, CloudParameters(erode_px=2))
    columns, rows = np.rint(sensor.left.project(cloud.points)).astype(int).T
    seen = np.zeros(disparity.shape, bool)
    seen[rows, columns] = True
    assert not seen[:, :32].any()
    assert seen[:, 32:].sum() == disparity[:, 32:].size - 9


def test_small_clusters_are_removed() -> None:
    sensor = studio_sensor()
    disparity = disparity_of_plane(sensor, towards(sensor, tilt=(0.0, 0.0)), 0.0)
    disparity[5:50, 30:45] = np.nan
    disparity[20:27, 35:42] = disparity[0, 0] + 5  # an island in the gap
    cloud = cloud_from_disparity(disparity, picture(), sensor, CloudParameters(min_cluster=0.02))
    depth = sensor.left.points_in_camera(cloud.points)[:, 2]
    assert np.ptp(depth) < 5


def test_points_seen_too_obliquely_are_left_out() -> None:
    sensor = studio_sensor()
    disparity = disparity_of_plane(sensor, towards(sensor, tilt=(0.8, 0.0)), 0.0)
    cloud = cloud_from_disparity(disparity, picture(), sensor, CloudParameters(min_cosine=0.75))
    line_of_sight = cloud.points - sensor.left.centre
    cosine = -(cloud.normals * line_of_sight).sum(axis=1) / np.linalg.norm(line_of_sight, axis=1)
    assert cosine.min() >= 0.749
    assert 0 < len(cloud) < disparity.size


@pytest.mark.slow
def test_a_map_without_a_surface_is_refused() -> None:
    sensor = studio_sensor()
    empty = np.full((SIZE[1], SIZE[0]), np.nan, np.float32)
    lonely = empty.copy()
    lonely[30, 40] = 5.0
    for disparity in (empty, lonely):
        with pytest.raises(ValueError, match="sensor S1: no point is left"):
            cloud_from_disparity(disparity, picture(), sensor)


def test_sizes_that_do_not_match_are_refused() -> None:
    with pytest.raises(ValueError, match=r"disparity \(5, 5\)"):
        cloud_from_disparity(np.ones((5, 5), np.float32), picture(), studio_sensor())


def test_merging_keeps_all_points_in_order() -> None:
    sensor = studio_sensor()
    disparity = disparity_of_plane(sensor, towards(sensor, tilt=(0.0, 0.0)), 0.0)
    a, b = (cloud_from_disparity(disparity + shift, picture(), sensor) for shift in (0.0, 1.0))
    merged = merge_clouds([a, b])
    assert np.array_equal(merged.points, np.concatenate([a.points, b.points]))
    assert merged.sigma is not None
    assert merge_clouds([a, Cloud(b.points, b.normals, b.colours)]).sigma is None
    with pytest.raises(ValueError, match="none"):
        merge_clouds([])


def rough_map(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    relative = (20 + rng.normal(0, 0.8, (12, 15))).astype(np.float32)
    relative[rng.random(relative.shape) < 0.2] = np.nan
    return relative


@pytest.mark.parametrize("seed", range(3))
def test_support_counts_what_a_plain_loop_counts(seed: int) -> None:
    relative = rough_map(seed)
    expected = np.zeros(relative.shape)
    for (row, column), centre in np.ndenumerate(relative):
        for (v, u), other in np.ndenumerate(relative):
            distance = max(abs(v - row), abs(u - column))
            expected[row, column] += distance <= 2 and bool(abs(other - centre) <= 0.5 * (1 + distance))
    window = np.outer(*[np.minimum(np.arange(n), 2) + np.minimum(np.arange(n)[::-1], 2) + 1 for n in relative.shape])
    assert np.allclose(support(relative, 1.0), expected / window)


@pytest.mark.parametrize("seed", range(3))
def test_plane_fits_equal_least_squares(seed: int) -> None:
    relative = rough_map(seed)
    rows, columns = np.nonzero(np.isfinite(relative))
    for row, column, plane in zip(rows, columns, fit_planes(relative, rows, columns, 3, 1.0), strict=True):
        v, u = np.nonzero(np.isfinite(relative))
        distance = np.maximum(abs(v - row), abs(u - column))
        near = (distance <= 3) & (abs(relative[v, u] - relative[row, column]) <= 0.5 * (1 + distance))
        v, u = v[near], u[near]
        design = np.column_stack([np.ones(len(u)), u - column, v - row])
        if len(u) < 6:
            assert np.isnan(plane).all()
            continue
        solution, residuals, *_ = np.linalg.lstsq(design, relative[v, u].astype(float), rcond=None)
        assert np.allclose(plane[:3], solution, atol=1e-5)
        assert plane[3] == pytest.approx(np.sqrt(residuals[0] / len(u)), abs=1e-5)


def test_back_projection_without_a_plane_has_no_direction() -> None:
    one = np.array([1])
    *_, cosine = back_project(
        np.ones((3, 3), np.float32), one, one, np.full((1, 4), np.nan), np.array([1.0, 1, 1, 1]), 1.0, 0.1
    )
    assert cosine == [0.0]
