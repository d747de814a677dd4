"""The fit of a sphere of known radius, on simulated caps and on what is no sphere."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import nullcontext
from functools import partial
from itertools import cycle, islice
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from recon.capture.format import Capture, SensorStream
from recon.runtime.files import read_json
from recon.studio import SynthParameters, synthesise
from recon.studio.truth import read_depth
from recon.validation.clouds import FitError
from recon.validation.measures import inlier_ratios
from recon.validation.sphere.fit import refinement
from recon.validation.sphere.fit.consensus import fit_sphere
from recon.validation.sphere.fit.kernels import tukey_sums
from recon.validation.sphere.fit.methods import METHODS
from recon.validation.sphere.fit.refinement import refine_sphere
from tests.recon.validation.sphere.simulated_caps import CapParameters, simulate_cap

RADIUS = 150.0


def cap(seed: int = 1, **changes: float | int) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    return simulate_cap(CapParameters(**{"n_points": 8_000, **changes}), np.random.default_rng(seed))  # type: ignore[arg-type]  # floats and ints only


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("depth_step", [0.0, 8.0])
@pytest.mark.parametrize("outliers", [0.05, 0.2, 0.4])
def test_the_centre_is_found_to_a_millimetre_among_clusters_of_outliers(
    seed: int, depth_step: float, outliers: float
) -> None:
    points, centre = cap(seed + 100, outliers=outliers, depth_step=depth_step)
    assert np.linalg.norm(fit_sphere(points, RADIUS).centre - centre) < 1.0


def test_without_noise_the_centre_is_exact() -> None:
    points, centre = cap(noise=0.0, outliers=0.0)
    fit = fit_sphere(points, RADIUS)
    assert np.linalg.norm(fit.centre - centre) < 1e-3
    assert abs(fit.free_radius - RADIUS) < 1e-3
    assert np.abs(fit.errors(points)).max() < 1e-2


def test_the_same_seed_gives_the_same_fit() -> None:
    points, _ = cap()
    assert np.array_equal(fit_sphere(points, RADIUS).centre, fit_sphere(points, RADIUS).centre)


@pytest.mark.parametrize("place", [0.0, 20_000.0])
def test_the_sums_of_a_step_are_those_of_the_plain_formula(place: float) -> None:
    rng = np.random.default_rng(3)
    points = (place + rng.normal(0, 90, (5000, 3))).astype(np.float32)
    centre, radius, cutoff = place + np.array([1.0, -2.0, 0.5]), 150.0, 12.0
    points[0] = centre
    offsets = points.astype(np.float64) - centre
    distances = np.linalg.norm(offsets, axis=1)
    near = np.abs(distances - radius) < cutoff
    errors = distances[near] - radius
    weights = (1 - (errors / cutoff) ** 2) ** 2
    terms = np.column_stack([offsets[near] / distances[near, None], np.ones(len(errors))])
    matrix = (terms * weights[:, None]).T @ terms
    expected = [*matrix[np.triu_indices(4)], *(terms.T @ (weights * errors)), np.count_nonzero(near)]
    assert np.allclose(tukey_sums(points, centre, radius, cutoff), expected, rtol=1e-5, atol=2e-3)


def test_errors_are_distances_to_the_centre_minus_the_radius() -> None:
    points, _ = cap(n_points=500)
    fit = fit_sphere(points, RADIUS)
    expected = np.linalg.norm(points - fit.centre, axis=1) - RADIUS
    assert np.allclose(fit.errors(points), expected, atol=1e-3)


def test_ratios_count_both_sides_and_the_threshold_itself_at_that_of_the_table_and_on_the_curve() -> None:
    ratios = inlier_ratios(np.array([-5.0, 5.0, 6.0, -20.0]), [5, 12.5, 100])
    assert ratios.tolist() == [0.75, 0.5, 0.75, 1.0]


@pytest.mark.slow
def test_a_sphere_among_walls_is_found() -> None:
    rng = np.random.default_rng(4)
    points, centre = cap(n_points=3000)
    walls = rng.uniform(-2000, 2000, (30_000, 3))
    walls[np.arange(len(walls)), rng.integers(0, 3, len(walls))] = -1200
    scene = np.concatenate([points, walls]).astype(np.float32)
    assert np.linalg.norm(fit_sphere(scene, RADIUS).centre - centre) < 1.0
    with pytest.raises(FitError, match="--method robust finds a ball among more else"):
        METHODS["super4pcs"](scene, RADIUS, 1)


def plane(rng: np.random.Generator) -> NDArray[np.float64]:
    return np.column_stack([rng.uniform(-400, 400, (8_000, 2)), rng.normal(0, 3, 8_000)])


def block(rng: np.random.Generator) -> NDArray[np.float64]:
    return rng.uniform(-300, 300, (8_000, 3))


def cylinder(rng: np.random.Generator) -> NDArray[np.float64]:
    turn = rng.uniform(0, 2 * np.pi, 8_000)
    return np.column_stack([150 * np.cos(turn), rng.uniform(-400, 400, 8_000), 150 * np.sin(turn)])


def cube(rng: np.random.Generator) -> NDArray[np.float64]:
    points = rng.uniform(-130, 130, (8_000, 3))
    points[np.arange(8_000), rng.integers(0, 3, 8_000)] = rng.choice((-130.0, 130.0), 8_000)
    return points


@pytest.mark.slow
@pytest.mark.parametrize("shape", [plane, block, cylinder, cube])
@pytest.mark.parametrize("seed", range(2))
def test_what_is_no_sphere_is_not_reported_as_one(shape: object, seed: int) -> None:
    assert callable(shape)
    with pytest.raises(FitError, match="no sphere of radius 150 mm"):
        fit_sphere(shape(np.random.default_rng(seed)), RADIUS)


@pytest.mark.slow
@pytest.mark.parametrize("other", [90.0, 120.0, 190.0, 300.0])
def test_a_sphere_of_another_radius_is_not_reported(other: float) -> None:
    points, _ = cap(radius=other)
    with pytest.raises(FitError):
        fit_sphere(points, RADIUS)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_two_spheres_are_refused_with_both_places(method: str) -> None:
    first, _ = cap(1)
    second, _ = cap(2)
    both = np.concatenate([first, second + np.array([900, 0, 0], np.float32)])
    with pytest.raises(FitError, match="two spheres"):
        METHODS[method](both, RADIUS, 1)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("unit", "length"), [("m", 1000.0), ("cm", 10.0), ("in", 25.4)])
def test_another_unit_is_named(unit: str, length: float, method: str) -> None:
    points, _ = cap()
    with pytest.raises(FitError, match=f"--unit {unit}"):
        METHODS[method](points / np.float32(length), RADIUS, 1)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("share", [0.5, 0.75, 1.5, 2.0])
def test_the_radius_that_fits_is_named_where_another_was_given(share: float, method: str) -> None:
    points, _ = cap()
    with pytest.raises(FitError, match=rf"mm fits, {share * RADIUS:g} mm was given") as failure:
        METHODS[method](points, share * RADIUS, 1)
    fitting = float(str(failure.value).rpartition("radius ")[2].partition(" mm fits")[0])
    assert fitting == pytest.approx(RADIUS, rel=0.02)


def causes(error: BaseException) -> Iterator[BaseException]:
    while error.__cause__ is not None:
        error = error.__cause__
        yield error


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_a_failure_is_not_its_own_cause_or_whoever_looks_for_the_first_cause_never_ends(method: str) -> None:
    points, _ = cap()
    with pytest.raises(FitError) as failure:
        METHODS[method](1000 * points, RADIUS, 1)
    assert len(list(islice(causes(failure.value), 10))) < 10


@pytest.mark.parametrize("radius", [0.0, -1.0, float("nan"), float("inf")])
def test_an_impossible_radius_is_refused(radius: float) -> None:
    with pytest.raises(ValueError, match="expected a positive number"):
        fit_sphere(cap()[0], radius)


def test_too_few_points_are_refused() -> None:
    with pytest.raises(ValueError, match="49 points, expected at least 50"):
        fit_sphere(cap()[0][:49], RADIUS)


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_coordinates_that_are_no_numbers_are_refused_with_their_row(value: float) -> None:
    points, _ = cap()
    points[17, 1] = value
    with pytest.raises(ValueError, match="point 17"):
        fit_sphere(points, RADIUS)


def test_huge_coordinates_are_refused() -> None:
    points, _ = cap()
    points[3] = 1e12
    with pytest.raises(ValueError, match="too far away"):
        fit_sphere(points, RADIUS)


def test_a_ball_five_kilometres_away_is_refused_for_its_precision_and_one_near_is_not() -> None:
    points, _ = cap()
    away = np.array([5e6, 0.0, 0.0])
    with pytest.raises(ValueError, match=r"single precision has steps of 0\.5 mm: too far away"):
        fit_sphere(points.astype(np.float64) + away, RADIUS)
    fit_sphere(points.astype(np.float64) + away / 20, RADIUS)


def test_a_fit_that_stops_micrometres_short_is_done_and_one_that_swings_by_millimetres_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    points, centre = cap(noise=1.0, outliers=0.0)
    swings = cycle([-0.5, 0.5])

    def step_beyond(*given: object, by: float) -> NDArray[np.float64]:
        return refined_step(*given) + np.array([next(swings) * by, 0.0, 0.0])  # type: ignore[arg-type]

    refined_step = refinement._step
    for by, is_done in ((0.02, True), (2.0, False)):
        monkeypatch.setattr(refinement, "_step", partial(step_beyond, by=by))
        with nullcontext() if is_done else pytest.raises(FitError, match="did not converge in 60 steps"):
            assert np.linalg.norm(refine_sphere(points, centre, RADIUS, points).centre - centre) < 1.0


@pytest.mark.parametrize("shot", [1, 2, 3, 4])
def test_the_ball_is_found_in_a_whole_lidar_scan(real_data: Path, shot: int) -> None:
    points = 1000 * np.loadtxt(real_data / "sphere" / f"L1_S{shot}.xyz")
    fit = fit_sphere(points, 300.0)
    assert abs(fit.free_radius - 300.0) < 10.0


@pytest.mark.slow
@pytest.mark.parametrize("shot", [1, 2, 3, 4])
def test_no_ball_is_found_in_a_lidar_scan_that_it_is_cut_out_of(real_data: Path, shot: int) -> None:
    points = 1000 * np.loadtxt(real_data / "sphere" / f"L1_S{shot}.xyz")
    fit = fit_sphere(points, 300.0)
    with pytest.raises(FitError):
        fit_sphere(points[np.linalg.norm(points - fit.centre, axis=1) > 450.0], 300.0)


@pytest.mark.slow
@pytest.mark.parametrize("position", [(0.0, 0.0, 0.0), (120.0, -80.0, 60.0)])
def test_the_studios_sphere_is_where_its_truth_says(tmp_path: Path, position: tuple[float, float, float]) -> None:
    parameters = SynthParameters(scene="sphere", n_frames=1, n_sensors=2, size=(320, 240), noise=0.0, position=position)
    capture = synthesise(tmp_path / "capture", parameters)
    centre = np.array(read_json(tmp_path / "capture/truth/truth.json")["objects"][0][0])[:3, 3]
    for stream in capture.sensors:
        fit = fit_sphere(true_points(capture, stream), capture.object["radius_mm"])
        assert np.linalg.norm(fit.centre - centre) < 0.1
        assert abs(fit.free_radius - capture.object["radius_mm"]) < 0.1


def true_points(capture: Capture, stream: SensorStream) -> NDArray[np.float64]:
    """World points of a left camera's true depth map."""
    camera, depth = stream.left.camera, read_depth(capture, stream.id, "left", 0)
    rows, columns = np.nonzero(np.isfinite(depth))
    pixels = np.stack([columns, rows, np.ones_like(rows)]).astype(np.float64)
    in_camera = np.linalg.solve(camera.K, pixels).T * depth[rows, columns][:, None]
    return np.asarray((in_camera - camera.cam_from_world[:3, 3]) @ camera.rotation)
