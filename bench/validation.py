"""Validation measured: fits of spheres and cuboids, the exclusion rule, F-scores, and the studio's ball reconstructed.

Caps and corners are simulated: the truth is known; seeds differ from those that the rule's limits were set with.
Peers (pyransac3d, Open3D) run beside ours where they are installed.
Run as `python bench/validation.py [fits exclusion cuboids f-score studio] [--points N] [--seeds N] [--balls N]`.
"""

from __future__ import annotations

import argparse
import importlib.util
import random
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.capture.masks.segment import segment_capture
from recon.geometry.mesh import Shape
from recon.pipeline.job import ReconstructOptions
from recon.pipeline.reconstruct import reconstruct
from recon.pipeline.run import View
from recon.studio import SynthParameters, synthesise
from recon.studio.objects import ball
from recon.surface import SurfaceParameters
from recon.validation.clouds import FitError, named_clouds
from recon.validation.cuboid.fit import fit_cuboid
from recon.validation.sampling import subsample
from recon.validation.sphere.cells import cap_of
from recon.validation.sphere.evaluation import measure_spheres
from recon.validation.sphere.exclusion import Parts, examine_parts, findings
from recon.validation.sphere.fit.consensus import fit_sphere
from recon.validation.sphere.fit.methods import METHODS
from recon.validation.sphere.fit.model import SphereFit, SphereSettings
from recon.validation.triangles import TriangleTree
from recon.validation.truth.evaluation import compare_points, sample_evenly

sys.path.insert(0, str(Path(__file__).parent.parent))
from tests.recon.validation.sphere.simulated_caps import SPOILS, UNSEEN_SPOILS, CapParameters, simulate_cap

RADIUS = 150.0
AZIMUTHS = np.deg2rad((-42.0, 0.0, 42.0))
FIRST_SEED = 70_000
PEER_TRIALS = 200
SENSORS = ("S1", "S2", "S3")
UNUSED_VOXEL_MM = 12.0  # of meshes that nobody looks at
STUDIO_MIDDLE = np.array([0.0, 1100.0, 0.0])  # mm, of the working volume


def fits(n_points: int, n_seeds: int) -> None:
    """Print centre errors and processor time of every method."""
    print(f"centre error, mm, and processor time on {n_points} points, {n_seeds} seeds a row")
    for method, fit in METHODS.items():
        fit(simulate_cap(CapParameters(n_points=2000), np.random.default_rng(0))[0], RADIUS, 1)  # compiles
        for opening, outliers, step in ((120, 0.05, 0), (120, 0.2, 8), (120, 0.4, 0), (120, 0.4, 8), (90, 0.2, 0)):
            errors, seconds, failed = [], [], 0
            for seed in range(n_seeds):
                rng = np.random.default_rng((FIRST_SEED + seed, opening))
                parameters = CapParameters(n_points=n_points, opening_deg=opening, outliers=outliers, depth_step=step)
                points, centre = simulate_cap(parameters, rng)
                started = time.process_time()
                try:
                    fitted = fit(points, RADIUS, 1)
                except FitError:
                    failed += 1
                    continue
                seconds.append(time.process_time() - started)
                errors.append(float(np.linalg.norm(fitted.centre - centre)))
            worst = f"median {np.median(errors):.3f} worst {max(errors):.3f}" if errors else "none"
            took = f"{1e3 * np.median(seconds):.0f} ms" if seconds else "-"
            print(
                f"  {method:9} cap {opening:3} deg, outliers {outliers:4.0%}, step {step} mm: {worst}, {took}, "
                f"failed {failed}"
            )


Seen = dict[str, tuple[SphereFit, Parts, float]]
"""Fit, parts and centre error per sensor, of one placed ball."""


