"""The surface of a cloud is where the cloud is: on known shapes, at their edges, and nowhere else."""

from __future__ import annotations

import re

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recon.geometry.mesh import Cloud, Mesh
from recon.surface import SurfaceParameters, default_voxel, spacing, surface_from_cloud
from recon.surface.apss import signed_field
from recon.surface.band import Band, band_around, neighbours_of
from recon.surface.blocks import LARGEST_AXIS
from recon.surface.cells import Cells, Reach, gather
from recon.surface.components import drop_small_components

PLAIN = Reach(3.5, 0.0, 0.0)


def cloud_of(points: np.ndarray, normals: np.ndarray, colours: np.ndarray | None = None) -> Cloud:
    grey = np.full((len(points), 3), 128, np.uint8)
    return Cloud(points, np.broadcast_to(normals, points.shape), grey if colours is None else colours)


def sphere(n: int = 40000, radius: float = 50.0, noise: float = 0.0, seed: int = 0) -> Cloud:
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(n, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = directions * (radius + noise * rng.normal(size=(n, 1))) + (5, -80, 300)
    return cloud_of(points, directions, np.where(directions[:, :1] > 0, [200, 10, 10], [10, 10, 200]).astype(np.uint8))


def sheet(n: int = 20000, size: float = 100.0, seed: int = 0) -> np.ndarray:
    """Points on the square [0, size] x [0, size] x {0}."""
    return np.column_stack([np.random.default_rng(seed).uniform(0, size, (n, 2)), np.zeros(n)])


def same_mesh(a: Mesh, b: Mesh) -> bool:
    return all(
        np.array_equal(getattr(a, name), getattr(b, name)) for name in ("vertices", "faces", "normals", "colours")
    )


def is_closed(faces: np.ndarray) -> bool:
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    forward, backward = (np.sort(edges[:, a] << 32 | edges[:, 1 - a]) for a in (0, 1))
    return bool(np.array_equal(forward, backward) and (np.diff(forward) > 0).all())


@pytest.mark.slow
@pytest.mark.parametrize("voxel", [2.0, 4.0])
def test_a_sphere_is_closed_and_has_its_radius_and_normals(voxel: float) -> None:
    mesh = surface_from_cloud(sphere(), SurfaceParameters(voxel_mm=voxel))
    outwards = mesh.vertices - np.float32([5, -80, 300])
    radius = np.linalg.norm(outwards, axis=1)
    assert is_closed(mesh.faces)
    assert np.abs(radius - 50).max() < 0.15
    assert np.degrees(np.arccos(np.clip((mesh.normals * outwards).sum(axis=1) / radius, -1, 1))).max() < 1.5
    corners = mesh.vertices[mesh.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert ((cross * (corners[:, 0] - (5, -80, 300))).sum(axis=1) > 0).all()


def test_noise_is_averaged_out() -> None:
    mesh = surface_from_cloud(sphere(noise=1.0), SurfaceParameters(voxel_mm=3.0))
    error = np.linalg.norm(mesh.vertices - np.float32([5, -80, 300]), axis=1) - 50
    assert np.abs(error).mean() < 0.25
    assert is_closed(mesh.faces)


def test_colours_are_those_of_the_points_nearby() -> None:
    mesh = surface_from_cloud(sphere(), SurfaceParameters(voxel_mm=2.0))
    side = mesh.vertices[:, 0] - 5
    assert (mesh.colours[side > 8] == [200, 10, 10]).all()
    assert (mesh.colours[side < -8] == [10, 10, 200]).all()


@settings(max_examples=10, deadline=None)
@given(x=st.floats(-1, 1), y=st.floats(-1, 1), z=st.floats(0.2, 1), shift=st.floats(-500, 500))
def test_a_plane_is_reproduced_exactly_whatever_its_place(x: float, y: float, z: float, shift: float) -> None:
    normal = np.array([x, y, z]) / np.linalg.norm([x, y, z])
    across = np.cross(normal, [1.0, 0.3, 0.0])
    across /= np.linalg.norm(across)
    flat = sheet(n=6000)
    points = flat[:, :1] * across + flat[:, 1:2] * np.cross(normal, across) + shift * normal
    mesh = surface_from_cloud(cloud_of(points, normal), SurfaceParameters(voxel_mm=4.0))
    assert np.abs(mesh.vertices @ normal - shift).max() < 5e-3
    assert (mesh.normals @ normal).min() > 0.9999


def test_a_surface_ends_where_the_points_end_and_holes_stay_open() -> None:
    points = sheet(n=40000)
    points = points[np.linalg.norm(points[:, :2] - 50, axis=1) > 20]
    parameters = SurfaceParameters(voxel_mm=2.0, overhang=0.3)
    mesh = surface_from_cloud(cloud_of(points, np.float64([0, 0, 1])), parameters)
    x, y = mesh.vertices[:, 0], mesh.vertices[:, 1]
    for low, high in ((x.min(), x.max()), (y.min(), y.max())):
        assert -3 < low < 2.5
        assert 97.5 < high < 103
    corners = mesh.vertices[mesh.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    assert area == pytest.approx(100**2 - np.pi * 20**2, rel=0.03)
    assert np.linalg.norm(mesh.vertices[:, :2] - 50, axis=1).min() > 16


def test_scattered_outliers_make_no_surface() -> None:
    cloud = sphere(n=60000)
    rng = np.random.default_rng(1)
    normals = rng.normal(size=(600, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    astray = cloud_of(rng.uniform(-150, 150, (600, 3)) + np.float64([5, -80, 300]), normals)
    both = Cloud(
        *(np.concatenate([getattr(cloud, name), getattr(astray, name)]) for name in ("points", "normals", "colours"))
    )
    mesh = surface_from_cloud(both, SurfaceParameters(voxel_mm=2.0, min_component=0.0))
    distance = np.abs(np.linalg.norm(mesh.vertices - np.float32([5, -80, 300]), axis=1) - 50)
    assert (distance > 3).mean() < 0.005


def test_two_sides_of_a_thin_body_stay_apart() -> None:
    front, back = sheet(seed=1), sheet(seed=2) - (0, 0, 20)
    points = np.concatenate([front, back])
    normals = np.repeat([[0.0, 0, 1], [0, 0, -1]], len(front), axis=0)
    mesh = surface_from_cloud(cloud_of(points, normals), SurfaceParameters(voxel_mm=4.0))
    assert np.minimum(abs(mesh.vertices[:, 2]), abs(mesh.vertices[:, 2] + 20)).max() < 0.5


def test_small_components_are_removed() -> None:
    cloud = sphere()
    island = sheet(n=300, size=12.0)
    both = cloud_of(
        np.concatenate([cloud.points, island]), np.concatenate([cloud.normals, np.tile([0, 0, 1.0], (300, 1))])
    )
    kept = surface_from_cloud(both, SurfaceParameters(voxel_mm=2.0, min_component=0.0))
    assert np.abs(kept.vertices[:, 2]).min() < 1
    assert surface_from_cloud(both, SurfaceParameters(voxel_mm=2.0)).vertices[:, 2].min() > 200


def test_components_are_dropped_by_their_share_of_the_largest() -> None:
    vertices = np.random.default_rng(0).normal(size=(12, 3))
    faces = np.array(
        [[5, 1, 2], [2, 1, 7], [7, 2, 9], [9, 7, 5], [0, 3, 4], [4, 3, 6]]
    )  # 4 and 2 faces; 8, 10, 11 alone
    mesh = Mesh(vertices, faces, np.tile([0, 0, 1.0], (12, 1)), np.zeros((12, 3), np.uint8))
    both, one = drop_small_components(mesh, 0.5), drop_small_components(mesh, 0.6)
    assert np.array_equal(both.vertices[both.faces], mesh.vertices[faces])
    assert np.array_equal(one.vertices[one.faces], mesh.vertices[faces[:4]])
    assert (len(both.vertices), len(one.vertices)) == (9, 5)


def test_a_point_is_believed_by_its_inverse_variance() -> None:
    points = np.concatenate([sheet(seed=1), sheet(seed=2) + np.float64([0, 0, 1])])
    sigma = np.repeat([1.0, 2.0], len(points) // 2)
    grey = np.full((len(points), 3), 128, np.uint8)
    cloud = Cloud(points, np.tile([0, 0, 1.0], (len(points), 1)), grey, sigma)
    mesh = surface_from_cloud(cloud, SurfaceParameters(voxel_mm=4.0))
    assert np.median(mesh.vertices[:, 2]) == pytest.approx(1 / 5, abs=0.05)  # (1 * 0 + 1/4 * 1) / (1 + 1/4)


def test_the_result_does_not_depend_on_the_number_of_threads() -> None:
    cloud = sphere(noise=1.0)
    several = surface_from_cloud(cloud)
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        single = surface_from_cloud(cloud)
    finally:
        numba.set_num_threads(threads)
    assert same_mesh(several, single)


def test_the_default_voxel_follows_the_spacing_or_the_depth_error() -> None:
    grid = np.stack(np.meshgrid(np.arange(0, 100, 0.5), np.arange(0, 100, 0.5), [0.0]), axis=-1).reshape(-1, 3)
    rotation = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    cloud = cloud_of(grid @ rotation, rotation[2])
    assert spacing(cloud) == pytest.approx(0.5, rel=0.25)
    assert default_voxel([cloud]) == pytest.approx(0.75, rel=0.25)
    rough = Cloud(cloud.points, cloud.normals, cloud.colours, np.full(len(grid), 3.0))
    assert default_voxel([rough]) == pytest.approx(1.2, rel=0.06)
    rougher = Cloud(cloud.points, cloud.normals, cloud.colours, np.full(len(grid), 3.03))
    assert default_voxel([rougher]) == default_voxel([rough]), "frames that are nearly alike share a grid"


@pytest.mark.parametrize("n", [0, 1, 2])
def test_too_few_points_are_refused(n: int) -> None:
    cloud = sphere()
    few = cloud.select(np.arange(n))
    for parameters in (SurfaceParameters(), SurfaceParameters(voxel_mm=2.0)):
        with pytest.raises(ValueError, match=f"the cloud has {n} points"):
            surface_from_cloud(few, parameters)


def test_points_in_one_place_are_refused() -> None:
    cloud = cloud_of(np.ones((100, 3)), np.float64([0, 0, 1]))
    with pytest.raises(ValueError, match="100 points in one place"):
        surface_from_cloud(cloud)


@pytest.mark.slow
@pytest.mark.parametrize("voxel", [0.05, 1e-7])
def test_a_voxel_that_memory_cannot_hold_is_refused_with_one_that_fits(voxel: float) -> None:
    cloud = sphere()
    with pytest.raises(ValueError, match=r"would need .*; a voxel of [\d.]+ mm fits") as error:
        surface_from_cloud(cloud, SurfaceParameters(voxel_mm=voxel, memory_gb=0.05))
    fitting = float(re.findall(r"a voxel of ([\d.]+) mm fits", str(error.value))[0])
    assert len(surface_from_cloud(cloud, SurfaceParameters(voxel_mm=fitting, memory_gb=0.05)).faces)


@pytest.mark.parametrize(
    "change",
    [
        {"voxel_mm": 0.0},
        {"voxel_mm": float("nan")},
        {"radius": 9.0},
        {"radius_spacings": float("nan")},
        {"radius_sigmas": float("inf")},
        {"overhang": -0.4},
        {"agreement": -0.5},
        {"agreement": 1.5},
        {"min_points": -1.0},
        {"min_component": 2.0},
        {"memory_gb": 0.0},
    ],
)
def test_parameters_that_make_no_sense_are_refused(change: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(change))):
        SurfaceParameters(**change)


def scattered(n: int, seed: int) -> Cloud:
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(n, 3)) * 0.3 + (0, 0, 1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = rng.uniform(-20, 20, (n, 3)) * (1, 1, 0.1)
    return Cloud(points, normals, rng.integers(0, 256, (n, 3), dtype=np.uint8), rng.uniform(0.5, 2, n))


def plain_field(cloud: Cloud, sample: np.ndarray, voxel: float, radius: float) -> tuple[float, np.ndarray, np.ndarray]:
    """The formulas of the papers on single points, which cells with one point each must reproduce."""
    p = (cloud.points.astype(float) - sample) / voxel
    n = cloud.normals.astype(float)
    assert cloud.sigma is not None
    weight = np.clip((np.median(cloud.sigma) / cloud.sigma) ** 2, 1 / 16, 4)
    w = weight * np.maximum(1 - (p**2).sum(axis=1) / radius**2, 0) ** 4
    share = w / w.sum()
    numerator = (w * (p * n).sum(axis=1)).sum() - (share @ p) @ (w @ n)
    denominator = (w * (p * p).sum(axis=1)).sum() - (share @ p) @ (w @ p)
    u4 = 0.5 * numerator / denominator
    u = share @ n - 2 * u4 * (share @ p)
    u0 = -u @ (share @ p) - u4 * (share @ (p * p).sum(axis=1))
    radicand = np.sqrt(u @ u - 4 * u0 * u4)
    centre = -u / (2 * u4)
    distance = np.sign(u4) * (np.linalg.norm(centre) - radicand / (2 * abs(u4)))
    sharp = weight * np.maximum(1 - (p**2).sum(axis=1) / radius**2, 0) ** 16
    return distance, u / np.linalg.norm(u), sharp @ cloud.colours / sharp.sum()


@pytest.mark.parametrize("seed", range(3))
def test_the_field_is_that_of_the_papers(seed: int) -> None:
    voxel, radius = 1.0, 6.0
    cloud = scattered(200, seed)
    cloud = cloud.select(np.unique(np.floor(cloud.points / voxel), axis=0, return_index=True)[1])  # one point a cell
    cells = gather(cloud, voxel, Reach(radius, 0, 0))
    band = band_around(cells)
    field, gradient, colour = signed_field(cells, band, overhang=9.0, agreement=0.0, min_points=2.0)
    samples = np.argwhere(np.isfinite(field))
    for block, i, j, k in samples[np.random.default_rng(seed).choice(len(samples), 60)]:
        where = (8 * band.blocks[block] + (i, j, k)) * voxel
        distance, direction, shade = plain_field(cloud, where, voxel, radius)
        assert field[block, i, j, k] == pytest.approx(distance, abs=5e-3)  # sums in float32
        assert np.allclose(gradient[block, :, i, j, k], direction, atol=5e-3)
        assert np.allclose(colour[block, :, i, j, k], shade, atol=0.01)


def test_moments_are_those_of_each_cells_points() -> None:
    cloud = scattered(400, 1)
    voxel = 1.5
    cells = gather(cloud, voxel, Reach(2.0, 0.0, 3.0))
    assert cloud.sigma is not None
    weights = np.clip((np.median(cloud.sigma) / cloud.sigma.astype(float)) ** 2, 1 / 16, 4)
    in_voxels = cloud.points.astype(float) / voxel
    names, inverse = np.unique(np.floor(in_voxels).astype(int), axis=0, return_inverse=True)
    expected = {}
    for cell in range(len(names)):
        chosen = inverse.ravel() == cell
        w, p, n = weights[chosen], in_voxels[chosen], cloud.normals[chosen].astype(float)
        mean, direction = w @ p / w.sum(), w @ n / w.sum()
        covariance = w @ ((p - mean) * (n - direction)).sum(axis=1) / w.sum()
        spread = w @ ((p - mean) ** 2).sum(axis=1) / w.sum()
        corner = names[cell] // 8 * 8
        shade = w @ cloud.colours[chosen] / w.sum()
        reach = [3.0 * (w @ cloud.sigma[chosen]) / w.sum() / voxel]
        expected[tuple(names[cell])] = np.concatenate(
            [mean - corner, [w.sum()], direction, [covariance, spread], shade, np.clip(reach, 2.0, 8.0), [chosen.sum()]]
        )
    assert len(cells.moments) == len(expected)
    block = np.repeat(np.arange(len(cells.blocks)), np.diff(cells.starts))
    for moments, corner in zip(cells.moments, 8 * cells.blocks[block], strict=True):
        name = tuple(np.floor(moments[:3].astype(float) + corner).astype(int))
        assert np.allclose(moments, expected[name], atol=1e-3)


@pytest.mark.slow
def test_the_band_holds_every_sample_within_reach_and_memory_grows_with_the_surface() -> None:
    cloud = sphere()
    fine, coarse = (band_around(gather(cloud, voxel, PLAIN)) for voxel in (0.5, 1.0))
    assert 3.0 < len(fine.blocks) / len(coarse.blocks) < 5.0, "four times the blocks for half the voxel"
    names = set(map(tuple, coarse.blocks.tolist()))
    samples = np.rint(cloud.points).astype(int)
    for step in np.stack(np.meshgrid(*[[-1, 0, 1]] * 3), axis=-1).reshape(-1, 3):
        assert set(map(tuple, ((samples + step) >> 3).tolist())) <= names


def far_apart(lowest: float, highest: float) -> Cloud:
    """Five points in blocks of 8 mm beside each other at either end of the longest axis for samples 1 mm apart."""
    beside, along = np.meshgrid(np.arange(-7.0, 33, 8), [lowest, 8.0 * LARGEST_AXIS + highest])
    return cloud_of(np.column_stack([beside.ravel(), along.ravel(), np.ones(10)]), np.array([0, 0, 1.0]))


@pytest.mark.parametrize(
    ("cloud", "voxel"), [(sphere(), 4.0), (far_apart(0.0, -0.75), 1.0), (far_apart(7.75, 7.25), 1.0)]
)
def test_neighbours_are_the_blocks_one_step_away(cloud: Cloud, voxel: float) -> None:
    cells: Cells = gather(cloud, voxel, PLAIN)
    band: Band = band_around(cells)
    for blocks, neighbours in ((band.blocks, band.neighbours), (cells.blocks, neighbours_of(band, cells))):
        names = {tuple(block): index for index, block in enumerate(blocks.tolist())}
        for block, around in zip(band.blocks, neighbours, strict=True):
            for number, index in enumerate(around):
                step = (number // 9 - 1, number // 3 % 3 - 1, number % 3 - 1)
                assert index == names.get(tuple((block + step).tolist()), -1)
    assert set(map(tuple, cells.blocks.tolist())) <= set(map(tuple, band.blocks.tolist()))
