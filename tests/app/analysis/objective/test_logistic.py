"""The logistic curve from a measure to the scores."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import curve_fit

from app.analysis.objective.logistic import (
    Logistic,
    fit_logistic,
    fit_logistic_with_line,
    grid_correlations,
)


def logistic(x: np.ndarray, bottom: float, top: float, middle: float, width: float) -> np.ndarray:
    return bottom + (top - bottom) / (1 + np.exp(-(x - middle) / width))


@settings(max_examples=30)
@given(st.floats(-3, 3), st.floats(0.5, 4), st.booleans(), st.floats(30, 35), st.floats(0.5, 1.5))
def test_a_curve_without_noise_is_recovered(
    bottom: float, height: float, falls: bool, middle: float, width: float
) -> None:
    x = np.linspace(25, 40, 30)
    top = bottom - height if falls else bottom + height
    y = logistic(x, bottom, top, middle, width)
    fit = fit_logistic(x, y)
    assert fit.status == "ok"
    assert (fit.bottom, fit.top) == pytest.approx((bottom, top), abs=0.02 * height)
    assert (fit.middle, fit.width) == pytest.approx((middle, width), abs=0.05)
    assert fit(x) == pytest.approx(y, abs=0.005 * height)
    assert fit.correlation == pytest.approx(-1 if falls else 1, abs=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_least_squares_are_those_of_scipy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = np.sort(rng.uniform(25, 40, 30))
    y = logistic(x, -1.5, 1.5, 32.0, 2.0) + 0.3 * rng.normal(size=30)
    theirs, _ = curve_fit(logistic, x, y, p0=(-1.5, 1.5, 32.0, 2.0))
    fit = fit_logistic(x, y)
    assert np.sum((y - fit(x)) ** 2) == pytest.approx(np.sum((y - logistic(x, *theirs)) ** 2), rel=1e-4)
    assert fit.correlation == pytest.approx(np.corrcoef(y, fit(x))[0, 1], abs=1e-9)


def test_a_step_or_a_line_that_no_logistic_meets_is_named() -> None:
    x = np.arange(10.0)
    assert fit_logistic(x, (x > 4.5).astype(float)).status == "step"
    assert fit_logistic(x, 2 * x).status == "line"


def test_the_grid_of_the_orders_never_beats_the_fit_and_comes_close_on_average() -> None:
    missed = []
    for seed in range(200):
        x, y = np.random.default_rng(seed).normal(size=(2, 6 + seed % 25))
        missed.append(abs(fit_logistic(x, y).correlation) - abs(grid_correlations(x, y[None])[0]))
    assert min(missed) >= -1e-12
    assert np.mean(missed) < 0.01


def test_the_curve_has_its_ends_and_its_middle() -> None:
    curve = Logistic(-1.0, 3.0, 10.0, 0.5, 1.0, "ok")
    assert curve(np.array([-1000.0, 10.0, 1000.0])).tolist() == [-1.0, 1.0, 3.0]


def with_line(x: np.ndarray, b1: float, b2: float, b3: float, b4: float, b5: float) -> np.ndarray:
    return b1 * (0.5 - 1 / (1 + np.exp(b2 * (x - b3)))) + b4 * x + b5


@pytest.mark.parametrize("seed", range(5))
def test_least_squares_of_five_parameters_are_those_of_scipy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = np.sort(rng.uniform(25, 40, 40))
    y = with_line(x, 2.0, 0.9, 32.0, 0.1, -3.0) + 0.1 * rng.normal(size=40)
    theirs, _ = curve_fit(with_line, x, y, p0=(2.0, 0.9, 32.0, 0.1, -3.0))
    fit = fit_logistic_with_line(x, y)
    assert np.sum((y - fit(x)) ** 2) == pytest.approx(np.sum((y - with_line(x, *theirs)) ** 2), rel=1e-4)
    assert fit(x) == pytest.approx(with_line(x, fit.b1, fit.b2, fit.b3, fit.b4, fit.b5))
    assert fit.correlation == pytest.approx(np.corrcoef(y, fit(x))[0, 1], abs=1e-9)


def test_five_parameters_are_never_farther_from_the_scores_than_four_and_have_the_direction_of_the_line() -> None:
    for seed in range(30):
        x, y = np.random.default_rng(seed).normal(size=(2, 8 + seed))
        four, five = fit_logistic(x, y), fit_logistic_with_line(x, y)
        assert abs(five.correlation) >= abs(four.correlation) - 1e-9
        assert np.sign(five.correlation) == np.sign(np.corrcoef(x, y)[0, 1])
        (by_grid,) = grid_correlations(x, y[None], with_line=True)
        assert abs(by_grid) <= abs(five.correlation) + 1e-12
        assert by_grid == pytest.approx(five.correlation, abs=0.1)


def test_a_curve_that_turns_is_named() -> None:
    x = np.linspace(0, 10, 40)
    assert fit_logistic_with_line(x, with_line(x, 6.0, 2.0, 5.0, -0.4, 0.0)).status == "not monotone"
    assert fit_logistic_with_line(x, with_line(x, 6.0, 2.0, 5.0, 0.4, 0.0)).status == "ok"
