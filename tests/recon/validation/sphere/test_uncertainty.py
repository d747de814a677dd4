"""Uncertainties, the sources of errors, and the agreement with a reference, each against a known truth."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from recon.cli.main import app
from recon.validation.clouds import FitError
from recon.validation.sphere.cells import N_RINGS, N_SECTORS, cap_of
from recon.validation.sphere.error_sources import CellErrors, error_sources
from recon.validation.sphere.exclusion import Parts, findings, sensor_offsets
from recon.validation.sphere.fit.model import ReferenceSettings, SphereFit
from recon.validation.sphere.fit.refinement import refine_sphere
from recon.validation.sphere.reference import Centre, agreement, check_unit, read_references
from recon.validation.sphere.uncertainty import coverage_factor, fit_uncertainty
from tests.recon.validation.sphere.simulated_caps import CapParameters, simulate_cap

PLACES = np.array([[1700.0, 2400, 10], [1400, 2200, -30], [2000, 1300, -20], [1700, 700, 300]])
C, S = np.cos(0.7), np.sin(0.7)
TURN = np.array([[C, -S, 0], [S, C, 0], [0, 0, 1]])
SHIFT = np.array([-400.0, 90, 2600])


def cap_with_patches(rng: np.random.Generator, n: int = 4000) -> NDArray[np.float32]:
    """A cap around the origin, whose errors are alike over about eight degrees."""
    cosine, turn = rng.uniform(0.5, 1, n), rng.uniform(0, 2 * np.pi, n)
    sine = np.sqrt(1 - cosine**2)
    directions = np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine], axis=1)
    middles = rng.normal(size=(200, 3))
    middles /= np.linalg.norm(middles, axis=1, keepdims=True)
    wave = np.exp((directions @ middles.T - 1) / (1 - np.cos(np.deg2rad(8)))) @ rng.normal(size=200)
    errors = 2 * wave / wave.std() + rng.normal(0, 2, n)
    return ((150 + errors)[:, None] * directions).astype(np.float32)


@pytest.mark.slow
def test_intervals_hold_the_truth_where_neighbouring_errors_are_alike() -> None:
    n_held, n_caps = np.zeros(4), 40
    for seed in range(n_caps):
        points = cap_with_patches(np.random.default_rng(seed))
        fit = refine_sphere(points, np.zeros(3), 150.0, points)
        uncertainty = fit_uncertainty(points, fit, cap_of(points, fit), 1)
        assert uncertainty is not None
        u = np.append(np.sqrt(np.diag(uncertainty.centre_covariance)), uncertainty.free_radius)
        expanded = coverage_factor(uncertainty.n_sectors - 1) * u
        n_held += np.abs(np.append(fit.centre, fit.free_radius - 150)) <= expanded
        assert np.all(expanded[:3] < 4.0)  # nor are they so wide that they say nothing
    assert n_held.min() / n_caps > 0.8
    assert n_held.mean() / n_caps > 0.87


def test_a_cap_seen_in_three_sectors_only_has_no_uncertainty() -> None:
    points = cap_with_patches(np.random.default_rng(1))
    fit = refine_sphere(points, np.zeros(3), 150.0, points)
    cap = cap_of(points, fit)
    few = points[cap.sector < 3]
    part = cap_of(points, fit)
    inside = part.sector < 3
    narrow = type(cap)(part.points[inside], part.errors[inside], part.axes, part.places[inside], part.ring_ends)
    assert fit_uncertainty(few, fit, narrow, 1) is None


def test_what_comes_back_in_every_shot_is_calibration() -> None:
    rng = np.random.default_rng(3)
    n_cells = N_SECTORS * N_RINGS
    bent = 2.0 * np.where(np.arange(n_cells) % 2, 1.0, -1.0)
    shots = [CellErrors(bent + rng.normal(0, 0.5, n_cells), np.full(n_cells, 9.0)) for _ in range(8)]
    row = error_sources(shots, 1)
    assert row["calibration_mm"] == pytest.approx(2.0, abs=0.1)
    assert row["shot_mm"] == pytest.approx(0.5, abs=0.1)
    assert row["matching_mm"] == pytest.approx(3.0)
    sound = error_sources([CellErrors(rng.normal(0, 0.5, n_cells), np.full(n_cells, 9.0)) for _ in range(8)], 1)
    assert sound["calibration_mm"] == pytest.approx(0.0, abs=0.15)
    single = error_sources(shots[:1], 1)
    assert single["calibration_mm"] is None
    assert single["smooth_mm"] == pytest.approx(2.0, abs=0.3)


def test_uncertainties_of_error_sources_come_from_the_sectors_that_every_shot_shows() -> None:
    rng, n_cells = np.random.default_rng(3), N_SECTORS * N_RINGS
    for n_known in (5, 3, 0):
        means = rng.normal(0, 1, (8, n_cells))
        means[0, n_known * N_RINGS :] = np.nan
        row = error_sources([CellErrors(shot, np.full(n_cells, 9.0)) for shot in means], 1)
        assert (row["matching_mm"] is None) is (n_known == 0)
        if n_known == 5:
            assert row["u_shot_mm"] is not None
            assert row["coverage_factor"] == coverage_factor(4)
        else:  # a bootstrap over fewer sectors tells nothing, least of all that there is no uncertainty
            assert {row[key] for key in row if key.startswith("u_")} == {None}


def fits_at(*centres: tuple[float, float, float]) -> dict[str, SphereFit]:
    return {
        f"S{number}": SphereFit(np.array(centre), 150.0, 150.0, 2.0, 0.3, 0.9)
        for number, centre in enumerate(centres, start=1)
    }


def test_a_sensor_that_is_off_alike_in_all_samples_is_remarked_and_only_a_sample_that_is_off_more_is_left_out() -> None:
    rng = np.random.default_rng(4)
    samples = []
    for _ in range(7):
        place = rng.uniform(-300, 300, 3)
        apart = ((0, 0, 0), (0.2, 0, 0), (3.0, 0.1, 0))
        samples.append(fits_at(*(tuple(place + shift + rng.normal(0, 0.1, 3)) for shift in apart)))
    offsets = sensor_offsets([{sensor: fit.centre for sensor, fit in fits.items()} for fits in samples])
    assert offsets["S3"] == pytest.approx([3.0, 0.1, 0.0], abs=0.2)
    for known in (offsets, {}):
        judged = [findings(fits, {}, known) for fits in samples]
        assert all(row["S3"][0].is_remark for row in judged)
        assert all(("calibration" in row["S3"][0].sentence) is bool(known) for row in judged)
    assert not any(row["S1"] for row in judged)
    spoilt = fits_at((0, 0, 0), (0.2, 0, 0), (3.0, 6.0, 0))
    (reason,) = findings(spoilt, {"S3": Parts(0.1, 0.1, 0.1)}, offsets)["S3"]
    assert not reason.is_remark
    assert sensor_offsets([{}] * 9) == sensor_offsets([{"S1": np.zeros(3), "S2": np.ones(3)}] * 3) == {}


def centres(places: NDArray[np.float64], u: float = 0.0) -> list[Centre]:
    return [Centre(place, u**2 * np.eye(3)) for place in places]


def test_a_distance_that_shows_only_without_the_calibration_is_said_to_be_that() -> None:
    offsets = {"S1": np.array([1.6, 0.0, 0.0]), "S2": np.array([-1.6, 0.0, 0.0])}
    for each in findings(fits_at((0, 0, 0), (0, 0, 0)), {}, offsets).values():
        (finding,) = each
        assert finding.is_remark
        assert "3.20 mm without what is the same in most samples, its calibration" in finding.sentence


def test_a_scan_whose_frame_is_far_away_gives_the_same_centre(tmp_path: Path) -> None:
    points = cap_with_patches(np.random.default_rng(2)).astype(np.float64)
    far = np.array([5.2e8, 4.1e9, 3e5])  # mm, as of a map's grid
    centres_found = []
    for name, place in (("near", np.zeros(3)), ("far", far)):
        np.savetxt(tmp_path / f"{name}.xyz", points + place, fmt="%.3f")
        (centre,) = read_references(ReferenceSettings((tmp_path / f"{name}.xyz",), frame="sensors"), 150.0, 1, 1)
        centres_found.append(centre.place - place)
    np.testing.assert_allclose(*centres_found, atol=2e-3)


def test_the_motion_between_two_frames_is_estimated_and_its_residuals_are_left() -> None:
    ours = PLACES @ TURN.T + SHIFT
    measured = dict(enumerate(centres(ours), start=1))
    exact = agreement(centres(PLACES), measured, "own")
    assert exact["degrees_of_freedom"] == 6
    assert exact["s_mm"] == pytest.approx(0.0, abs=1e-6)
    assert np.allclose(np.array(exact["sensors_from_reference"])[:3], np.column_stack([TURN, SHIFT]))
    assert exact["birge_ratio"] is None  # nothing is known of the uncertainties
    longer = agreement(centres(PLACES / 1.01), measured, "own")
    assert longer["scale"] == pytest.approx(1.01, abs=1e-6)
    ratios, n_held = [], np.zeros(2)
    for seed in range(200):
        noisy = ours + np.random.default_rng(seed).normal(0, 2.0, ours.shape)
        report = agreement(centres(PLACES), dict(enumerate(centres(noisy, 2.0), start=1)), "own")
        ratios.append((report["s_mm"] / 2.0) ** 2)
        assert report["birge_ratio"] == pytest.approx(report["s_mm"] / 2.0)
        expanded = report["scale_coverage_factor"] * report["u_scale"]
        n_held += report["s_low_mm"] <= 2.0 <= report["s_high_mm"], abs(report["scale"] - 1.0) <= expanded
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.1)
    assert n_held / 200 == pytest.approx([0.95, 0.95], abs=0.04)


def test_centres_in_the_sensors_own_frame_are_compared_as_they_are() -> None:
    measured = dict(enumerate(centres(np.add(PLACES[:1], (0.0, 3.0, 4.0)), 1.0), start=1))
    report = agreement(centres(PLACES[:1]), measured, "sensors")
    (row,) = report["samples"]
    assert (report["degrees_of_freedom"], row["distance_mm"], row["e_n"]) == (3, 5.0, 2.5)
    assert "scale" not in report


def test_places_that_determine_no_motion_are_refused() -> None:
    on_a_line = np.outer(np.arange(4.0), (1.0, 2.0, 3.0)) * 100
    with pytest.raises(FitError, match="lie on a line"):
        agreement(centres(on_a_line), dict(enumerate(centres(on_a_line), start=1)), "own")
    with pytest.raises(FitError, match="reference centres lie on a line"):  # all the same, as by a slip of a script
        agreement(centres(PLACES[[0, 0, 0, 0]]), dict(enumerate(centres(PLACES), start=1)), "own")
    with pytest.raises(FitError, match=r"2 of the placed balls are used.*--keep some"):
        agreement(centres(PLACES), dict(enumerate(centres(PLACES[:2]), start=1)), "own")


@pytest.mark.parametrize("scale", [0.001, 1 / 2.54, 10.0])
def test_a_reference_in_another_unit_is_refused(scale: float) -> None:
    with pytest.raises(FitError, match=r"the reference's places extend .*--reference-unit"):
        check_unit(centres(PLACES * scale), dict(enumerate(centres(PLACES), start=1)), 150.0)


def test_the_unit_of_a_reference_is_not_doubted_where_it_is_right_or_the_ball_stays_in_place() -> None:
    check_unit(centres(PLACES @ TURN.T + SHIFT), dict(enumerate(centres(PLACES), start=1)), 150.0)
    shots = PLACES[:1] + np.random.default_rng(2).normal(0, 5, (4, 3))
    for measured in (shots, PLACES):  # one reference again and again is another mistake
        check_unit(centres(PLACES[[0, 0, 0, 0]]), dict(enumerate(centres(measured), start=1)), 150.0)


def test_without_a_ball_that_is_used_there_is_no_agreement() -> None:
    with pytest.raises(FitError, match=r"none of the placed balls is used.*leave out --reference-centre"):
        agreement(centres(PLACES[:1]), {}, "sensors")


def test_one_file_holds_the_centres_of_any_number_of_balls(tmp_path: Path) -> None:
    places = np.random.default_rng(1).uniform(-500, 500, (60, 3))
    np.savetxt(tmp_path / "centres.txt", places)
    read = read_references(ReferenceSettings((tmp_path / "centres.txt",)), 150.0, 60, 1)
    assert np.allclose([centre.place for centre in read], places, atol=1e-3)


def test_references_that_do_not_suit_the_samples_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "centres.txt"
    np.savetxt(path, PLACES / 1000)
    read = read_references(ReferenceSettings((path,), "m"), 150.0, 4, 1)
    assert np.allclose([centre.place for centre in read], PLACES, atol=1e-3)
    with pytest.raises(ValueError, match="4 reference centres for 5 placed balls"):
        read_references(ReferenceSettings((path,)), 150.0, 5, 1)
    with pytest.raises(ValueError, match="frame is 'lidar', expected one of own, sensors"):
        read_references(ReferenceSettings((path,), frame="lidar"), 150.0, 4, 1)
    np.savetxt(path, PLACES[:2])
    with pytest.raises(ValueError, match=r"at least 3 places.*--reference-frame sensors"):
        read_references(ReferenceSettings((path,)), 150.0, 2, 1)


@pytest.mark.slow
def test_a_scanner_in_its_own_frame_agrees_with_what_the_sensor_saw(tmp_path: Path) -> None:
    clouds, scans = [], []
    for number, place in enumerate(PLACES):
        cap, centre = simulate_cap(CapParameters(n_points=6000, outliers=0.0, noise=2.0), np.random.default_rng(number))
        scan, middle = simulate_cap(CapParameters(n_points=600, outliers=0.0, noise=6.0), np.random.default_rng(number))
        clouds.append(tmp_path / f"cloud{number}.xyz")
        scans.append(tmp_path / f"scan{number}.xyz")
        np.savetxt(clouds[-1], cap - centre + place @ TURN.T + SHIFT, fmt="%.4f")
        np.savetxt(scans[-1], (scan - middle + place) / 1000, fmt="%.7f")
    options = [word for scan in scans for word in ("--reference-centre", str(scan))]
    arguments = ["validate", "sphere", *map(str, clouds), "--radius", "150", *options, "-o", str(tmp_path / "out")]
    result = CliRunner().invoke(app, [*arguments, "--reference-unit", "m"])
    assert result.exit_code == 0, result.output
    assert "leaves 6 degrees of freedom" in result.output
    report = json.loads((tmp_path / "out/report.json").read_text(encoding="utf-8"))
    assert report["reference"]["s_mm"] < 2.0
    assert 0.3 < report["reference"]["birge_ratio"] < 2.5
    assert all(row["coverage_factor"] > 2 and len(row["u_centre_mm"]) == 3 for row in report["reconstructions"])
    with pytest.raises(ValueError, match="--reference-unit m"):
        CliRunner().invoke(app, arguments, catch_exceptions=False)
