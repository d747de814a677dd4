"""Answers, verdicts and demographics in words."""

from __future__ import annotations

from typing import Any

import pytest

from app.study.options.options import parse_options
from app.study.options.wording import asked_questions
from app.study.questions.answers import worded_answers
from app.study.questions.demographics import demographic_sentence, demographics
from app.study.screening.verdicts import snellen, worded_result, worded_verdicts

OWN = {"name": "hand", "text": "Which hand?", "kind": "choice", "options": ["l", "r"], "labels": ["left", "right"]}
ASKED = parse_options({"questions": [
    {"name": "criteria", "kind": "text"},
    {"name": "experience", "kind": "scale", "maximum": 5},
    {"name": "sex", "kind": "choice", "options": ["female", "male", "other", "unsaid"]},
    {"name": "age", "kind": "number"},
    OWN,
]})  # fmt: skip


def test_answers_are_read_with_their_labels_and_questions() -> None:
    given = {"age": 34, "sex": "unsaid", "experience": 2, "hand": "l", "criteria": None, "old": "x"}
    worded = {row.question: row.answer for row in worded_answers(asked_questions(ASKED), given)}
    assert worded == {
        "How old are you?": "34",
        "What is your sex?": "I prefer not to say",
        "How much experience do you have with three-dimensional models or computer graphics?": (
            "2 of 5, from 1 (none) to 5 (very much)"
        ),
        "Which hand?": "left",
        "What made one model look better than another to you?": "left out",
        "old": "x",
    }


@pytest.mark.parametrize(("number", "words"), [(12345678, "12345678"), (1234567.5, "1234567.5"), (20.0, "20")])
def test_a_number_is_read_with_all_its_digits(number: float, words: str) -> None:
    assert [row.answer for row in worded_answers(asked_questions(ASKED), {"age": number})] == [words]


def test_a_study_without_english_texts_is_read_in_its_own_language() -> None:
    said = {"questions.hand.text": "Welche Hand?", "questions.hand.labels": ["links", "rechts"]}
    options = parse_options({"questions": [OWN | {"text": "Quelle main ?", "labels": []}], "languages": ["fr", "de"],
                             "texts": {"de": said}})  # fmt: skip
    assert asked_questions(options)["hand"].text == "Quelle main ?"


def answers(**by_question: list[Any]) -> list[dict[str, Any]]:
    return [
        {"participant": f"P{number}", "question": question, "answer": answer}
        for question, given in by_question.items()
        for number, answer in enumerate(given)
    ]


def test_demographics_are_those_of_the_papers_table() -> None:
    ages = [19, 59, *[36.36] * 20]  # Table 3: 22 people aged 19 to 59, 36.6 on average
    sexes = ["male"] * 9 + ["female"] * 13
    rows = demographics(asked_questions(ASKED), answers(sex=sexes, age=ages, criteria=["x"] * 22))
    assert [row["question"] for row in rows] == ["age", "sex", "sex", "sex", "sex"]
    assert (rows[0]["n"], rows[0]["minimum"], rows[0]["maximum"]) == (22, 19, 59)
    assert rows[0]["mean"] == pytest.approx(36.6, abs=0.01)
    assert {row["answer"]: row["n"] for row in rows[1:]} == {
        "female": 13, "male": 9, "other": 0, "I prefer not to say": 0,
    }  # fmt: skip
    assert rows[1]["share"] == 13 / 22
    said = demographic_sentence(22, rows)
    assert said == "22 participants took part: 13 female, 9 male; aged 19 to 59 (mean 36.6, SD 6.2)."


def test_who_leaves_a_question_out_is_counted_and_enters_no_mean() -> None:
    rows = demographics(asked_questions(ASKED), answers(experience=[1, None, 4, None]))
    summary, *steps, left_out = rows
    assert (summary["n"], summary["mean"], summary["answer"]) == (2, 2.5, None)
    assert [(row["answer"], row["n"]) for row in steps] == [
        ("1 (none)", 1), ("2", 0), ("3", 0), ("4", 1), ("5 (very much)", 0),
    ]  # fmt: skip
    assert (left_out["answer"], left_out["n"], left_out["share"]) == ("left out", 2, 0.5)
    assert demographic_sentence(1, rows[:1]) == "1 participant took part: experience 1 to 4 (mean 2.5, SD 2.1)."
    assert demographic_sentence(1, []) == "1 participant took part."


def screened(**row: Any) -> dict[str, Any]:
    nothing = dict.fromkeys(("logmar", "low", "high", "limit", "is_bound", "details", "verdict"))
    return {**nothing, "test": "acuity", "result_source": "screen", "n_answered": 4, **row}


def test_a_verdict_is_told_with_acuity_and_plates() -> None:
    acuity = screened(verdict="failed", logmar=0.3, low=0.2, high=0.4, limit=0.18, details={})
    assert worded_result(acuity) == (
        "Acuity: failed. 0.30 logMAR (20/40). With 95 % probability from 0.20 to 0.40 logMAR. "
        "The study's limit is 0.18 logMAR (20/30); larger is worse."
    )
    bound = screened(verdict="passed", logmar=-0.07, low=-0.071, high=-0.07, limit=0.18, is_bound=True, details={})
    assert worded_result(bound) == (
        "Acuity: passed. -0.07 logMAR (20/17) or better, the display draws no smaller rings. "
        "The study's limit is 0.18 logMAR (20/30); larger is worse."
    )
    plates = {"plates": {"control": {"right": 1, "of": 1}, "protan": {"right": 3, "of": 6}}, "failed_axes": ["protan"]}
    assert worded_result(screened(test="colour", verdict="failed", details=plates)) == (
        "Colour vision: failed. Plates answered right: plain control 1 of 1, protan (red) 3 of 6. "
        "Too many missed: protan (red)."
    )
    assert worded_result(screened()) == "Acuity: the test is under way, 4 answered."
    skipped = screened(verdict="not taken", details={"reason": "no card at hand"})
    assert worded_result(skipped) == "Acuity: not taken (no card at hand)."
    entered = screened(result_source="entered", verdict="passed", instrument="a chart", result="20/20", logmar=0.0)
    assert worded_result(entered) == "Acuity: passed by a chart, read as 20/20 (0.00 logMAR (20/20))."
    assert snellen(0.18) == "20/30"


def test_a_table_tells_verdicts_in_a_few_words() -> None:
    verdicts = {"acuity": ("passed", -0.04), "colour": ("passed", None)}
    assert worded_verdicts(verdicts) == "passed: acuity -0.04 logMAR, colour vision"
    assert worded_verdicts({"acuity": (None, None)}) == "under way: acuity"
    assert worded_verdicts({}) == ""