def exclusion(n_seeds: int) -> None:
    """Print caught and dropped reconstructions per kind of failure, three sensors a ball, one of them spoilt."""
    print(f"exclusion rule, {n_seeds} balls a row; biased: the spoilt fits that are off by more than 1 mm")
    total = Counter[str]()
    for spoil in (*SPOILS, *UNSEEN_SPOILS):
        counts = _judged([_ball(seed, spoil) for seed in range(n_seeds)], spoil)
        print(
            f"  {spoil:7} caught {counts['caught']} of {counts['spoilt']}, of {counts['biased']} biased "
            f"{counts['caught_biased']}; good dropped {counts['dropped']} of {counts['good']}"
        )
        if spoil in SPOILS:
            total += counts
    print(
        f"  together, {', '.join(SPOILS[1:])}: caught {total['caught'] / total['spoilt']:.0%} of {total['spoilt']}, "
        f"good dropped {total['dropped'] / total['good']:.1%} of {total['good']}"
    )


def _judged(balls: list[tuple[Seen, str]], spoil: str) -> Counter[str]:
    """How many reconstructions there are of each sort, and how many of them the rule leaves out."""
    counts = Counter[str]()
    for seen, bad in balls:
        fits = {name: fit for name, (fit, _, _) in seen.items()}
        verdicts = findings(fits, {name: parts for name, (_, parts, _) in seen.items()})
        for name, (_, _, error) in seen.items():
            is_out = any(not finding.is_remark for finding in verdicts[name])
            if name == bad and spoil != "none":
                counts += Counter(spoilt=1, biased=error > 1, caught=is_out, caught_biased=is_out and error > 1)
            else:
                counts += Counter(good=1, dropped=is_out)
    return counts


def _ball(seed: int, spoil: str) -> tuple[Seen, str]:
    """Fit, shifts and centre error per sensor, and which one is spoilt."""
    rng = np.random.default_rng((FIRST_SEED + seed, len(spoil)))
    bad = int(rng.integers(3))
    seen = {}
    for index, azimuth in enumerate(AZIMUTHS):
        parameters = CapParameters(
            n_points=30_000,
            noise=float(rng.uniform(2, 6)),
            outliers=float(rng.uniform(0.02, 0.2)),
            depth_step=float(rng.choice((0.0, 4.0))),
            spoil=spoil if index == bad else "none",
            spoil_mm=float(rng.uniform(6, 18)),
        )
        points, centre = simulate_cap(parameters, rng, np.array([np.sin(azimuth), 0.1, np.cos(azimuth)]))
        points = (points - centre).astype(np.float32)
        try:
            fit = fit_sphere(points, RADIUS)
        except FitError:
            continue
        seen[f"S{index}"] = (
            fit,
            examine_parts(cap_of(subsample(points, 1), fit), fit),
            float(np.linalg.norm(fit.centre)),
        )
    return seen, f"S{bad}"


def peer_fits(n_points: int, n_seeds: int) -> None:
    """Print what pyransac3d makes of the same caps, if it is there."""
    if importlib.util.find_spec("pyransac3d") is None:
        print("  pyransac3d is not installed")
        return
    import pyransac3d

    for outliers in (0.05, 0.2, 0.4):
        errors, seconds = [], []
        for seed in range(n_seeds):
            rng = np.random.default_rng((FIRST_SEED + seed, 120))
            points, centre = simulate_cap(CapParameters(n_points=n_points, outliers=outliers), rng)
            random.seed(seed)  # pyransac3d draws from it
            started = time.process_time()
            fitted, _, _ = pyransac3d.Sphere().fit(points.astype(np.float64), thresh=12.5, maxIteration=PEER_TRIALS)
            seconds.append(time.process_time() - started)
            errors.append(float(np.linalg.norm(np.ravel(fitted) - centre)))
        print(
            f"  pyransac3d cap 120 deg, outliers {outliers:4.0%}: median {np.median(errors):.1f} "
            f"worst {max(errors):.1f}, {np.median(seconds):.1f} s"
        )


