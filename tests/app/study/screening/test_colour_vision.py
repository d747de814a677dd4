"""Plates of dots, seen by artificial observers who lack a cone or none."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import rankdata

from app.simulation.observer import Observer
from app.study.screening.colour_vision import (
    AXES,
    CONE_OF,
    DIRECTIONS,
    DISTANCE_UV,
    LUMINANCE,
    NOTHING,
    SIDE,
    Answer,
    Axis,
    ColourTest,
    PlannedPlate,
    chromaticity,
    cone_signals,
    dot_colours,
    draw_plate,
    judge_colours,
    make_dots,
    plan_plates,
    unsettled_kinds,
)
from app.study.screening.pictures import decode_srgb

N_DOTS = 20_000  # of the ring, and of the ground
TEST = ColourTest()


def ring_and_ground(axis: Axis) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    is_figure = np.arange(2 * N_DOTS) < N_DOTS
    rgb = dot_colours(axis, is_figure, np.random.default_rng([1, CONE_OF[axis]]))
    return rgb[:N_DOTS], rgb[N_DOTS:]


def auc(ring: NDArray[np.float64], ground: NDArray[np.float64]) -> float:
    """The probability that a value of the ring is larger than one of the ground, or smaller where that is rarer."""
    ranks = rankdata(np.concatenate([ring, ground]))[: len(ring)]
    larger = (ranks.sum() - len(ring) * (len(ring) + 1) / 2) / (len(ring) * len(ground))
    return float(max(larger, 1 - larger))


def best_linear_auc(ring: NDArray[np.float64], ground: NDArray[np.float64]) -> float:
    """Of Fisher's discriminant, learnt on one half of the dots and tried on the other."""
    learnt, tried = slice(0, N_DOTS // 2), slice(N_DOTS // 2, None)
    spread = np.cov(ring[learnt].T) + np.cov(ground[learnt].T)
    weights = np.linalg.solve(spread, ring[learnt].mean(axis=0) - ground[learnt].mean(axis=0))
    return auc(ring[tried] @ weights, ground[tried] @ weights)


def seen(rgb: NDArray[np.uint8], cones: list[int]) -> NDArray[np.float64]:
    """Log signals of some cones with squares and products, so that a bent boundary is found too."""
    logs = np.log(cone_signals(rgb)[:, cones])
    logs = logs - logs.mean()
    products = [logs[:, i] * logs[:, j] for i in range(len(cones)) for j in range(i, len(cones))]
    return np.column_stack([logs, *products])


@pytest.mark.parametrize("axis", AXES)
def test_without_its_cone_an_axis_cannot_be_told_and_with_it_it_can(axis: Axis) -> None:
    ring, ground = ring_and_ground(axis)
    others = [cone for cone in range(3) if cone != CONE_OF[axis]]
    assert best_linear_auc(seen(ring, others), seen(ground, others)) <= 0.60
    assert best_linear_auc(seen(ring, [0, 1, 2]), seen(ground, [0, 1, 2])) >= 0.99


@pytest.mark.parametrize("axis", AXES)
def test_luminance_alone_tells_nothing(axis: Axis) -> None:
    ring, ground = (decode_srgb(rgb / 255.0) @ LUMINANCE for rgb in ring_and_ground(axis))
    assert auc(ring, ground) <= 0.53


@pytest.mark.parametrize("axis", AXES)
def test_ring_and_ground_are_as_far_apart_as_is_said(axis: Axis) -> None:
    ring, ground = (chromaticity(decode_srgb(rgb / 255.0)).mean(axis=0) for rgb in ring_and_ground(axis))
    assert math.dist(ring, ground) == pytest.approx(DISTANCE_UV[axis], rel=0.05)


def test_the_ground_of_a_catch_plate_is_one_of_the_others() -> None:
    rng = np.random.default_rng(3)
    found = {tuple(dot_colours("catch", np.zeros(4000, bool), rng).mean(axis=0).round(-1)) for _ in range(20)}
    assert len(found) == len(AXES)


def test_dots_do_not_touch_and_stay_on_the_plate() -> None:
    dots = make_dots(PlannedPlate("protan", 2, 4))
    assert len(dots.radius) > 300
    apart = np.linalg.norm(dots.centre[:, None] - dots.centre[None], axis=-1) - dots.radius[:, None] - dots.radius[None]
    assert apart[~np.eye(len(apart), dtype=bool)].min() > 0
    assert np.all(np.linalg.norm(dots.centre - SIDE / 2, axis=1) + dots.radius < SIDE / 2)
    assert 0.25 < dots.is_figure.mean() < 0.6


def test_a_plate_is_drawn_alike_from_its_seed_and_new_from_another() -> None:
    plate, other = (PlannedPlate("deutan", 4, seed) for seed in (1, 2))
    assert np.array_equal(draw_plate(plate), draw_plate(plate))
    assert (draw_plate(plate) != draw_plate(other)).mean() > 0.3


def test_a_test_begins_with_the_control_plate_and_mixes_the_others() -> None:
    plans = [plan_plates(TEST, np.random.default_rng(seed)) for seed in range(90)]
    for plan in plans:
        assert plan[0].kind == "control"
        assert Counter(one.kind for one in plan) == {**dict.fromkeys(AXES, 5), "catch": 2, "control": 1}
        assert all((one.gap == NOTHING) == (one.kind == "catch") for one in plan)
    assert len({plan[1].kind for plan in plans}) == 4
    assert {one.gap for plan in plans for one in plan} == {NOTHING, *DIRECTIONS}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lacks", "failed"), [(None, set()), ("protan", {"protan"}), ("deutan", {"deutan"}), ("tritan", {"tritan"})]
)
def test_artificial_observers_are_told_by_the_pictures_alone(lacks: Axis | None, failed: set[str]) -> None:
    rng = np.random.default_rng(11)
    observer = Observer(lacks=lacks)
    answers = [
        Answer(plate.kind, plate.gap, observer.answer_plate(draw_plate(plate), rng)) for plate in plan_plates(TEST, rng)
    ]
    verdict, details = judge_colours(answers, TEST)
    assert verdict == ("failed" if failed else "passed")
    assert failed <= set(details["failed_axes"])


