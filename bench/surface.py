"""Surfaces of a simulated actor: time, error, components and memory, beside MeshLab and Open3D where they are there.

The actor is a smooth union of capsules, seen by three sensors 2.5 m away with disparity noise and outliers, so that the
error of every vertex to the true surface is known. Run as `python bench/surface.py [--seeds N] [--points N]`.
"""

from __future__ import annotations

import argparse
import importlib.util
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from memory import memory_mb
from numba import njit, prange
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.capture.rectify import Rectification
from recon.cloud import CloudParameters, back_project, cloud_from_disparity, fit_planes, merge_clouds
from recon.fusion import fuse_after, fuse_before
from recon.geometry.mesh import Cloud, Mesh
from recon.geometry.rig import Camera, look_at, rigid
from recon.surface import SurfaceParameters
from recon.surface.components import component_labels

DISTANCE = 2500.0  # mm
SENSOR_ANGLES = (-50.0, 0.0, 50.0)  # degrees
BASELINE = 200.0
PIXELS_PER_MILLION = 1945.0  # focal length at which the three sensors see one million points together
DISPARITY_SIGMA = 0.5  # pixels: 8 mm of depth at 2.5 m
OUTLIERS = 0.005
OUTLIER_DEPTH = 300.0
FAR_NEIGHBOURS = 1.5  # times the median distance: removed for MeshLab
MESHLAB_SCALES = (4.0, 6.0, 10.0)
COLUMNS = ("s", "cpu s", "mean mm", "p95 mm", "components", "outside %", "vertices")
REPEATS = 3  # of a method that takes less than QUICK seconds; the best counts
QUICK = 5.0
BLEND = 40.0  # mm, of the smooth union
# Ends and radius of each capsule, mm, y up.
CAPSULES = np.array(
    [
        [0, 950, 0, 0, 1330, 0, 130],
        [-40, 940, 0, 40, 940, 0, 125],
        [0, 1450, 0, 0, 1500, 10, 62],
        [0, 1600, 15, 0, 1640, 15, 88],
        [-170, 1380, 0, -330, 1150, 40, 50],
        [-330, 1150, 40, -380, 930, 180, 40],
        [170, 1380, 0, 420, 1420, 90, 50],
        [420, 1420, 90, 520, 1620, 200, 40],
        [-90, 880, 0, -130, 480, 30, 78],
        [-130, 480, 30, -140, 90, -20, 55],
        [90, 880, 0, 150, 480, 50, 78],
        [150, 480, 50, 170, 90, 0, 55],
        [-140, 45, -20, -150, 40, 110, 42],
        [170, 45, 0, 190, 40, 130, 42],
    ],
    dtype=np.float64,
)


@njit(cache=True)
def actor(capsules: NDArray[np.float64], blend: float, x: float, y: float, z: float) -> float:
    """Signed distance (nearly) to the smooth union, mm."""
    total = 0.0
    nearest = 1e9
    for capsule in range(len(capsules)):
        ax, ay, az, bx, by, bz, radius = capsules[capsule]
        dx, dy, dz = bx - ax, by - ay, bz - az
        t = ((x - ax) * dx + (y - ay) * dy + (z - az) * dz) / (dx * dx + dy * dy + dz * dz)
        t = min(max(t, 0.0), 1.0)
        distance = np.sqrt((x - ax - t * dx) ** 2 + (y - ay - t * dy) ** 2 + (z - az - t * dz) ** 2) - radius
        nearest = min(nearest, distance)
        total += np.exp(-min(distance, 2000.0) / (0.25 * blend))
    return -0.25 * blend * np.log(total) if total > 1e-30 else nearest


