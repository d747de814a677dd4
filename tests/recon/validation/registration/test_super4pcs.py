"""Registration of a rigid model without a starting guess."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from recon.validation.clouds import FitError
from recon.validation.registration.congruent import congruent_bases, pairs_at_distance
from recon.validation.registration.super4pcs import Super4PCSParameters, rigid_motions, super4pcs
from recon.validation.sphere.fit.methods import METHODS, fit_super4pcs
from tests.recon.validation.sphere.simulated_caps import CapParameters, simulate_cap


def shape(n: int, seed: int = 0) -> NDArray[np.float64]:
    """An L of two unequal blocks' faces, without any symmetry."""
    rng = np.random.default_rng(seed)
    points = rng.random((n, 3))
    points[np.arange(n), rng.integers(0, 3, n)] = rng.integers(0, 2, n)
    long = rng.random(n) < 0.6
    return np.where(long[:, None], points * (300, 80, 60), (0, 80, 0) + points * (90, 160, 60))


def motion(seed: int) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    return np.vstack([np.column_stack([turn, rng.uniform(-500, 500, 3)]), (0, 0, 0, 1)])


@pytest.mark.slow
def test_pairs_at_a_distance_are_those_of_the_full_search() -> None:
    points = np.random.default_rng(1).uniform(0, 100, (150, 3))
    distances = np.linalg.norm(points[:, None] - points, axis=2)
    expected = {tuple(pair) for pair in np.argwhere(np.abs(distances - 60) <= 3).tolist()}
    found = {tuple(pair) for pair in pairs_at_distance(points, 60.0, 3.0, 100_000).tolist()}
    assert found == expected


@pytest.mark.slow
def test_congruent_bases_are_those_of_the_full_search() -> None:
    points = np.random.default_rng(2).uniform(0, 100, (60, 3))
    first, second = pairs_at_distance(points, 60.0, 4.0, 9999), pairs_at_distance(points, 50.0, 4.0, 9999)
    at, cosine, tolerance = np.array([0.4, 0.5]), 0.3, 4.0
    found = congruent_bases(points, first, second, at, cosine, tolerance, 100_000)
    ab, cd = points[first[:, 1]] - points[first[:, 0]], points[second[:, 1]] - points[second[:, 0]]
    crossings = points[first[:, 0]] + 0.4 * ab
    gaps = np.linalg.norm(crossings[:, None] - (points[second[:, 0]] + 0.5 * cd), axis=2)
    lengths = np.linalg.norm(ab, axis=1)[:, None], np.linalg.norm(cd, axis=1)
    off = np.abs(ab @ cd.T / (lengths[0] * lengths[1]) - cosine)
    expected = np.argwhere((gaps <= tolerance) & (off <= 2 * tolerance / np.minimum(*lengths)))
    assert len(expected) > 5
    assert {tuple(row) for row in found.tolist()} == {(*first[i].tolist(), *second[j].tolist()) for i, j in expected}


def test_a_rigid_motion_is_found_again_from_its_points() -> None:
    points, moved = shape(4), motion(3)
    found = rigid_motions(points, (points @ moved[:3, :3].T + moved[:3, 3])[None])
    assert np.allclose(found[0], moved[:3])


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.slow
def test_a_model_of_any_shape_is_found_among_outliers(seed: int) -> None:
    rng, model, truth = np.random.default_rng(seed), shape(3000), motion(seed)
    seen = shape(2000, seed + 1)
    cloud = seen @ truth[:3, :3].T + truth[:3, 3] + rng.normal(0, 2, seen.shape)
    cloud = np.concatenate([cloud, cloud.mean(axis=0) + rng.uniform(-200, 200, (500, 3))])
    best = super4pcs(model, cloud, Super4PCSParameters(delta=8.0, overlap=0.7, n_trials=25))[0]
    off = seen @ (best - truth)[:3, :3].T + (best - truth)[:3, 3]
    assert np.linalg.norm(off, axis=1).mean() < 25.0  # near enough for a refinement; the shape is 300 mm long


@pytest.mark.slow
def test_the_same_seed_gives_the_same_registration() -> None:
    first, second = (super4pcs(shape(800), shape(800, 1), Super4PCSParameters(delta=8.0, n_trials=5)) for _ in range(2))
    assert np.array_equal(first, second)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("outliers", [0.05, 0.4])
def test_each_method_finds_the_centre_to_a_millimetre(method: str, outliers: float) -> None:
    points, centre = simulate_cap(CapParameters(n_points=8_000, outliers=outliers), np.random.default_rng(11))
    assert np.linalg.norm(METHODS[method](points, 150.0, 1).centre - centre) < 1.0


@pytest.mark.slow
def test_super4pcs_reports_no_sphere_where_there_is_none() -> None:
    rng = np.random.default_rng(5)
    with pytest.raises(FitError):
        fit_super4pcs(np.column_stack([rng.uniform(-400, 400, (5000, 2)), rng.normal(0, 3, 5000)]), 150.0, 1)


@pytest.mark.parametrize("change", [{"delta": 0.0}, {"overlap": 0.0}, {"overlap": 1.5}, {"n_trials": 0}])
def test_parameters_that_make_no_sense_are_refused(change: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(change))):
        Super4PCSParameters(**{"delta": 1.0, **change})  # type: ignore[arg-type]  # integers are fine as floats
