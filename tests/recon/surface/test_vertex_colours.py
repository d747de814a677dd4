"""Colours of vertices: from the points beside them, against a slow reference, and sharper than the shape."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from recon.geometry.mesh import Cloud, Mesh
from recon.surface import SurfaceParameters, surface_from_cloud
from recon.surface import vertex_colours as module
from recon.surface.vertex_colours import beside, colour_vertices, supports

STRIPE_MM = 4.0


def flat_cloud(*, noise_mm: float, seed: int = 1, n: int = 6000) -> Cloud:
    """A square of 60 mm with black and white stripes, seen with errors of depth."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(0, 60, (n, 2))
    points = (
        np.column_stack([places, 20 + rng.normal(0, noise_mm, n)])
        if noise_mm
        else np.column_stack([places, np.full(n, 20.0)])
    )
    stripes = np.where(np.floor(places[:, :1] / STRIPE_MM) % 2 == 0, 20, 220) * np.ones((1, 3))
    sigma = np.full(n, max(noise_mm, 0.1), np.float32)
    return Cloud(points, np.tile([0.0, 0, 1], (n, 1)), stripes.astype(np.uint8), sigma)


def some_vertices(cloud: Cloud, n: int) -> Mesh:
    rng = np.random.default_rng(2)
    normals = rng.normal(size=(n, 3)) * 0.3 + (0, 0, 1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    vertices = cloud.points[rng.integers(0, len(cloud), n)] + rng.normal(0, 0.4, (n, 3))
    return Mesh(vertices, np.array([[0, 1, 2]]), normals, np.full((n, 3), 7, np.uint8))


def reference(mesh: Mesh, clouds: list[Cloud], voxel: float) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """Colours and supports of vertices, by comparing each with every point."""
    sigma = float(np.median(np.concatenate([cloud.sigma for cloud in clouds if cloud.sigma is not None])))
    depth = np.clip(module.DEPTH_SIGMAS * sigma, voxel * module.RADIUS_VOXELS, voxel * module.MOST_DEPTH_VOXELS)
    colours, weights = mesh.colours.copy(), np.zeros((len(mesh.vertices), len(clouds)))
    for index, (vertex, normal) in enumerate(zip(mesh.vertices, mesh.normals, strict=True)):
        for radius in voxel * module.RADIUS_VOXELS * np.array([1, module.WIDENED]):
            sums = np.zeros((len(clouds), 3))
            for number, cloud in enumerate(clouds):
                away = (cloud.points - vertex) @ normal
                beside = 1 - (((cloud.points - vertex) ** 2).sum(axis=1) - away**2) / radius**2
                facing = cloud.normals @ normal
                counts = (beside > 0) & (np.abs(away) < depth) & (facing >= module.SAME_SIDE)
                weight = np.where(counts, beside**2 * (1 - (away / depth) ** 2) * facing, 0)
                weights[index, number] = weight.sum()
                sums[number] = weight @ cloud.colours
            if weights[index].any():
                shares = weights[index] ** (module.VIEW_POWER - 1)
                colours[index] = np.rint(shares @ sums / (weights[index] ** module.VIEW_POWER).sum())
                break
    return colours, weights


@pytest.mark.parametrize("noise_mm", [0.0, 1.0])
def test_colours_and_supports_are_those_of_a_comparison_with_every_point(noise_mm: float) -> None:
    clouds = [flat_cloud(noise_mm=noise_mm), flat_cloud(noise_mm=noise_mm, seed=3, n=1500)]
    mesh = some_vertices(clouds[0], 200)
    colours, weights = reference(mesh, clouds, 1.1)
    found = colour_vertices(mesh, clouds, 1.1).colours
    assert np.abs(found.astype(int) - colours).max() <= 1
    assert supports(mesh, clouds, 1.1) == pytest.approx(weights, rel=1e-3, abs=1e-3)


def test_a_vertex_without_points_beside_it_keeps_its_colour() -> None:
    cloud = flat_cloud(noise_mm=0.0)
    mesh = some_vertices(cloud, 20)
    far = replace(mesh, vertices=mesh.vertices + np.float32([0, 0, 500]))
    assert (colour_vertices(far, [cloud], 1.0).colours == 7).all()


def test_depth_noise_smooths_the_shape_and_not_the_picture() -> None:
    cloud = flat_cloud(noise_mm=2.0, n=20000)
    mesh = surface_from_cloud(cloud, SurfaceParameters(voxel_mm=1.0))
    inner = ((mesh.vertices[:, :2] > 8) & (mesh.vertices[:, :2] < 52)).all(axis=1)
    assert np.abs(mesh.vertices[inner, 2] - 20).std() < 0.5, "a quarter of the noise"
    from_edge = np.abs((mesh.vertices[inner, 0] + STRIPE_MM / 2) % STRIPE_MM - STRIPE_MM / 2)
    is_white = np.floor(mesh.vertices[inner, 0] / STRIPE_MM) % 2 == 1
    middles = from_edge > STRIPE_MM / 2 - 0.6
    shades = mesh.colours[inner, 0].astype(float)
    assert shades[middles & is_white].mean() > 205
    assert shades[middles & ~is_white].mean() < 35


def test_the_clouds_that_colour_are_chosen_and_all_support() -> None:
    near, dark = (
        flat_cloud(noise_mm=0.0),
        replace(flat_cloud(noise_mm=0.0, seed=3), colours=np.zeros((6000, 3), np.uint8)),
    )
    mesh = some_vertices(near, 200)
    points = beside([dark, near], 1.1)
    colours, weights = points.gather(mesh.vertices, mesh.normals, mesh.colours, range(1, 2))
    assert np.array_equal(colours, colour_vertices(mesh, [near], 1.1).colours)
    assert np.array_equal(weights, supports(mesh, [dark, near], 1.1))