@njit(parallel=True, cache=True)
def signed_distances(
    capsules: NDArray[np.float64], blend: float, points: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distance (N,) of points to the true surface, corrected by the gradient's length, and the gradient (N, 3)."""
    distances = np.empty(len(points))
    gradients = np.empty((len(points), 3))
    for index in prange(len(points)):
        x, y, z = points[index]
        here = actor(capsules, blend, x, y, z)
        gradients[index, 0] = (actor(capsules, blend, x + 0.1, y, z) - actor(capsules, blend, x - 0.1, y, z)) / 0.2
        gradients[index, 1] = (actor(capsules, blend, x, y + 0.1, z) - actor(capsules, blend, x, y - 0.1, z)) / 0.2
        gradients[index, 2] = (actor(capsules, blend, x, y, z + 0.1) - actor(capsules, blend, x, y, z - 0.1)) / 0.2
        distances[index] = here / np.sqrt((gradients[index] ** 2).sum())
    return distances, gradients


@njit(parallel=True, cache=True)
def trace(
    capsules: NDArray[np.float64], blend: float, centre: NDArray[np.float64], rays: NDArray[np.float64], near: float,
    far: float,
) -> NDArray[np.float64]:  # fmt: skip
    """Depth (H, W) along rays of depth 1 (H, W, 3), NaN where they miss the actor."""
    depth = np.full(rays.shape[:2], np.nan)
    for row in prange(rays.shape[0]):
        for column in range(rays.shape[1]):
            ray = rays[row, column]
            length = np.sqrt((ray**2).sum())
            z = near
            while z < far:
                step = actor(capsules, blend, centre[0] + z * ray[0], centre[1] + z * ray[1], centre[2] + z * ray[2])
                if step < 0.01:
                    depth[row, column] = z
                    break
                z += step / length
    return depth


@dataclass(frozen=True)
class View:
    """What one sensor measures: a disparity map and its picture."""

    rectification: Rectification
    disparity: NDArray[np.float32]
    image: NDArray[np.uint8]


def simulate(n_points: int, seed: int) -> list[View]:
    """The actor as the three sensors see it."""
    rng = np.random.default_rng(seed)
    return [_view(angle, PIXELS_PER_MILLION * (n_points / 1e6) ** 0.5, rng) for angle in SENSOR_ANGLES]


def _view(angle_deg: float, focal: float, rng: np.random.Generator) -> View:
    angle = np.radians(angle_deg)
    centre = np.array([DISTANCE * np.sin(angle), 1000.0, DISTANCE * np.cos(angle)])
    pose = look_at(centre, (0.0, 900.0, 0.0))
    size = (int(focal * 0.5), int(focal * 0.8))
    K = np.array([[focal, 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1]])
    maps = (np.zeros(size[::-1], np.float32), np.zeros(size[::-1], np.float32))
    left, right = Camera(K, size, pose), Camera(K, size, rigid(np.eye(3), (-BASELINE, 0, 0)) @ pose)
    rectification = Rectification(f"S{angle_deg:+.0f}", left, right, 256, maps, maps)
    columns, rows = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    pixels = np.stack([columns, rows, np.ones_like(rows)], axis=-1)
    rays = pixels @ np.linalg.inv(K).T @ left.rotation
    depth = trace(CAPSULES, BLEND, centre, rays, DISTANCE - 900, DISTANCE + 900)
    image = _texture(centre + depth[..., None] * rays)
    outlier = rng.random(depth.shape) < OUTLIERS
    depth += np.where(outlier, rng.uniform(-OUTLIER_DEPTH, OUTLIER_DEPTH, depth.shape), 0)
    disparity = focal * BASELINE / depth + rng.normal(0, DISPARITY_SIGMA, depth.shape)
    return View(rectification, disparity.astype(np.float32), image)


def _texture(points: NDArray[np.float64]) -> NDArray[np.uint8]:
    """A smooth pattern, sRGB."""
    waves = [np.sin(np.nan_to_num(points[..., axis]) / period) for axis, period in ((0, 30), (1, 45), (2, 25))]
    return np.stack([127 + 100 * wave for wave in waves], axis=-1).astype(np.uint8)


def raw_cloud(view: View) -> Cloud:
    """Every valid pixel, outliers and rims included; normals from the grid, towards the sensor where there is none."""
    camera = view.rectification.left
    rows, columns = np.nonzero(np.isfinite(view.disparity))
    planes = fit_planes(view.disparity, rows, columns, CloudParameters().normal_radius, CloudParameters().jump_px)
    intrinsics = camera.K[[0, 1, 0, 1], [0, 1, 2, 2]]
    points, normals, _, _ = back_project(
        view.disparity, rows, columns, planes, intrinsics, view.rectification.focal * BASELINE, 0.1
    )
    normals = np.where(np.isnan(planes[:, :1]), -points / np.linalg.norm(points, axis=1, keepdims=True), normals)
    points, normals = points @ camera.rotation + camera.centre, normals @ camera.rotation
    return Cloud(points.astype(np.float32), normals.astype(np.float32), view.image[rows, columns])


def ours_fb(clouds: list[Cloud], voxel: float) -> Mesh:
    return fuse_before(clouds, SurfaceParameters(voxel_mm=voxel))


def ours_fa(clouds: list[Cloud], voxel: float) -> Mesh:
    return fuse_after(clouds, SurfaceParameters(voxel_mm=voxel))


def meshlab(scale: float) -> Callable[[list[Cloud], float], Mesh]:
    """MeshLab's APSS marching cubes, at its best after thinning to the voxel and removing outliers."""

    def run(clouds: list[Cloud], voxel: float) -> Mesh:
        import pymeshlab

        points, normals = _filtered(*_thinned(merge_clouds(clouds), voxel))
        meshes = pymeshlab.MeshSet(verbose=False)
        meshes.add_mesh(pymeshlab.Mesh(vertex_matrix=points, v_normals_matrix=normals))
        size = float((points.max(axis=0) - points.min(axis=0)).max())
        meshes.generate_marching_cubes_apss(filterscale=scale, resolution=int(np.ceil(size / voxel)))
        mesh = meshes.current_mesh()
        return _uncoloured(mesh.vertex_matrix(), mesh.face_matrix(), mesh.vertex_normal_matrix())

    return run


def _thinned(cloud: Cloud, cell: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean point and normal of every cell that holds points."""
    cells = np.floor(cloud.points / cell).astype(np.int64) + 2**19
    _, number = np.unique(cells @ [2**40, 2**20, 1], return_inverse=True)
    sums = [np.bincount(number, values[:, axis]) for values in (cloud.points, cloud.normals) for axis in range(3)]
    points = np.stack(sums[:3], axis=1) / np.bincount(number)[:, None]
    normals = np.stack(sums[3:], axis=1)
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _filtered(
    points: NDArray[np.float64], normals: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Without points that are far from their eight nearest neighbours."""
    distance = np.asarray(cKDTree(points).query(points, k=9)[0]).mean(axis=1)
    near = distance < FAR_NEIGHBOURS * np.median(distance)
    return points[near], normals[near]


def poisson(clouds: list[Cloud], _: float) -> Mesh:
    """Open3D's screened Poisson reconstruction, depth 9, the least supported 15 % trimmed."""
    import open3d

    cloud = merge_clouds(clouds)
    theirs = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(cloud.points.astype(np.float64)))
    theirs.normals = open3d.utility.Vector3dVector(cloud.normals.astype(np.float64))
    theirs.colors = open3d.utility.Vector3dVector(cloud.colours / 255)
    mesh, density = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(theirs, depth=9)
    mesh.remove_vertices_by_mask(np.asarray(density) < np.quantile(np.asarray(density), 0.15))
    mesh.compute_vertex_normals()
    return _uncoloured(np.asarray(mesh.vertices), np.asarray(mesh.triangles), np.asarray(mesh.vertex_normals))


def _uncoloured(vertices: NDArray[np.float64], faces: NDArray[np.int32], normals: NDArray[np.float64]) -> Mesh:
    smooth = np.nan_to_num(normals).astype(np.float32)
    return Mesh(vertices.astype(np.float32), faces, smooth, np.zeros((len(vertices), 3), np.uint8))


def measure(
    name: str, method: Callable[[list[Cloud], float], Mesh], clouds: list[Cloud], voxel: float
) -> dict[str, float]:
    """Time and error of one method on one cloud, printed as a line; `cpu s` is what a busy machine does not change."""
    seconds = cpu = np.inf
    for _ in range(REPEATS):
        start, cpu_start = time.perf_counter(), time.process_time()
        mesh = method(clouds, voxel)
        seconds = min(seconds, time.perf_counter() - start)
        cpu = min(cpu, time.process_time() - cpu_start)
        if seconds > QUICK:
            break
    error = np.abs(signed_distances(CAPSULES, BLEND, mesh.vertices.astype(np.float64))[0])
    labels = component_labels(mesh.faces, len(mesh.vertices))
    sizes = np.bincount(labels)
    used = np.unique(labels[mesh.faces[:, 0]])
    outside = 100 * (1 - sizes[used].max() / sizes[used].sum())
    values = (seconds, cpu, error.mean(), np.percentile(error, 95), len(used), outside, len(mesh.vertices))
    figures = dict(zip(COLUMNS, map(float, values), strict=True))
    _say(f"  {name:26s}" + "".join(f"{value:12.3f}" for value in figures.values()))
    return figures


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def compare(results: dict[str, list[dict[str, float]]]) -> None:
    """Medians over the seeds, ours against the best of the peers."""
    median = {
        name: {key: float(np.median([run[key] for run in runs])) for key in runs[0]} for name, runs in results.items()
    }
    ours = median["ours FB"]
    _say(f"FB: {ours['s']:.2f} s, mean {ours['mean mm']:.2f} mm, {ours['outside %']:.2f} % outside the main component")
    if "Open3D Poisson" in median:
        _say(f"mean error / Poisson's: {ours['mean mm'] / median['Open3D Poisson']['mean mm']:.2f}")
    meshlabs = [figures for name, figures in median.items() if name.startswith("MeshLab")]
    if meshlabs:
        best = min(meshlabs, key=lambda figures: figures["mean mm"])
        _say(
            f"time / MeshLab's at its best setting: {ours['s'] / best['s']:.3f}, mean error / its: "
            f"{ours['mean mm'] / best['mean mm']:.2f}"
        )


def peak_memory(n_points: int, voxel: float) -> float:
    """Peak resident memory in GB of a fresh process that makes one FB surface."""
    command = [sys.executable, __file__, "--only-surface", str(n_points), str(voxel)]
    return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def only_surface(n_points: int, voxel: float) -> None:
    clouds = [cloud_from_disparity(view.disparity, view.image, view.rectification) for view in simulate(n_points, 0)]
    ours_fb(clouds, voxel)
    sys.stdout.write(f"{memory_mb('VmHWM') / 1024}\n")


def methods() -> dict[str, Callable[[list[Cloud], float], Mesh]]:
    """Ours, and the peers that can be imported."""
    known: dict[str, Callable[[list[Cloud], float], Mesh]] = {"ours FB": ours_fb, "ours FA": ours_fa}
    if importlib.util.find_spec("open3d"):
        known["Open3D Poisson"] = poisson
    if importlib.util.find_spec("pymeshlab"):
        known |= {f"MeshLab APSS, scale {scale:g}": meshlab(scale) for scale in MESHLAB_SCALES}
    return known


def report_clouds(views: list[View], clouds: list[Cloud]) -> list[Cloud]:
    """The clouds as the product makes them, with what that costs and how good their normals are."""
    start = time.perf_counter()
    cleaned = [cloud_from_disparity(view.disparity, view.image, view.rectification) for view in views]
    seconds = time.perf_counter() - start
    merged = merge_clouds(cleaned)
    truth = signed_distances(CAPSULES, BLEND, merged.points.astype(np.float64))[1]
    cosine = (truth * merged.normals).sum(axis=1) / np.linalg.norm(truth, axis=1)
    _say(
        f"  {sum(map(len, clouds))} points; cleaned {len(merged)} in {seconds:.2f} s, "
        f"normals {np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean():.1f} degrees off"
    )
    return cleaned


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--points", type=int, default=1_000_000)
    parser.add_argument("--voxel", type=float, default=5.0)
    parser.add_argument("--only-surface", nargs=2, type=float, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.only_surface:
        only_surface(int(arguments.only_surface[0]), arguments.only_surface[1])
        return
    ours_fb([raw_cloud(view) for view in simulate(20_000, 0)], 20.0)  # compiles
    results: dict[str, list[dict[str, float]]] = {}
    _say(f"  {'':26s}" + "".join(f"{key:>12s}" for key in COLUMNS))
    for seed in range(arguments.seeds):
        _say(f"seed {seed}")
        views = simulate(arguments.points, seed)
        clouds = [raw_cloud(view) for view in views]
        cleaned = report_clouds(views, clouds)
        for name, method in methods().items():
            results.setdefault(name, []).append(measure(name, method, clouds, arguments.voxel))
        for name, method in (("ours FB, cleaned", ours_fb), ("ours FA, cleaned", ours_fa)):
            results.setdefault(name, []).append(measure(name, method, cleaned, arguments.voxel))
    compare(results)
    _say(f"peak memory, 2 million points at 2.5 mm: {peak_memory(2_000_000, 2.5):.2f} GB")


if __name__ == "__main__":
    main()
