"""Fusing after and before the surface: the same steps in the other order, with what that changes."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.cloud import merge_clouds
from recon.fusion import FUSIONS, LeftOutWarning, fuse_after, fuse_before, view_of_cloud
from recon.geometry.mesh import Cloud, merge_meshes
from recon.geometry.rig import Camera
from recon.methods.approaches import FUSION_METHODS
from recon.surface import NoSurfaceError, SurfaceParameters, default_voxel, surface_from_cloud

PARAMETERS = SurfaceParameters(voxel_mm=3.0)
ORDERS = {name: FUSIONS[name] for name in FUSION_METHODS}


def cap(direction: tuple[float, float, float], *, radius: float, seed: int) -> Cloud:
    """The half of a ball of 60 mm, seen `radius - 60` mm too near, from one direction."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(40000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals[normals @ np.array(direction) > 0.2 * np.linalg.norm(direction)]
    return Cloud(radius * normals, normals, np.full((len(normals), 3), 90, np.uint8))


def three_views() -> list[Cloud]:
    return [
        cap((-1.0, 0, 1), radius=59.0, seed=1),
        cap((0.0, 0, 1), radius=60.0, seed=2),
        cap((1.0, 0, 1), radius=61.0, seed=3),
    ]


@pytest.mark.slow
def test_fusing_after_keeps_the_surface_of_each_sensor_where_it_sees_as_well_as_the_others() -> None:
    clouds = three_views()
    fused = fuse_after(clouds, PARAMETERS)
    union = merge_meshes([surface_from_cloud(cloud, PARAMETERS) for cloud in clouds])
    farthest = cKDTree(union.vertices).query(fused.vertices)[0].max()
    assert farthest < PARAMETERS.voxel_mm, "nothing was averaged or invented"
    ahead = fused.vertices[fused.vertices[:, 2] > 50]
    for radius in (59.0, 60.0, 61.0):
        assert (np.abs(np.linalg.norm(ahead, axis=1) - radius) < 0.3).sum() > 100, "a layer per sensor"


def test_fusing_after_leaves_out_what_another_sensor_sees_far_better() -> None:
    clear, oblique = cap((0.0, 0, 1), radius=60.0, seed=2), cap((0.0, 0, 1), radius=61.0, seed=3)
    thin = oblique.select(np.arange(0, len(oblique), 5))
    thin_alone = surface_from_cloud(thin, PARAMETERS)
    fused = fuse_after([clear, thin], PARAMETERS)
    ahead = fused.vertices[fused.vertices[:, 2] > 30]
    assert (np.abs(np.linalg.norm(ahead, axis=1) - 61) < 0.3).mean() < 0.05
    assert np.array_equal(fuse_after([thin], PARAMETERS).vertices, thin_alone.vertices), "alone it is whole"


def test_fusing_after_cuts_no_hole_into_a_layer_where_another_sensor_has_more_points() -> None:
    clear, other = cap((0.0, 0, 1), radius=60.0, seed=2), cap((0.0, 0, 1), radius=61.0, seed=3)
    is_thin = np.abs(other.normals[:, 2] - 0.8) < 0.06  # a ring around what is ahead
    other = other.select(~is_thin | (np.arange(len(other)) % 9 == 0))
    alone, fused = surface_from_cloud(other, PARAMETERS).vertices, fuse_after([clear, other], PARAMETERS).vertices

    def in_ring(vertices: NDArray[np.float32]) -> int:
        distance = np.linalg.norm(vertices, axis=1)
        return int(((np.abs(distance - 61) < 0.4) & (np.abs(vertices[:, 2] / distance - 0.8) < 0.03)).sum())

    assert in_ring(fused) > 0.95 * in_ring(alone) > 100


def test_fusing_before_is_the_surface_of_all_points() -> None:
    clouds = three_views()
    fused = fuse_before(clouds, PARAMETERS)
    joint = surface_from_cloud(merge_clouds(clouds), PARAMETERS)
    assert np.array_equal(fused.vertices, joint.vertices)
    assert np.array_equal(fused.faces, joint.faces)