def cuboids(n_seeds: int) -> None:
    """Print errors of angles, edges and place of corners of boxes with 6 mm of noise."""
    print(f"cuboids, 60 000 points of three faces, 6 mm noise, 5 % outliers, {n_seeds} seeds a row")
    for size in ((300.0, 200.0, 400.0), (400.0, 250.0, 250.0), (200.0, 200.0, 200.0)):
        angles, edges, places, seconds = [], [], [], []
        for seed in range(n_seeds):
            points, centre = _corner(size, np.random.default_rng((FIRST_SEED + seed, 3)))
            started = time.process_time()
            fit = fit_cuboid(points, size)
            seconds.append(time.process_time() - started)
            angles += [abs(angle - 90) for *_, angle in fit.dihedral_angles()]
            edges += [abs(edge.length - size[edge.axis]) for edge in fit.edges]
            places.append(float(np.linalg.norm(fit.centre - centre)))
        errors = ", ".join(
            f"{name} median {np.median(values):.2f} worst {max(values):.2f} {unit}"
            for name, values, unit in (("angles", angles, "deg"), ("edges", edges, "mm"), ("place", places, "mm"))
        )
        print(f"  {'x'.join(f'{edge:g}' for edge in size)}: {errors}; {np.median(seconds):.1f} s of processor time")


