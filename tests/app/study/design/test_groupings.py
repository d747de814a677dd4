"""Groups of participants by their answers."""

from __future__ import annotations

from typing import Any

from app.study.design.groupings import SMALLEST_GROUP, groupings
from app.study.questions.questionnaire import DEFAULT_QUESTIONS


def rows(question: str, answers: list[Any]) -> list[dict[str, Any]]:
    return [{"participant": f"P{n}", "question": question, "answer": answer} for n, answer in enumerate(answers)]


def test_a_choice_groups_by_its_answers_and_leaves_out_small_groups() -> None:
    found = groupings(DEFAULT_QUESTIONS, rows("sex", ["female"] * 4 + ["male"] * 3 + ["other"] * 2 + [None]))
    assert list(found["sex"].values()) == ["female"] * 4 + ["male"] * 3


def test_a_number_divides_at_the_median() -> None:
    found = groupings(DEFAULT_QUESTIONS, rows("age", [20, 21, 30, 40, 41, 50]))
    assert list(found["age"].values()) == ["up to 30"] * 3 + ["above 30"] * 3


def test_nothing_is_grouped_by_what_does_not_divide() -> None:
    same = rows("glasses", ["none"] * 9)
    too_few = rows("experience", [1] * SMALLEST_GROUP + [5] * (SMALLEST_GROUP - 1))
    told = rows("criteria", ["shape", "holes"] * 5)
    forgotten = rows("no longer asked", ["a", "b"] * 5)
    assert groupings(DEFAULT_QUESTIONS, [*same, *too_few, *told, *forgotten]) == {}
