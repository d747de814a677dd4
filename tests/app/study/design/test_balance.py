"""The balance report finds what is uneven, and says that the design's own orders are even."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.study.design.balance import OrderPlan, TakenOrder, balance_report
from app.study.design.design import ONCE, Repetition, participant_order
from app.study.trial.trial import PlannedPair, PlannedTrial

SEED = 7


def plan_of(n_datasets: int, n_stimuli: int, repetition: Repetition = ONCE) -> OrderPlan:
    pairs: list[PlannedPair] = []
    names = {}
    for dataset in range(n_datasets):
        stimuli = [10 * dataset + number for number in range(n_stimuli)]
        names |= {key: (f"dataset {dataset}", f"condition {key % 10}") for key in stimuli}
        alone = [(key, key) for key in stimuli if repetition.identical_pairs]
        for top, bottom in [*combinations(stimuli, 2), *alone]:
            pairs.append(PlannedPair(len(pairs), dataset, top, bottom))
    return OrderPlan(pairs, SEED, repetition, names)


def taken(plan: OrderPlan, slot: int) -> TakenOrder:
    trials = participant_order(plan.pairs, plan.seed, slot, plan.repetition)
    return TakenOrder(f"P{slot}", slot, "finished", is_released=False, trials=trials)


def failing(plan: OrderPlan, orders: list[TakenOrder]) -> set[str]:
    return {rule["rule"] for rule in balance_report(plan, orders)["rules"] if not rule["ok"]}


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(
    st.integers(1, 4),
    st.integers(4, 5),
    st.integers(1, 14),
    st.builds(Repetition, st.booleans(), st.integers(0, 2), st.integers(0, 1)),
)
def test_the_designs_own_orders_break_no_rule(n: int, n_stimuli: int, n_people: int, repetition: Repetition) -> None:
    plan = plan_of(n, n_stimuli, repetition)
    report = balance_report(plan, [taken(plan, slot) for slot in range(n_people)])
    assert [rule for rule in report["rules"] if not rule["ok"]] == []
    assert report["ok"]


def test_both_orders_are_even_after_any_number_of_participants() -> None:
    for seed in range(20):
        plan = replace(plan_of(1, 4, Repetition(both_orders=True)), seed=seed)
        orders = [taken(plan, slot) for slot in range(4)]
        for n_people in (1, 2, 3, 4):
            assert failing(plan, orders[:n_people]) == set(), (seed, n_people)


@pytest.mark.slow
def test_trials_of_two_conditions_cannot_help_holding_both() -> None:
    plan = plan_of(2, 2, Repetition(both_orders=True, repeated_pairs=1))
    assert failing(plan, [taken(plan, slot) for slot in range(4)]) == set()


def edited(order: TakenOrder, **changes: Any) -> TakenOrder:
    first, *others = order.trials
    return replace(order, trials=[replace(first, **changes), *others])


def test_an_order_that_was_tampered_with_is_found() -> None:
    plan = plan_of(2, 4)
    orders = [taken(plan, slot) for slot in range(4)]
    other = "b" if orders[1].trials[0].first_shown == "a" else "a"
    orders[1] = edited(orders[1], first_shown=other)
    assert "orders that do not follow from seed and slot" in failing(plan, orders)
    assert "spread of the four ways in which a pair is seen" in failing(plan, orders)


def test_a_slot_that_two_hold_is_found() -> None:
    plan = plan_of(1, 4)
    assert "slots held by two participants" in failing(plan, [taken(plan, 0), taken(plan, 0)])
    released = replace(taken(plan, 0), is_released=True, state="abandoned")
    assert "slots held by two participants" not in failing(plan, [released, taken(plan, 0)])


def test_labels_that_always_follow_the_video_are_found() -> None:
    plan = plan_of(1, 6)
    trials = [PlannedTrial(pair.key, "top", "a") for pair in plan.pairs]
    assert failing(plan, [TakenOrder("P", 0, "finished", is_released=False, trials=trials)]) >= {
        "surplus of trials with a stimulus as A over as B",
        "surplus of trials with A first over B first",
        "surplus of trials with a stimulus first over second, by label",
        "trials in a row with the same stimulus",
    }


def test_datasets_that_always_come_in_the_same_order_are_found() -> None:
    plan = plan_of(3, 4)
    orders = [replace(taken(plan, 0), slot=slot) for slot in range(6)]
    assert failing(plan, orders) >= {
        "spread of the datasets over the positions",
        "spread of which dataset follows which",
    }


@pytest.mark.parametrize(("n_finished", "is_even"), [(4, True), (2, False)])
def test_who_finished_is_judged_apart_from_who_holds_a_slot(n_finished: int, is_even: bool) -> None:
    plan = plan_of(1, 4)
    orders = [taken(plan, slot) for slot in (0, 3, 1, 2)]
    orders = [order if at < n_finished else replace(order, state="under way") for at, order in enumerate(orders)]
    report = balance_report(plan, orders)
    assert report["ok"]
    shown = {(row["n_shown"], row["n_1_is_a"], row["n_1_is_first"]) for row in report["pairs"]}
    assert (shown == {(4, 2, 2)}) is is_even
    assert report["participants"]["finished"] == n_finished


def test_missing_and_released_slots_are_named() -> None:
    plan = plan_of(1, 4)
    report = balance_report(plan, [taken(plan, 0), replace(taken(plan, 1), is_released=True), taken(plan, 3)])
    assert report["slots"] == {"missing": [1, 2], "released": [1]}


def test_a_study_without_participants_has_a_report() -> None:
    report = balance_report(plan_of(2, 3), [])
    assert report["ok"]
    assert {row["n_shown"] for row in report["pairs"]} == {0}
