"""Known meshes looked for in clouds of parts of them."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from recon.cli.main import app
from recon.geometry.mesh import Shape
from recon.geometry.mesh_files import write_coloured
from recon.studio.objects import ball, box
from recon.validation.clouds import FitError
from recon.validation.known_object import registration
from recon.validation.known_object.evaluation import ObjectSettings, measure_object
from recon.validation.known_object.registration import Placement, RegistrationParameters, place_model, refine
from recon.validation.registration.super4pcs import Super4PCSParameters
from recon.validation.triangles import TriangleTree
from recon.validation.truth.evaluation import sample_evenly

Solid = tuple[NDArray[np.float64], NDArray[np.int32]]


@cache
def lump() -> Solid:
    """A ball with bumps, which looks different from every side."""
    vertices, faces = ball(100.0, 12.0)
    directions, waves = vertices / 100, np.random.default_rng(0).normal(size=(6, 3))
    heights = 100 + sum(12 * np.sin(2.2 * directions @ wave + k) for k, wave in enumerate(waves))
    return directions * np.asarray(heights)[:, None] * (1.0, 1.4, 0.8), faces


@pytest.fixture
def short_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """Search once with ten bases instead of twice with thirty, where how surely a model is found is not the point."""
    monkeypatch.setattr(registration, "N_SEEDS", 1)
    monkeypatch.setattr(registration, "Super4PCSParameters", partial(Super4PCSParameters, n_trials=10))


def half_cloud(solid: Solid, seed: int, noise: float = 2.0, outliers: float = 0.1) -> tuple[NDArray[np.float32], Solid]:
    """Points of the half that faces one way, somewhere in space, and where the solid's vertices went."""
    rng = np.random.default_rng(seed)
    points = sample_evenly(Shape(*solid), 12_000, rng)
    towards = rng.normal(size=3)
    seen = points[TriangleTree(*solid).nearest(points).normals @ (towards / np.linalg.norm(towards)) > 0.15]
    seen += rng.normal(0, noise, seen.shape)
    is_out = rng.random(len(seen)) < outliers
    seen[is_out] += rng.normal(0, 40, (np.count_nonzero(is_out), 3))
    turn, shift = Rotation.random(random_state=seed).as_matrix(), rng.uniform(-500, 500, 3)
    return (seen @ turn.T + shift).astype(np.float32), (solid[0] @ turn.T + shift, solid[1])


