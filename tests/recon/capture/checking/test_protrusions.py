"""The lag of a sensor shows in what stands out of silhouettes, where their ends stand still."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from recon.capture.checking.lag import TangentPlanes, lag_between
from recon.capture.checking.protrusions import LAGS, Seen, _fit, lag_of_protrusions
from recon.capture.checking.silhouettes import Silhouette, silhouette_of
from recon.geometry.rig import Camera, look_at

N, SIZE = 24, (320, 240)
K = np.array([[400.0, 0, 160.0], [0, 400.0, 120.0], [0, 0, 1]])
BALL = np.random.default_rng(0).normal(size=(300, 3))
BALL /= np.linalg.norm(BALL, axis=1, keepdims=True)
SHOULDER, HEAD, FEET = (150.0, 300.0, 0.0), (0.0, 600.0, 0.0), (0.0, -600.0, 0.0)


def camera(x: float) -> Camera:
    return Camera(K, SIZE, look_at(np.array([x, 0.0, 2500.0]), np.zeros(3)))


def silhouette(view: Camera, instant: float, reach: float) -> Silhouette:
    """Draw a body that stands still, with an arm that goes up and down."""
    hand = np.array([480.0, 400.0 + reach * np.sin(0.3 * instant), 60.0])
    mask = np.zeros(SIZE[::-1], np.uint8)
    for ends, radius in (((HEAD, FEET), 120.0), ((SHOULDER, hand), 40.0), ((hand, hand), 60.0)):
        pixels = view.project(np.concatenate([end + radius * BALL for end in ends]))
        cv2.fillConvexPoly(mask, cv2.convexHull(np.rint(pixels).astype(np.int32)), 1)
    return silhouette_of(mask.astype(np.bool_))


def seen(x: float, late: float, reach: float = 100.0) -> Seen:
    view = camera(x)
    return view, [silhouette(view, frame - late, reach) for frame in range(N)]


def pairs(late: float, reach: float = 100.0) -> list[tuple[TangentPlanes, Seen, Seen]]:
    first, second = ([seen(x + side, by, reach) for side in (-40, 40)] for x, by in ((-500, 0.0), (500, late)))
    return [(TangentPlanes(a[0], b[0], np.zeros(3)), a, b) for a in first for b in second]


@pytest.mark.slow
@pytest.mark.parametrize("late", [0.0, 0.5, 1.25, -2.0, 3.0])
def test_an_arm_tells_the_lag_of_a_body_whose_head_and_feet_stand_still(late: float) -> None:
    both = pairs(late)
    assert lag_between([(planes.tangents(*a), planes.tangents(*b)) for planes, a, b in both]) is None
    found = lag_of_protrusions(both)
    assert found is not None
    assert found.frames == pytest.approx(late, abs=0.2)
    assert found.low <= late <= found.high
    assert found.is_late == (late != 0)


def test_an_arm_that_stands_still_tells_nothing() -> None:
    assert lag_of_protrusions(pairs(1.0, reach=0.0)) is None


def test_a_lag_at_which_two_tracks_hardly_overlap_is_no_likelier_than_the_nearest_at_which_they_do() -> None:
    frames = np.arange(14.0)
    tip = np.where((frames >= 2) & (frames <= 11), 4 * np.sin(0.7 * frames), np.nan)
    fit = _fit(tip, tip + np.random.default_rng(0).normal(0, 0.4, 14))
    assert fit is not None
    known = np.flatnonzero(np.abs(LAGS) < 1.99)  # they share eight frames
    assert fit[0] <= fit[known[0]] + 1e-9
    assert fit[-1] <= fit[known[-1]] + 1e-9