def _corner(
    size: tuple[float, float, float], rng: np.random.Generator
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Three faces of a box as seen from outside, somewhere, and its middle."""
    half, towards = np.array(size) / 2, np.abs(rng.normal(size=3)) + 0.35
    towards /= np.linalg.norm(towards)
    seen = np.array([size[(axis + 1) % 3] * size[(axis + 2) % 3] * towards[axis] for axis in range(3)])
    faces = []
    for axis, count in enumerate((60_000 * seen / seen.sum()).astype(int)):
        face = rng.uniform(-1, 1, (count, 3)) * half
        face[:, axis] = half[axis]
        faces.append(face)
    points = np.concatenate(faces)
    points += rng.normal(0, 6.0, points.shape)
    is_out = rng.random(len(points)) < 0.05
    points[is_out] += rng.normal(0, 40.0, (np.count_nonzero(is_out), 1)) * towards
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    middle = rng.uniform(-300, 300, 3)
    return (points @ axes + middle).astype(np.float32), middle


def f_score() -> None:
    """Print the time of an F-score of 250 000 points against as many, and of distances to triangles."""
    rng = np.random.default_rng(FIRST_SEED)
    vertices, faces = ball(150.0, 3.0)
    shape = Shape(vertices, faces)
    points, truth = (sample_evenly(shape, 250_000, rng) for _ in range(2))
    points += rng.normal(0, 1, points.shape)
    tree = TriangleTree(vertices, faces)
    tree.nearest(points[:1000])  # compiles
    ways: dict[str, Callable[[], object]] = {
        "points to points, both ways": lambda: compare_points(points, truth, [1.0, 2.0]),
        f"points to {len(faces)} triangles": lambda: tree.nearest(points),
        "the triangles' tree": lambda: TriangleTree(vertices, faces),
    }
    if _has_open3d():
        ways["Open3D, points to points, both ways"] = lambda: _open3d_distances(points, truth)
    print("F-score, 250 000 points against 250 000")
    for name, way in ways.items():
        seconds = []
        for _ in range(3):
            started = time.perf_counter()
            way()
            seconds.append(time.perf_counter() - started)
        print(f"  {name}: {np.median(seconds):.2f} s")


def _has_open3d() -> bool:
    try:
        import open3d
    except ImportError as error:  # also where one of the packages that it wants is missing
        print(f"Open3D cannot be used: {error}")
        return False
    return bool(open3d.__version__)


def _open3d_distances(points: NDArray[np.float64], truth: NDArray[np.float64]) -> None:
    import open3d

    one, other = (open3d.geometry.PointCloud(open3d.utility.Vector3dVector(side)) for side in (points, truth))
    one.compute_point_cloud_distance(other)
    other.compute_point_cloud_distance(one)


def studio(n_positions: int, methods: tuple[str, ...], kept: Path | None) -> None:
    """Reconstruct the studio's ball at many places, and evaluate it in one call for each depth method."""
    rng = np.random.default_rng(FIRST_SEED)
    offsets = [np.zeros(3), *rng.uniform(-250, 250, (n_positions - 1, 3)).round(1)]
    print(f"the studio's ball at {n_positions} places, three sensors, 1280x720")
    with tempfile.TemporaryDirectory() as temporary:
        folder = kept or Path(temporary)
        for number, offset in enumerate(offsets):
            _clouds_of_ball(folder / f"{number:02d}", offset, number, methods)
        for method in methods:
            clouds = [folder / f"{number:02d}/{method}_{s}.ply" for number in range(n_positions) for s in SENSORS]
            settings = SphereSettings(RADIUS, (5.0, 12.5))
            report, _ = measure_spheres(named_clouds(clouds, SENSORS), settings)
            _print_studio(method, report, offsets)


def _clouds_of_ball(out: Path, offset: NDArray[np.float64], seed: int, methods: tuple[str, ...]) -> None:
    """Write `<method>_<sensor>.ply` of the ball at one place, but for what is there already."""
    missing = tuple(m for m in methods if not all((out / f"{m}_{sensor}.ply").exists() for sensor in SENSORS))
    if not missing:
        return
    x, y, z = map(float, offset)
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as temporary:
        capture, run = Path(temporary) / "capture", Path(temporary) / "run"
        synthesise(capture, SynthParameters(scene="sphere", n_frames=1, position=(x, y, z), seed=seed))
        segment_capture(capture)
        surface = SurfaceParameters(voxel_mm=UNUSED_VOXEL_MM)
        reconstruct(capture, run, ReconstructOptions(missing, ("fb",), temporal=None, surface=surface))
        for method in missing:
            for sensor in SENSORS:
                shutil.copy(run / View(method, sensor, 0).cloud, out / f"{method}_{sensor}.ply")


def _print_studio(method: str, report: dict[str, Any], offsets: list[NDArray[np.float64]]) -> None:
    rows = report["reconstructions"]
    fitted = [row for row in rows if "centre_mm" in row]
    errors = [np.linalg.norm(row["centre_mm"] - STUDIO_MIDDLE - offsets[row["sample"] - 1]) for row in fitted]
    for subset in ("all", "used"):
        ratios = [r for r in report["curve"] if (r["sensor"], r["subset"]) == ("combined", subset)]
        shares = ", ".join(f"within {row['threshold_mm']:g} mm {row['inliers']:.1%}" for row in ratios)
        print(f"  {method}, {subset}: {shares}")
    print(
        f"  {method}: centre off by median {np.median(errors):.2f} worst {max(errors):.2f} mm; left out "
        f"{len(report['excluded'])} of {len(rows)}, failed {len(report['failed'])}"
    )
    for row in report["excluded"]:
        print(f"    {row['name']}: {'; '.join(row['reasons'])}")


PARTS = ("fits", "exclusion", "cuboids", "f-score", "studio")

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", help=f"of {', '.join(PARTS)}; default: all")
    parser.add_argument("--points", type=int, default=1_000_000)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--balls", type=int, default=30)
    parser.add_argument("--positions", type=int, default=29)
    parser.add_argument("--depth", default="id,dr")
    parser.add_argument("--clouds", type=Path, help="folder that keeps the studio's clouds for the next time")
    arguments = parser.parse_args()
    wanted = arguments.parts or PARTS
    if "fits" in wanted:
        fits(arguments.points, arguments.seeds)
        peer_fits(arguments.points, arguments.seeds)
    if "exclusion" in wanted:
        exclusion(arguments.balls)
    if "cuboids" in wanted:
        cuboids(arguments.seeds)
    if "f-score" in wanted:
        f_score()
    if "studio" in wanted:
        studio(arguments.positions, tuple(arguments.depth.split(",")), arguments.clouds)
