"""Accuracy, completeness and F-score against shapes whose distances are known."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from recon.cli.main import app
from recon.geometry.mesh import Cloud, Mesh, Shape
from recon.geometry.mesh_files import read_mesh, write_cloud, write_coloured, write_mesh
from recon.studio import SynthParameters, synthesise
from recon.studio.objects import ball
from recon.validation.cloud_quality import find_compared
from recon.validation.clouds import read_shape
from recon.validation.measures import Subject
from recon.validation.sampling import order_by_cells
from recon.validation.truth.evaluation import (
    MeshSettings,
    compare_points,
    measure_mesh,
    nearest_distances,
    sample_evenly,
)


def square(height: float, side: float = 100.0) -> Mesh:
    corners = np.array([[0, height, 0], [side, height, 0], [side, height, side], [0, height, side]], np.float32)
    up = np.tile(np.array([0, 1, 0], np.float32), (4, 1))
    return Mesh(corners, np.array([[0, 2, 1], [0, 3, 2]], np.int32), up, np.full((4, 3), 128, np.uint8))


def test_distances_are_those_of_the_full_search() -> None:
    rng = np.random.default_rng(1)
    points, others = rng.random((200, 3)), rng.random((300, 3))
    expected = np.linalg.norm(points[:, None] - others, axis=2).min(axis=1)
    assert np.allclose(nearest_distances(points, others), expected)


@pytest.mark.parametrize("points", [np.random.default_rng(2).random((500, 3)) - 0.5, np.ones((4, 3)), np.zeros((0, 3))])
def test_the_order_by_cells_holds_every_row_once_and_neighbours_together(points: NDArray[np.float64]) -> None:
    order = order_by_cells(points)
    assert np.array_equal(np.sort(order), np.arange(len(points)))
    assert np.all(np.diff(np.floor(32 * (points - points.min(axis=0, initial=0)))[order, 0]) >= -1)


def test_scores_follow_their_definition() -> None:
    truth = np.array([[0.0, 0, 0], [10, 0, 0], [20, 0, 0], [30, 0, 0]])
    measured = np.array([[0.0, 1, 0], [10, 4, 0]])
    low, high = compare_points(measured, truth, [2.0, 5.0])["scores"]
    assert (low["precision"], low["recall"]) == (0.5, 0.25)
    assert low["f_score"] == pytest.approx(2 * 0.5 * 0.25 / 0.75)
    assert (high["precision"], high["recall"]) == (1.0, 0.5)


@pytest.mark.slow
def test_filled_holes_count_unless_they_are_left_out(tmp_path: Path) -> None:
    corners = np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 50], [10, 0, 50], [0, 10, 50]], np.float32)
    faces, up = np.array([[0, 1, 2], [3, 4, 5]], np.int32), np.tile([0.0, 0, 1], (6, 1))
    mesh = Mesh(corners, faces, up, np.zeros((6, 3), np.uint8), filled=np.arange(6) > 2)
    path, truth = write_mesh(tmp_path / "mesh.ply", mesh), tmp_path / "truth.ply"
    write_mesh(truth, Mesh(corners, faces[:1], up, mesh.colours))
    means = [
        measure_mesh(path, truth, MeshSettings((1.0,), filled=filled))["accuracy"]["mean_mm"]
        for filled in (True, False)
    ]
    assert means == pytest.approx([25, 0], abs=1)


def by_the_book(rec: NDArray[np.float64], truth: NDArray[np.float64], threshold: float) -> tuple[float, float, float]:
    """Precision, recall and F-score as Tanks and Temples publishes them, point by point and cell by cell, in per cent.

    Source: Knapitsch et al. (2017), equations 1 to 5, and the thinning of both clouds to cells of half the threshold.
    """
    thinned = []
    for points in (rec, truth):
        cells: dict[tuple[int, ...], list[NDArray[np.float64]]] = {}
        low = points.min(axis=0) - threshold / 4
        for point in points:
            cells.setdefault(tuple(int(index) for index in np.floor((point - low) / (threshold / 2))), []).append(point)
        thinned.append(np.array([np.mean(own, axis=0) for own in cells.values()]))
    shares = []
    for points, others in (thinned, thinned[::-1]):
        within = sum(min(np.linalg.norm(others - point, axis=1)) < threshold for point in points)
        shares.append(100.0 * within / len(points))
    precision, recall = shares
    return precision, recall, 2 * precision * recall / (precision + recall)


@pytest.mark.slow
@pytest.mark.parametrize("threshold", [4.0, 8.0])
def test_scores_are_those_of_tanks_and_temples(tmp_path: Path, threshold: float) -> None:
    rng = np.random.default_rng(4)
    truth = rng.uniform(0, 100, (1500, 3)) * (1, 1, 0.02)
    rec = np.concatenate([truth[:900] + rng.normal(0, 3, (900, 3)), rng.uniform(0, 100, (300, 3))])
    for name, points in (("rec", rec), ("truth", truth)):
        np.savetxt(tmp_path / f"{name}.xyz", points)
    settings = MeshSettings((threshold,), cell=threshold / 2)
    (score,) = measure_mesh(tmp_path / "rec.xyz", tmp_path / "truth.xyz", settings)["sampled"]["scores"]
    found = [100 * score[name] for name in ("precision", "recall", "f_score")]
    assert found == pytest.approx(by_the_book(rec, truth, threshold), abs=0.1)


def by_eth3d(
    rec: NDArray[np.float64],
    scan: NDArray[np.float64],
    threshold: float,
    voxel: float,
    scanner: NDArray[np.float64] | None,
) -> tuple[float, float, float]:
    """Accuracy, completeness and F1 as ETH3D defines them, point by point and voxel by voxel, in per cent.

    Source: Schöps et al. (2017), section 4; a beam is 1.125 mm wide at the scanner and spreads by 0.011 degrees.
    """

    def averaged(points: NDArray[np.float64], verdicts: list[bool | None]) -> float:
        shares = []
        for shift in (0.0, 0.5):
            cells: dict[tuple[int, ...], list[bool]] = {}
            for point, verdict in zip(points, verdicts, strict=True):
                if verdict is not None:
                    cells.setdefault(tuple(int(i) for i in np.floor(point / voxel + shift)), []).append(verdict)
            shares += [sum(own) / len(own) for own in cells.values()]
        return 100.0 * sum(shares) / len(shares)

    def judged(point: NDArray[np.float64]) -> bool | None:
        if scanner is None:
            return bool(min(np.linalg.norm(scan - point, axis=1)) <= threshold)
        offset, verdict = point - scanner, None
        radius = 1.125 + np.linalg.norm(offset) * np.tan(np.deg2rad(0.011))
        for met in scan - scanner:
            along = offset @ met / np.linalg.norm(met)
            if along < 0 or np.linalg.norm(offset - along * met / np.linalg.norm(met)) > radius:
                continue
            if np.linalg.norm(met - offset) <= threshold:
                return True
            if along < np.linalg.norm(met):
                verdict = False
        return verdict

    accuracy = averaged(rec, [judged(point) for point in rec])
    completeness = averaged(scan, [bool(min(np.linalg.norm(rec - point, axis=1)) <= threshold) for point in scan])
    return accuracy, completeness, 2 * accuracy * completeness / (accuracy + completeness)


@pytest.mark.slow
@pytest.mark.parametrize("scanner", [None, (20.0, 500.0, -30.0)])
def test_scores_are_those_of_eth3d(tmp_path: Path, scanner: tuple[float, float, float] | None) -> None:
    rng = np.random.default_rng(5)
    scan = rng.uniform(0, 40, (900, 3)) * (1, 0.05, 1)
    crowd = scan[:60] * (0.2, 1, 0.2)  # many points in few voxels
    behind, in_front = scan[60:100] - (0, 25, 0), scan[100:160] - (0, -9, 0)
    rec = np.concatenate([scan[:500] + rng.normal(0, 1.5, (500, 3)), crowd, behind, in_front])
    for name, points in (("rec", rec), ("scan", scan)):
        np.savetxt(tmp_path / f"{name}.xyz", points, fmt="%.6f")
    settings = MeshSettings((2.0, 6.0), voxel=7.0, scanner=scanner)
    rows = measure_mesh(tmp_path / "rec.xyz", tmp_path / "scan.xyz", settings)["eth3d"]
    for row in rows:
        found = [100 * row[name] for name in ("accuracy", "completeness", "f1")]
        place = None if scanner is None else np.array(scanner)
        assert found == pytest.approx(by_eth3d(rec, scan, row["threshold_mm"], 7.0, place), abs=0.1)
        assert (row["unobserved"] > 0.03) == (scanner is not None)


def test_a_scanner_that_stands_on_what_it_scanned_is_refused(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "scan.xyz", np.random.default_rng(6).integers(0, 64, (60, 3)) / 64)
    settings = MeshSettings((1.0,), scanner=tuple(np.loadtxt(tmp_path / "scan.xyz")[0]))
    with pytest.raises(ValueError, match="stands where there is a point"):
        measure_mesh(tmp_path / "scan.xyz", tmp_path / "scan.xyz", settings)


@pytest.mark.parametrize(
    "settings",
    [
        MeshSettings((1.0,), cell=0.0),
        MeshSettings((1.0,), cell=float("inf")),
        MeshSettings((1.0,), voxel=-2.0),
        MeshSettings((1.0,), voxel=float("nan")),
    ],
)
def test_cells_without_a_width_are_refused(tmp_path: Path, settings: MeshSettings) -> None:
    with pytest.raises(ValueError, match="expected a positive length"):
        measure_mesh(tmp_path / "rec.xyz", tmp_path / "truth.xyz", settings)


def test_voxels_too_small_to_be_numbered_are_refused(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "rec.xyz", np.random.default_rng(7).uniform(0, 300, (60, 3)))
    with pytest.raises(ValueError, match=r"voxels of 1e-09 mm are too small for points .* mm across"):
        measure_mesh(tmp_path / "rec.xyz", tmp_path / "rec.xyz", MeshSettings((1.0,), voxel=1e-9))


@pytest.mark.parametrize("threshold", [0.0, 2.0])
def test_a_threshold_for_the_table_that_is_none_of_the_scores_is_refused(tmp_path: Path, threshold: float) -> None:
    with pytest.raises(ValueError, match=f"the threshold {threshold:g} mm is none of 1, 3"):
        measure_mesh(tmp_path / "rec.xyz", tmp_path / "truth.xyz", MeshSettings((1.0, 3.0), threshold))


def test_nothing_within_the_threshold_scores_zero() -> None:
    (score,) = compare_points(np.zeros((5, 3)), np.full((5, 3), 100.0), [1.0])["scores"]
    assert score["f_score"] == 0.0


def test_samples_are_spread_by_area() -> None:
    triangles = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 5], [3, 0, 5], [0, 3, 5]], dtype=np.float64)
    points = sample_evenly(
        Shape(triangles, np.array([[0, 1, 2], [3, 4, 5]], np.int32)), 20_000, np.random.default_rng(2)
    )
    is_large = points[:, 2] > 2
    assert is_large.mean() == pytest.approx(0.9, abs=0.01)
    assert np.allclose(points[is_large].mean(axis=0), (1, 1, 5), atol=0.03)


@pytest.mark.slow
def test_a_shifted_square_is_off_by_its_shift(tmp_path: Path) -> None:
    mesh, truth = write_mesh(tmp_path / "a.ply", square(3.0)), write_mesh(tmp_path / "b.ply", square(0.0))
    report = measure_mesh(mesh, truth, MeshSettings((2.5, 3.5)))
    assert report["accuracy"]["mean_mm"] == pytest.approx(3.0, abs=1e-6)
    assert [score["f_score"] for score in report["scores"]] == [0.0, 1.0]


@pytest.mark.slow
def test_half_of_the_truth_is_half_complete(tmp_path: Path) -> None:
    half = square(0.0)
    half = Mesh(half.vertices * np.array([0.5, 1, 1], np.float32), half.faces, half.normals, half.colours)
    mesh, truth = write_mesh(tmp_path / "a.ply", half), write_mesh(tmp_path / "b.ply", square(0.0))
    (score,) = measure_mesh(mesh, truth, MeshSettings((2.0,)))["scores"]
    assert score["precision"] == 1.0
    assert score["recall"] == pytest.approx(0.52, abs=0.004)


def test_a_cloud_is_compared_by_its_own_points(tmp_path: Path) -> None:
    points = np.random.default_rng(3).random((60, 3)).astype(np.float32)
    colours = np.zeros((60, 3), np.uint8)
    path = write_cloud(
        tmp_path / "cloud.ply", Cloud(points, np.tile(np.array([0, 0, 1], np.float32), (60, 1)), colours)
    )
    assert len(read_shape(path).faces) == 0
    assert np.array_equal(read_shape(path).points, points.astype(np.float64))


def test_a_mesh_without_colours_is_still_a_mesh(tmp_path: Path) -> None:
    path = write_coloured(tmp_path / "plain.ply", square(0.0).vertices, square(0.0).faces, square(0.0).colours)
    text = path.read_bytes().replace(b"property uchar red\nproperty uchar green\nproperty uchar blue\n", b"")
    header, body = text.split(b"end_header\n")
    vertices = b"".join(body[15 * row : 15 * row + 12] for row in range(4))
    (tmp_path / "bare.ply").write_bytes(header + b"end_header\n" + vertices + body[60:])
    assert np.array_equal(read_shape(tmp_path / "bare.ply").faces, square(0.0).faces)


@pytest.mark.slow
def test_distances_to_a_mesh_are_not_inflated_by_samples(tmp_path: Path) -> None:
    vertices, faces = ball(100.0, 8.0)
    measured = Mesh(
        (vertices * 1.001).astype(np.float32),
        faces,
        (vertices / 100).astype(np.float32),
        np.full(vertices.shape, 99, np.uint8),
    )
    mesh = write_mesh(tmp_path / "a.ply", measured)
    truth = write_coloured(tmp_path / "b.ply", vertices, faces, measured.colours)
    report = measure_mesh(mesh, truth, MeshSettings((1.0,)))
    assert report["accuracy"]["mean_mm"] == pytest.approx(0.1, abs=0.002)
    assert report["sampled"]["accuracy"]["mean_mm"] > 0.3


@pytest.mark.slow
def test_the_report_lists_measures_of_an_approach(tmp_path: Path) -> None:
    mesh, truth = write_mesh(tmp_path / "a.ply", square(3.0)), write_mesh(tmp_path / "b.ply", square(0.0))
    report = measure_mesh(mesh, truth, MeshSettings((2.5, 3.5), 3.5, Subject("ball", ("pm_fb",))))
    assert [(row["measure"], row["direction"]) for row in report["measures"]] == [
        ("accuracy", "less is better"),
        ("completeness", "less is better"),
        ("F-score at 3.5 mm", "more is better"),
    ]
    assert {(row["dataset"], row["approach"]) for row in report["measures"]} == {("ball", "pm_fb")}


@pytest.mark.parametrize("names", [("", ("pm_fb",)), ("ball", ("pm_fb", ""))])
def test_an_empty_name_which_no_study_takes_is_refused(names: tuple[str, tuple[str, ...]]) -> None:
    with pytest.raises(ValueError, match="the name of a dataset or an approach is empty"):
        Subject(*names)
    with pytest.raises(ValueError, match="the name of a dataset or an approach is empty"):
        find_compared([Path("a.ply")], Path("b.ply"), names=names[1][-1:], dataset=names[0])


def test_what_cannot_be_read_is_refused(tmp_path: Path) -> None:
    (tmp_path / "bad.ply").write_text("ply\n", encoding="utf-8")
    for name in ("bad.ply", "absent.ply"):
        with pytest.raises(ValueError, match=name):
            read_shape(tmp_path / name)
    with pytest.raises(ValueError, match="positive lengths"):
        measure_mesh(tmp_path / "bad.ply", tmp_path / "bad.ply", MeshSettings((0.0,)))


@pytest.mark.parametrize("scale", [1000, 0.001, 100])
def test_a_mesh_in_another_unit_than_the_truth_is_refused(tmp_path: Path, scale: float) -> None:
    mesh, truth = write_mesh(tmp_path / "a.ply", square(3, 100 * scale)), write_mesh(tmp_path / "b.ply", square(0))
    with pytest.raises(ValueError, match=r"a.ply: is about 1?[ \d]*00 times (larger|smaller).*Bring both to one unit"):
        measure_mesh(mesh, truth, MeshSettings((1.0,)))


@pytest.mark.slow
def test_a_mesh_beside_the_truth_is_remarked(tmp_path: Path) -> None:
    mesh, truth = write_mesh(tmp_path / "a.ply", square(3)), write_mesh(tmp_path / "b.ply", square(0))
    (remark,) = measure_mesh(mesh, truth, MeshSettings((1.0,)))["remarks"]
    assert "lies wholly beside its reference" in remark
    assert measure_mesh(truth, truth, MeshSettings((1.0,)))["remarks"] == []


def test_a_truth_of_one_point_is_refused(tmp_path: Path) -> None:
    mesh, truth = write_mesh(tmp_path / "a.ply", square(3)), tmp_path / "one.xyz"
    truth.write_text("1 2 3\n", encoding="utf-8")
    for pair in ((mesh, truth), (truth, mesh)):
        with pytest.raises(ValueError, match=r"one.xyz: holds a single point, expected a mesh or a cloud"):
            measure_mesh(*pair, MeshSettings((1.0,)))


def test_a_mesh_without_an_area_is_named(tmp_path: Path) -> None:
    points = np.outer(np.arange(3.0), (1.0, 1.0, 1.0))
    flat = write_coloured(tmp_path / "flat.ply", points, np.array([[0, 1, 2]], np.int32), np.zeros((3, 3), np.uint8))
    with pytest.raises(ValueError, match=r"flat.ply: the mesh's 1 triangles have no area"):
        measure_mesh(write_mesh(tmp_path / "a.ply", square(3)), flat, MeshSettings((1.0,)))


@pytest.mark.slow
def test_the_command_writes_its_report(tmp_path: Path) -> None:
    mesh, truth = write_mesh(tmp_path / "a.ply", square(3.0)), write_mesh(tmp_path / "b.ply", square(0.0))
    out = tmp_path / "out"
    words = ["validate", "mesh", str(mesh), "--truth", str(truth), "--thresholds", "1:5:1", "-o", str(out), "--json"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    assert len(json.loads(result.stdout)["scores"]) == 5
    for name in (
        "report.json",
        "scores.csv",
        "scores.svg",
        "scores.png",
        "scores.pdf",
        "report.html",
        "errors.ply",
        "errors.png",
    ):
        assert (out / name).stat().st_size > 0


@pytest.mark.slow
def test_completeness_counts_what_some_sensor_can_see_if_a_recording_is_given(tmp_path: Path) -> None:
    recording = synthesise(tmp_path / "ball", SynthParameters("sphere", n_sensors=1, n_frames=1, size=(160, 120)))
    truth = tmp_path / "ball/truth/mesh/0000.ply"
    whole = read_mesh(truth)
    towards = recording.sensors[0].left.camera.centre - whole.vertices.mean(axis=0)
    is_front = (whole.normals[whole.faces].mean(axis=1) @ towards) > 0
    write_mesh(tmp_path / "front.ply", replace(whole, faces=whole.faces[is_front]))
    settings = MeshSettings((1.0, 5.0, 20.0))
    alone = measure_mesh(tmp_path / "front.ply", truth, settings)
    seen = measure_mesh(tmp_path / "front.ply", truth, replace(settings, capture=str(tmp_path / "ball")))
    assert alone["completeness"]["mean_mm"] > 20
    assert seen["completeness"]["mean_mm"] < 1
    assert 0.35 < seen["settings"]["seen"] < 0.5
    assert seen["accuracy"] == alone["accuracy"]