def moved(solid: Solid, transform: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(solid[0] @ transform[:3, :3].T + transform[:3, 3])


@pytest.mark.slow
def test_half_of_a_known_shape_is_found_to_a_millimetre() -> None:
    cloud, truth = half_cloud(lump(), 0)
    placement = place_model(*lump(), cloud)
    assert np.abs(moved(lump(), placement.cloud_from_model) - truth[0]).max() < 1.5
    assert placement.overlap > 0.85
    assert placement.rivals == ()


def test_refinement_is_exact_without_noise() -> None:
    cloud, truth = half_cloud(lump(), 3, noise=0.0, outliers=0.0)
    turn = Rotation.from_rotvec((0.05, -0.04, 0.03)).as_matrix()
    exact = np.eye(4)
    exact[:3, :3], exact[:3, 3] = _motion(lump()[0], truth[0])
    start = exact.copy()
    start[:3, :3] = exact[:3, :3] @ turn
    placement = refine(TriangleTree(*lump()), cloud.astype(np.float64), start, 5.0, 0.9, 100)
    assert np.abs(moved(lump(), placement.cloud_from_model) - truth[0]).max() < 0.01


def _motion(before: NDArray[np.float64], after: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    found, _ = Rotation.align_vectors(after - after.mean(axis=0), before - before.mean(axis=0))
    turn = found.as_matrix()
    return turn, after.mean(axis=0) - turn @ before.mean(axis=0)


@pytest.mark.slow
@pytest.mark.usefixtures("short_search")
def test_a_symmetric_shape_is_said_to_fit_in_several_places() -> None:
    solid = box((200.0, 100.0, 150.0), 30.0)
    points = sample_evenly(Shape(*solid), 6000, np.random.default_rng(1))
    placement = place_model(*solid, points)
    assert len(placement.rivals) >= 1
    assert (
        np.median(np.abs(TriangleTree(moved(solid, placement.cloud_from_model), solid[1]).nearest(points).signed)) < 0.1
    )


@pytest.mark.slow
@pytest.mark.usefixtures("short_search")
def test_places_where_a_model_looks_the_same_are_refined_once(monkeypatch: pytest.MonkeyPatch) -> None:
    n_points: list[int] = []

    def counted(tree: TriangleTree, points: NDArray[np.float64], *rest: Any) -> Placement:
        n_points.append(len(points))
        return refine(tree, points, *rest)

    monkeypatch.setattr(registration, "refine", counted)
    cloud, truth = half_cloud(ball(100.0, 12.0), 1, noise=1.0, outliers=0.0)
    placement = place_model(*ball(100.0, 12.0), cloud)
    assert len(placement.rivals) > 3, "a ball fits in any turn"
    assert n_points.count(max(n_points)) == 1
    for place in (placement.cloud_from_model, *placement.rivals):
        assert np.linalg.norm(place[:3, 3] - truth[0].mean(axis=0)) < 1.0


@pytest.mark.slow
@pytest.mark.usefixtures("short_search")
@pytest.mark.parametrize(
    ("points_of", "message"),
    [
        (lambda: np.random.default_rng(1).uniform(-200, 200, (500, 3)), "only .* of the cloud lies within"),
        (lambda: half_cloud(lump(), 1)[0] / 1000, "suit the model in m: say so with --unit m"),
        (lambda: np.zeros((10, 3)), "has 10 points, expected at least 50"),
        (lambda: np.full((100, 3), np.inf), "not a finite number"),
    ],
)
def test_a_cloud_without_the_model_is_refused(points_of: Callable[[], NDArray[np.float64]], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        place_model(*lump(), points_of())


@pytest.mark.slow
@pytest.mark.usefixtures("short_search")
@pytest.mark.parametrize(("unit", "length"), [("m", 1000), ("in", 25.4)])
def test_a_model_in_another_unit_is_told_from_one_that_is_not_there(unit: str, length: float) -> None:
    vertices, faces = lump()
    cloud = half_cloud((vertices, faces), 1)[0]
    with pytest.raises(FitError, match=rf"mm across, the model .* mm, which would suit .* with --model-unit {unit}$"):
        place_model(vertices / length, faces, cloud)


def test_parameters_are_checked() -> None:
    for delta in (0.0, float("inf")):
        with pytest.raises(ValueError, match=f"delta is {delta}"):
            RegistrationParameters(delta=delta)
    with pytest.raises(ValueError, match="trim 2"):
        RegistrationParameters(trim=2.0)


def test_a_model_without_an_area_is_named(tmp_path: Path) -> None:
    points = np.outer(np.arange(3.0), (1.0, 1.0, 1.0))
    model = write_coloured(tmp_path / "flat.ply", points, np.array([[0, 1, 2]], np.int32), np.zeros((3, 3), np.uint8))
    with pytest.raises(ValueError, match=r"flat.ply: none of the mesh's 1 triangles has an area"):
        measure_object(model, tmp_path / "cloud.xyz", ObjectSettings((5.0,)))


@pytest.mark.slow
def test_the_command_measures_signed_distances(tmp_path: Path) -> None:
    vertices, faces = lump()
    model = write_coloured(tmp_path / "lump.ply", vertices, faces, np.full(vertices.shape, 128, np.uint8))
    cloud, _ = half_cloud(lump(), 1, noise=1.0, outliers=0.05)
    np.savetxt(tmp_path / "cloud.xyz", cloud)
    out = tmp_path / "out"
    words = ["validate", "object", str(model), str(tmp_path / "cloud.xyz"), "-o", str(out), "--approach", "pm_fb"]
    result = CliRunner().invoke(app, [*words, "--json"])
    assert result.exit_code == 0, result.output
    report = json.loads(result.stdout)
    assert report["errors"]["p50_mm"] == pytest.approx(0, abs=0.1)
    assert report["errors"]["rms_inliers_mm"] == pytest.approx(1.0, abs=0.4)
    assert report["table"][0]["inliers"] == pytest.approx(0.96, abs=0.02)
    assert report["measures"][0]["measure"] == "object inliers within 12.5 mm"
    for name in ("report.json", "curve.csv", "curve.svg", "errors.pdf", "errors.ply", "cloud.png", "report.html"):
        assert (out / name).stat().st_size > 0
