"""Chance assigns participants to groups, and what it has assigned can be computed again."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.study.design.balance import TakenOrder, balance_report
from app.study.design.groups import Group, check_groups, group_of_slot
from app.study.options.options import StudyOptions, parse_options
from app.study.options.study_file import StudyFile, parse_study_file, write_study_file
from tests.app.study.design.test_balance import plan_of


@given(st.integers(2, 7), st.integers(0, 2**63 - 1), st.integers(1, 60))
def test_groups_differ_by_one_at_most_and_fill_their_own_slots(n_groups: int, seed: int, n_people: int) -> None:
    assigned = [group_of_slot(n_groups, seed, slot) for slot in range(n_people)]
    sizes = Counter(group for group, _ in assigned)
    assert max(sizes.values()) - min(sizes[group] for group in range(n_groups)) <= 1
    for group in range(n_groups):
        assert [place for number, place in assigned if number == group] == list(range(sizes[group]))


def test_chance_assigns_and_not_the_order_of_arrival() -> None:
    rows = {tuple(group_of_slot(3, seed, slot)[0] for slot in range(3)) for seed in range(60)}
    assert len(rows) == 6


@pytest.mark.parametrize("n_people", [1, 7])
def test_the_orders_of_groups_with_blocks_of_their_own_break_no_rule(n_people: int) -> None:
    blocks = (Group(name="near", datasets=("dataset 0", "dataset 1")), Group(name="far", datasets=("dataset 2",)))
    plan = replace(plan_of(3, 4), groups=blocks)
    orders = [
        TakenOrder(f"P{slot}", slot, "finished", is_released=False, trials=plan.order_of_slot(slot, plan.pairs))
        for slot in range(n_people)
    ]
    report = balance_report(plan, orders)
    assert [rule for rule in report["rules"] if not rule["ok"]] == []
    for order in orders:
        group = plan.group(order.slot)
        assert group is not None
        seen = {f"dataset {plan.pair(trial).dataset}" for trial in order.trials}
        assert seen == set(group.datasets)
    first, *others = orders
    foreign = replace(first, trials=plan.order_of_slot(first.slot + 1, plan.pairs))
    assert not balance_report(plan, [foreign, *others])["ok"]


def test_groups_are_read_from_a_study_file_and_written_into_it() -> None:
    groups = (Group(name="near", datasets=("ball",)), Group(name="far"))
    study = StudyFile(name="Temple", options=StudyOptions(groups=groups))
    assert parse_study_file(write_study_file(study)).options.groups == groups
    assert parse_options(study.options.as_json()).groups == groups


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        ("near", "expected a list"),
        ([{"name": "near"}], "at least two"),
        ([{"name": "near"}, {"name": "near"}], "there twice"),
        ([{"name": ""}, {"name": "far"}], "1 to 60 characters"),
        ([{"name": "near", "quota": 3}, {"name": "far"}], "'quota' is not known; expected some of name, datasets"),
        ([{"name": "near", "datasets": "ball"}, {"name": "far"}], "expected a list of names"),
    ],
)
def test_faulty_groups_are_refused_with_the_reason(content: Any, fault: str) -> None:
    with pytest.raises(ValueError, match=fault):
        parse_options({"groups": content})


def test_groups_that_do_not_fit_the_datasets_are_refused() -> None:
    with pytest.raises(ValueError, match="no dataset 'boll'; expected some of ball, box"):
        check_groups([Group(name="near", datasets=("boll",)), Group(name="far")], ["ball", "box"])
    with pytest.raises(ValueError, match="nobody would see the dataset 'box'"):
        check_groups([Group(name="near", datasets=("ball",)), Group(name="far", datasets=("ball",))], ["ball", "box"])
    check_groups([], ["ball"])
