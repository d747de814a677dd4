"""What earlier frames saw counts as long as it holds, and nothing trails behind what moves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from recon.fusion.steadying import STILL_LEVELS, changes_since, still_true
from recon.geometry.mesh import Cloud
from tests.recon.fusion.test_agreement import CAMERAS, SIZE, plane

UNCHANGED = np.zeros(SIZE[::-1], np.float32)


def kept(before: Cloud, *now: Cloud, change: NDArray[np.float32] = UNCHANGED) -> Cloud:
    """What of the first sensor's cloud holds, seen by as many sensors as there are clouds now."""
    nothing = [before.select(np.zeros(len(before), bool))] * (len(now) - 1)
    return still_true([before, *nothing], now, [change] * len(now), CAMERAS[: len(now)])[0]


def left_half(cloud: Cloud) -> Cloud:
    return cloud.select(cloud.points[:, 0] < 0)


def test_what_is_missed_now_is_taken_from_before() -> None:
    before = plane(CAMERAS[0])
    assert len(kept(before, left_half(before))) == len(before)


def test_where_the_picture_has_changed_nothing_is_taken() -> None:
    before = plane(CAMERAS[0])
    change = UNCHANGED.copy()
    change[:, SIZE[0] // 2 :] = STILL_LEVELS + 1
    lent = kept(before, left_half(before), change=change)
    assert len(lent)
    assert CAMERAS[0].project(lent.points)[:, 0].max() < SIZE[0] // 2


def test_what_lies_elsewhere_now_is_not_taken_however_alike_the_picture() -> None:
    wider = plane(CAMERAS[0], half=110.0)
    assert not len(kept(plane(CAMERAS[0], 10.0), wider))
    assert not len(kept(plane(CAMERAS[0], -10.0), wider))


def test_what_another_sensor_looks_through_is_not_taken() -> None:
    floating = plane(CAMERAS[0], 100.0, half=10.0)
    elsewhere = plane(CAMERAS[0])
    elsewhere = elsewhere.select(elsewhere.points[:, 0] < -50)
    assert len(kept(floating, elsewhere)) == len(floating), "alone, its sensor knows nothing else"
    assert not len(kept(floating, elsewhere, plane(CAMERAS[1])))


def test_without_sigmas_nothing_is_known_to_hold() -> None:
    before = plane(CAMERAS[0])
    assert not len(kept(Cloud(before.points, before.normals, before.colours), before))


def test_noise_is_no_change_and_an_object_is() -> None:
    rng = np.random.default_rng(0)
    before, now = (np.clip(90 + rng.normal(0, 3, (60, 80)), 0, 255).astype(np.uint8) for _ in range(2))
    assert (changes_since(before, now) < STILL_LEVELS).mean() > 0.99
    now[20:40, 20:40] += 40
    assert (changes_since(before, now)[22:38, 22:38] > STILL_LEVELS).all()
