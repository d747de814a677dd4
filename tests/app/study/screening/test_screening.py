"""The screening's options, its measures of display and distance, and its rule."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.study.options.options import StudyOptions, parse_options
from app.study.screening.acuity import AcuityTest, certifying_distance_mm, gap_arcmin, gap_mm, judge, smallest_size
from app.study.screening.screening import (
    EnteredResult,
    Item,
    ScreeningOptions,
    acuity_setup,
    check_entered,
    draw,
    n_items,
    next_content,
    verdict_of,
)
from app.study.screening.viewing_distance import (
    BLIND_SPOT_DEG,
    CARD_MM,
    ImplausibleError,
    blind_spot_distance_mm,
    checked_distance_mm,
    pixel_mm,
)
from tests.app.study.screening.acuity_observer import simulate_test

LIMIT = 0.0
N_PEOPLE = 300


@pytest.mark.slow
@pytest.mark.parametrize("away", [-0.1, 0.1])
def test_a_display_that_just_certifies_the_limit_decides_as_well(away: float) -> None:
    """No ring is smaller than the limit itself, people slip twice in a hundred, and 3 % of decisions may be wrong."""
    test = AcuityTest(limit=LIMIT, smallest=LIMIT)
    rng = np.random.default_rng([3, round(10 + 10 * away)])
    found = [judge(simulate_test(LIMIT + away, test, rng), test) for _ in range(N_PEOPLE)]
    assert np.mean([one.verdict != ("passed" if away < 0 else "failed") for one in found]) <= 0.03


@given(st.floats(0.05, 1), st.floats(-0.3, 1))
def test_from_its_certifying_distance_a_display_draws_the_limit(pitch: float, limit: float) -> None:
    assert smallest_size(pitch, certifying_distance_mm(pitch, limit)) == pytest.approx(limit, abs=1e-6)


@given(st.floats(-0.5, 1.6), st.floats(200, 6000))
def test_a_gap_and_its_angle_are_inverse(size: float, distance: float) -> None:
    assert gap_arcmin(gap_mm(size, distance), distance) == pytest.approx(10**size)


@given(st.floats(0.05, 0.6), st.sampled_from([1.0, 1.25, 2.0]), st.floats(-0.009, 0.009))
def test_a_card_gives_the_size_of_a_pixel(pitch: float, ratio: float, slip: float) -> None:
    width = CARD_MM[0] / (pitch * ratio)
    assert pixel_mm([width * (1 + slip), width * (1 - slip)], ratio) == pytest.approx(pitch)


@pytest.mark.parametrize(
    ("widths", "complaint"),
    [([340, 347.5], "within 2%"), ([340], "1 widths"), ([0, 0], "positive"), ([5, 5], "pixels of"), ([9e4, 9e4], "mm")],
)
def test_cards_that_cannot_be_are_refused(widths: list[float], complaint: str) -> None:
    with pytest.raises(ImplausibleError, match=complaint):
        pixel_mm(widths, 1.0)


@given(st.floats(250, 1900))
def test_the_blind_spot_tells_the_distance(distance: float) -> None:
    offset = distance * math.tan(math.radians(BLIND_SPOT_DEG))
    assert blind_spot_distance_mm([offset * slip for slip in (0.9, 0.95, 1, 1.05, 1.1)]) == pytest.approx(distance)


@pytest.mark.parametrize(
    ("offsets", "complaint"),
    [([100] * 4, "4 times"), ([100, 100, 100, 100, 130], "range within"), ([10] * 5, "4 cm"), ([900] * 5, "375 cm")],
)
def test_blind_spots_that_cannot_be_are_refused(offsets: list[float], complaint: str) -> None:
    with pytest.raises(ImplausibleError, match=complaint):
        blind_spot_distance_mm(offsets)


@pytest.mark.parametrize("distance", [0.0, 199.0, 6001.0])
def test_nobody_sits_there(distance: float) -> None:
    with pytest.raises(ImplausibleError, match="expected 20 to 600 cm"):
        checked_distance_mm(distance)


def test_a_window_of_no_height_still_shows_the_smallest_ring() -> None:
    setup = acuity_setup(ScreeningOptions(), pixel_mm=0.25, distance_mm=700, height_px=0, seed=1)
    assert setup["largest"] == setup["smallest"]


def test_the_largest_ring_fits_into_the_window() -> None:
    setup = acuity_setup(ScreeningOptions(), pixel_mm=0.25, distance_mm=6000, height_px=600, seed=1)
    content = next_content("acuity", setup, [])
    assert content is not None
    assert content["size"] == pytest.approx(setup["largest"], abs=1e-3)
    assert len(draw("acuity", setup, content)) <= 0.52 * 600


def test_a_test_goes_on_from_its_rows_alone() -> None:
    setup = acuity_setup(ScreeningOptions(), 0.25, 2000, 1000, seed=5)
    items: list[Item] = []
    while (content := next_content("acuity", setup, items)) is not None:
        assert next_content("acuity", setup, items) == content
        items.append(Item(content, content["gap"]))
    assert len(items) < n_items("acuity", setup) == 24
    assert len({one.content["gap"] for one in items}) > 4
    assert verdict_of("acuity", setup, items)[0] == "passed"


def test_options_are_read_as_they_were_written() -> None:
    content = {"tests": ["colour"], "distance": "fixed", "distance_cm": 90.0, "on_failure": "stop", "acuity_limit": 0.0}
    options = parse_options({"optional_stages": ["screening"], "screening": content})
    assert options.way == ("introduction", "screening", "trial", "finished")
    assert options.screening == ScreeningOptions(
        tests=("colour",), distance="fixed", distance_cm=90, on_failure="stop", acuity_limit=0.0
    )
    for one in (options, StudyOptions()):
        assert parse_options(one.as_json()) == one


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ([], "table of its own"),
        ({"hearing": True}, "'hearing' is not known"),
        ({"tests": []}, "expected some of acuity, colour"),
        ({"tests": ["acuity", "acuity"]}, "expected some of"),
        ({"tests": "acuity"}, "expected some of"),
        ({"tests": [[]]}, "expected some of"),
        ({"acuity_limit": 2}, "from -0.3 to 1"),
        ({"acuity_limit": True}, "expected a number"),
        ({"acuity_limit": float("nan")}, "expected a number"),
        ({"distance": "guessed"}, "typed, fixed, blind spot"),
        ({"distance": "fixed"}, "distance_cm is empty, but the viewing distance is .fixed."),
        ({"distance_cm": 90}, "distance_cm is 90, but the viewing distance is .typed."),
        ({"colour_axes": ["red"]}, "protan, deutan, tritan"),
        ({"colour_misses": 5}, "from 0 to 4"),
        ({"colour_misses": 0.5}, "0.5, expected a whole number from 0 to 4"),
        ({"on_failure": "shout"}, "record, stop"),
    ],
)
def test_options_that_are_not_right_are_named(content: Any, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        parse_options({"screening": content})


@pytest.mark.parametrize(
    ("verdicts", "does_stop"),
    [
        (["passed", "passed"], False),
        (["passed", "failed"], True),
        (["not taken"], True),
        (["cannot be certified", "inconclusive"], False),
    ],
)
def test_the_rule_stops_who_fails_or_skips(verdicts: list[str], does_stop: bool) -> None:
    assert ScreeningOptions(on_failure="stop").stops(verdicts) == does_stop
    assert not ScreeningOptions().stops(verdicts)


@pytest.mark.parametrize(
    ("entered", "complaint"),
    [
        (EnteredResult("acuity", "", "20/20", "passed"), "instrument and result are needed"),
        (EnteredResult("acuity", "chart", "20/40", "passed", 0.3), "limit of 0.18 is 'failed'"),
        (EnteredResult("colour", "plates", "14 of 14", "passed", 0.0), "only for acuity"),
        (EnteredResult("colour", "plates", "14 of 14", "inconclusive"), "expected passed or failed"),
    ],
)
def test_an_entered_result_that_contradicts_itself_is_refused(entered: EnteredResult, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        check_entered(entered, ScreeningOptions())