def answers(protan_right: int, *, control: bool = True, n_catches_right: int = 2) -> list[Answer]:
    return [
        Answer("control", 0, 0 if control else 2),
        *(Answer("protan", 2, 2 if number < protan_right else NOTHING) for number in range(5)),
        *(Answer("deutan", 4, 4) for _ in range(5)),
        *(Answer("tritan", 6, 6) for _ in range(5)),
        *(Answer("catch", NOTHING, NOTHING if number < n_catches_right else 0) for number in range(2)),
    ]


@pytest.mark.parametrize(
    ("given", "verdict"),
    [
        (answers(5), "passed"),
        (answers(4), "passed"),
        (answers(3), "failed"),
        (answers(5, control=False), "inconclusive"),
        (answers(5, n_catches_right=1), "passed"),
        (answers(0, n_catches_right=0), "inconclusive"),
    ],
)
def test_one_slip_passes_and_answers_without_looking_say_nothing(given: list[Answer], verdict: str) -> None:
    assert judge_colours(given, TEST)[0] == verdict


def seen_until_settled(sees: Callable[[PlannedPlate], bool], seed: int) -> list[Answer]:
    """Answers to the plates of a plan in order, without those whose part of the verdict is settled."""
    given: list[Answer] = []
    for plate in plan_plates(TEST, np.random.default_rng(seed)):
        if plate.kind in unsettled_kinds(given, TEST):
            given.append(Answer(plate.kind, plate.gap, plate.gap if sees(plate) else NOTHING))
    return given


@pytest.mark.parametrize("seed", range(5))
def test_plates_that_can_change_nothing_are_left_out_and_the_verdict_is_that_of_all_of_them(seed: int) -> None:
    def wobbles(plate: PlannedPlate) -> bool:
        return plate.kind not in AXES or plate.seed % 3 > 0

    assert len(seen_until_settled(lambda _: True, seed)) == 1 + 3 * 4 + 1
    assert len(seen_until_settled(lambda plate: plate.kind not in AXES, seed)) == 1 + 3 * 2 + 1
    plan = plan_plates(TEST, np.random.default_rng(seed))
    all_of_them = [Answer(plate.kind, plate.gap, plate.gap if wobbles(plate) else NOTHING) for plate in plan]
    verdicts = [judge_colours(given, TEST) for given in (seen_until_settled(wobbles, seed), all_of_them)]
    assert verdicts[0][0] == verdicts[1][0]
    assert verdicts[0][1]["failed_axes"] == verdicts[1][1]["failed_axes"]


def test_who_guesses_passes_an_axis_less_than_twice_in_a_hundred() -> None:
    guesses = np.random.default_rng(2).integers(4, size=(20_000, TEST.n_plates)) == 0
    assert np.mean(guesses.sum(axis=1) >= TEST.n_plates - TEST.n_misses) < 0.02


def test_a_test_that_is_not_over_is_not_judged() -> None:
    with pytest.raises(ValueError, match=r"deutan.*not over"):
        judge_colours([one for one in answers(5) if one.kind != "deutan"], TEST)