def test_views_that_disagree_stay_apart_after_and_are_averaged_before() -> None:
    after, before = (fuse(three_views(), PARAMETERS) for fuse in (fuse_after, fuse_before))
    front = [mesh.vertices[mesh.vertices[:, 2] > 50] for mesh in (after, before)]
    spread = [np.linalg.norm(vertices, axis=1).std() for vertices in front]
    assert len(front[0]) > 2.5 * len(front[1]), "three layers instead of one"
    assert spread[0] > 0.6
    assert spread[1] < 0.3


@pytest.mark.slow
def test_both_orders_choose_the_same_voxel() -> None:
    clouds = three_views()
    voxel = default_voxel(clouds)
    for fuse in ORDERS.values():
        chosen, given = fuse(clouds, SurfaceParameters()), fuse(clouds, SurfaceParameters(voxel_mm=voxel))
        assert np.array_equal(chosen.vertices, given.vertices)


def scattered(n: int) -> Cloud:
    """A few points far from each other and from all else."""
    points = np.array([[1000.0 * number, 0, 0] for number in range(n)]).reshape(n, 3)
    return Cloud(points, np.tile([0.0, 0, 1], (n, 1)), np.zeros((n, 3), np.uint8))


def test_a_sensor_that_saw_nothing_changes_nothing() -> None:
    clouds = three_views()[:2]
    for fuse in ORDERS.values():
        with_nothing = fuse([clouds[0], scattered(0), clouds[1]], PARAMETERS)
        assert np.array_equal(with_nothing.vertices, fuse(clouds, PARAMETERS).vertices)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_a_sensor_that_saw_next_to_nothing_is_left_out(n: int) -> None:
    clouds = three_views()[:2]
    with pytest.warns(LeftOutWarning, match="cloud 2 of 3 is left out"):
        after = fuse_after([clouds[0], scattered(n), clouds[1]], PARAMETERS)
    assert np.array_equal(after.vertices, fuse_after(clouds, PARAMETERS).vertices)
    before = fuse_before([clouds[0], scattered(n), clouds[1]], PARAMETERS)
    assert np.array_equal(before.vertices, fuse_before(clouds, PARAMETERS).vertices)


@pytest.mark.parametrize("method", sorted(ORDERS))
@pytest.mark.parametrize("n", [0, 1, 5])
def test_sensors_that_all_saw_next_to_nothing_have_no_surface(method: str, n: int) -> None:
    with pytest.raises(NoSurfaceError, match=r"nothing to fuse|points"):
        ORDERS[method]([scattered(n), scattered(n)], PARAMETERS)


@pytest.mark.parametrize("method", sorted(ORDERS))
def test_points_in_a_plane_become_that_plane(method: str) -> None:
    x, y = np.meshgrid(np.arange(40.0), np.arange(40.0))
    points = np.stack([x.ravel(), y.ravel(), np.full(x.size, 7.0)], axis=1)
    flat = Cloud(points, np.tile([0.0, 0, 1], (x.size, 1)), np.full((x.size, 3), 60, np.uint8))
    mesh = ORDERS[method]([flat], SurfaceParameters())
    assert np.abs(mesh.vertices[:, 2] - 7).max() < 1e-3
    assert np.ptp(mesh.vertices[:, :2], axis=0).min() > 35


def test_a_view_of_a_cloud_holds_its_points_in_their_pixels() -> None:
    camera = Camera(np.array([[300.0, 0, 9.5], [0, 300, 7.5], [0, 0, 1]]), (20, 16), np.eye(4))
    rows, columns = np.array([0, 3, 15]), np.array([0, 19, 4])
    z = np.array([900.0, 1100, 1000])
    points = np.column_stack([(columns - 9.5) * z / 300, (rows - 7.5) * z / 300, z])
    colours = np.array([[1, 2, 3], [4, 5, 6], [7, 8, 9]], np.uint8)
    view = view_of_cloud(Cloud(points, np.tile([0.0, 0, -1], (3, 1)), colours), camera)
    assert np.isfinite(view.depth).sum() == 3
    assert np.allclose(view.depth[rows, columns], z)
    assert np.array_equal(view.colours[rows, columns], colours)
