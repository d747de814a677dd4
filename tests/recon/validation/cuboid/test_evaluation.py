"""Cuboids of known size against simulated clouds and the studio's own truth."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from recon.capture.rectify import rectify
from recon.cli.main import app
from recon.geometry.mesh_files import read_mesh
from recon.studio import SynthParameters, synthesise
from recon.studio.objects import ball
from recon.studio.truth import MESH, read_depth
from recon.validation.clouds import FitError, named_clouds, read_measured
from recon.validation.cuboid import evaluation
from recon.validation.cuboid.edges import end_of_points
from recon.validation.cuboid.evaluation import CuboidSettings, measure_cuboids
from recon.validation.cuboid.fit import fit_cuboid
from recon.validation.cuboid.model import CuboidFit
from recon.validation.views.between_sensors import depth_points
from recon.validation.views.novel_view import true_disparity

SIZE = (300.0, 200.0, 400.0)


def corner_cloud(
    seed: int, *, sigma: float = 6.0, n: int = 40_000, outliers: float = 0.05, size: tuple[float, float, float] = SIZE
) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.float64]]:
    """Three faces of a box seen from outside with noise and outliers; the points, its axes as rows and its middle."""
    rng = np.random.default_rng(seed)
    half, towards = np.array(size) / 2, np.abs(rng.normal(size=3)) + 0.5
    towards /= np.linalg.norm(towards)
    seen = np.array([size[(k + 1) % 3] * size[(k + 2) % 3] * towards[k] for k in range(3)])
    faces = []
    for axis, count in enumerate((n * seen / seen.sum()).astype(int)):
        face = rng.uniform(-1, 1, (count, 3)) * half
        face[:, axis] = half[axis]
        faces.append(face)
    points = np.concatenate(faces)
    points += rng.normal(0, sigma, points.shape)
    is_out = rng.random(len(points)) < outliers
    points[is_out] += rng.normal(0, 40, (np.count_nonzero(is_out), 1)) * towards
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    axes[2] *= np.linalg.det(axes)
    middle = rng.uniform(-300, 300, 3)
    return (points @ axes + middle).astype(np.float32), axes, middle


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_angles_edges_and_place_are_right_at_6_mm_noise(seed: int) -> None:
    points, axes, middle = corner_cloud(seed)
    fit = fit_cuboid(points, SIZE)
    assert np.linalg.norm(fit.centre - middle) < 0.5
    assert np.abs(np.abs(np.sum(fit.axes * axes, axis=1)) - 1).max() < 1e-5
    assert len(fit.dihedral_angles()) == 3
    assert max(abs(angle - 90) for *_, angle in fit.dihedral_angles()) < 0.5
    assert len(fit.edges) == 3
    assert np.mean([abs(edge.length - SIZE[edge.axis]) for edge in fit.edges]) < 1.5


@pytest.mark.slow
def test_without_noise_everything_is_exact() -> None:
    points, _, middle = corner_cloud(7, sigma=0.0, outliers=0.0)
    fit = fit_cuboid(points, SIZE)
    assert np.linalg.norm(fit.centre - middle) < 0.01
    assert max(abs(angle - 90) for *_, angle in fit.dihedral_angles()) < 0.001
    assert max(np.abs(fit.errors(points))) < 0.01


def test_a_bent_corner_is_measured_as_it_is() -> None:
    points, axes, middle = corner_cloud(3, sigma=1.0, outliers=0.0)
    u = (points - middle) @ axes.T
    on_first = np.abs(u[:, 0] - SIZE[0] / 2) < 4
    u[on_first, 0] += np.tan(np.deg2rad(2.0)) * u[on_first, 1]  # its face turned by two degrees towards the second
    fit = fit_cuboid(u @ axes + middle, SIZE)
    angles = {frozenset((a.axis, b.axis)): angle for a, b, angle in fit.dihedral_angles()}
    assert abs(angles[frozenset((0, 1))] - 90) == pytest.approx(2.0, abs=0.1)
    assert abs(angles[frozenset((1, 2))] - 90) < 0.1


@pytest.mark.slow
def test_the_order_of_the_size_does_not_matter() -> None:
    points, _, middle = corner_cloud(2)
    fit = fit_cuboid(points, (400.0, 300.0, 200.0))
    assert np.linalg.norm(fit.centre - middle) < 0.5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("points", "message"),
    [
        (300 * np.random.default_rng(1).random((5000, 3)), "no cuboid of"),
        (ball(150.0, 6.0)[0], "no cuboid of"),
        (np.random.default_rng(2).uniform(-1, 1, (5000, 3)) * (200, 150, 0), "only parallel planes"),
        (corner_cloud(5, size=(360.0, 240.0, 480.0))[0], "no cuboid of"),
        (corner_cloud(5)[0] / 1000, "would fit if the cloud were in m"),
        (np.zeros((20, 3)), "has 20 points, expected at least 50"),
        (np.full((100, 3), np.nan), "not a finite number"),
    ],
)  # fmt: skip
def test_what_is_no_such_cuboid_is_refused(points: NDArray[np.float64], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        fit_cuboid(points, SIZE)


def test_the_end_of_blurred_points_is_where_they_would_end_without_blur() -> None:
    rng = np.random.default_rng(1)
    along = rng.uniform(-100, 37.0, 40_000) + rng.normal(0, 6, 40_000)
    end, error = end_of_points(along, 35.0, 1.0, 30.0)
    assert end == pytest.approx(37.0, abs=4 * error)
    assert error < 0.6
    assert np.isnan(end_of_points(rng.uniform(-100, 100, 40_000), 35.0, 1.0, 30.0)[0])


@pytest.mark.slow
def test_sensors_are_measured_alone_and_together(tmp_path: Path) -> None:
    points, _, middle = corner_cloud(4, n=20_000)
    paths = [tmp_path / "1.xyz", tmp_path / "2.xyz", tmp_path / "3.xyz"]
    np.savetxt(paths[0], points[::2])
    np.savetxt(paths[1], points[1::2])
    np.savetxt(paths[2], np.random.default_rng(1).uniform(-300, 300, (3000, 3)))
    place = (float(middle[0]), float(middle[1]), float(middle[2]))
    settings = CuboidSettings(SIZE, (12.5,), positions=(place,))
    report, _ = measure_cuboids(named_clouds(paths[:2], ("S1", "S2")), settings)
    assert [row["name"] for row in report["reconstructions"]] == ["1/S1", "1/S2", "1/combined"]
    assert report["reconstructions"][2]["position_error_mm"] < 0.5
    assert report["reconstructions"][0]["from_combined_mm"] < 0.5
    broken, _ = measure_cuboids(named_clouds([paths[0], paths[2]], ("S1", "S2")), settings)
    assert "1/S2" in broken["failed"]
    with pytest.raises(FitError, match="no cuboid was found in any of 1 clouds"):
        measure_cuboids(named_clouds(paths[2:], ()), settings)


@pytest.mark.slow
def test_the_command_reads_each_cloud_once_and_fits_each_choice_of_sensors_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = corner_cloud(4, n=20_000)[0]
    paths = [tmp_path / "1.xyz", tmp_path / "2.xyz"]
    np.savetxt(paths[0], points[::2])
    np.savetxt(paths[1], points[1::2])
    clouds = [read_measured(path) for path in paths]
    reads, fits = Counter[Path](), Counter[bytes]()

    def fit(points: NDArray[np.float32], size: tuple[float, float, float], seed: int) -> CuboidFit:
        fits[points.tobytes()] += 1
        return fit_cuboid(points, size, seed)

    def read(path: Path, unit: str) -> NDArray[np.float32]:
        reads[path] += 1
        return read_measured(path, unit)

    monkeypatch.setattr(evaluation, "read_measured", read)
    monkeypatch.setattr(evaluation, "fit_cuboid", fit)
    words = ["validate", "cuboid", *map(str, paths), "--size", "300x200x400", "--sensor", "S1", "--sensor", "S2"]
    result = CliRunner().invoke(app, [*words, "-o", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    assert reads == Counter(paths)
    assert fits == Counter([cloud.tobytes() for cloud in (*clouds, np.concatenate(clouds))])


@pytest.mark.slow
def test_the_command_writes_a_whole_report(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "cloud.xyz", corner_cloud(1, n=20_000)[0])
    out = tmp_path / "out"
    words = ["validate", "cuboid", str(tmp_path / "cloud.xyz"), "--size", "300x200x400", "-o", str(out)]
    result = CliRunner().invoke(app, [*words, "--approach", "pm_fb", "--json"])
    assert result.exit_code == 0, result.output
    report = json.loads(result.stdout)
    assert {row["measure"] for row in report["measures"]} == {
        "cuboid inliers within 12.5 mm", "cuboid flatness", "cuboid angle error", "cuboid edge error"
    }  # fmt: skip
    for name in ("report.json", "faces.csv", "edges.csv", "angles.csv", "curve.svg", "cuboid_1_S1.png", "report.html"):
        assert (out / name).stat().st_size > 0
    assert CliRunner().invoke(app, [*words[:4], "300x200", "-o", str(out)]).exit_code == 2


@pytest.mark.slow
def test_the_studios_cuboid_is_where_the_studio_put_it(tmp_path: Path) -> None:
    place = (40.0, -30.0, 60.0)
    parameters = SynthParameters(scene="cuboid", n_sensors=1, n_frames=1, size=(640, 360), position=place)
    capture = synthesise(tmp_path / "cuboid", parameters)
    stream = capture.sensors[0]
    view = rectify(stream.sensor, capture.bounds)
    disparity = true_disparity(read_depth(capture, stream.id, "left", 0), stream.left.camera, view)
    a, b, c = capture.object["size_mm"]
    fit = fit_cuboid(depth_points(disparity, view, capture.bounds), (a, b, c))
    vertices = read_mesh(capture.folder / MESH.format(frame=0)).vertices
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    assert np.linalg.norm(fit.centre - middle) < 0.1
    assert max(abs(angle - 90) for *_, angle in fit.dihedral_angles()) < 0.05
    assert np.abs(fit.errors(vertices)).max() < 0.1
