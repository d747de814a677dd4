from __future__ import annotations

from typing import Any

import pytest

from app.study.options.options import StudyOptions, parse_options
from app.study.questions.questionnaire import DEFAULT_QUESTIONS, InvalidAnswerError, Question, check_answers


def parse_questions(content: Any) -> tuple[Question, ...]:
    return parse_options({"questions": content}).questions


def test_questions_are_read_back_as_they_were_written() -> None:
    assert parse_questions([question.as_json() for question in DEFAULT_QUESTIONS]) == DEFAULT_QUESTIONS


def test_options_are_read_back_as_they_were_written() -> None:
    options = parse_options({"optional_stages": ["interview"], "consent": " I agree. ", "comprehension": True})
    assert options.consent == "I agree."
    assert options.questions == DEFAULT_QUESTIONS
    assert parse_options(options.as_json()) == options
    assert parse_options({}) == StudyOptions()


@pytest.mark.parametrize(
    "answers",
    [
        {},
        {"age": 30, "sex": "other", "experience": 5, "glasses": "none", "criteria": "sharp edges"},
        {"age": None, "criteria": ""},
        {"age": 30.5},
    ],
)
def test_answers_that_fit_are_taken(answers: dict[str, Any]) -> None:
    check_answers(DEFAULT_QUESTIONS, answers)


@pytest.mark.parametrize(
    "answers",
    [
        {"age": 3},
        {"age": "30"},
        {"age": True},
        {"age": float("nan")},
        {"age": 10**400},
        {"sex": "x"},
        {"experience": 0},
        {"experience": 6},
        {"experience": 2.5},
        {"criteria": "x" * 2001},
        {"criteria": 1},
        {"shoe_size": 42},
        {"sex": ["female"]},
    ],
)
def test_answers_that_do_not_fit_are_refused(answers: dict[str, Any]) -> None:
    with pytest.raises(InvalidAnswerError, match=next(iter(answers))):
        check_answers(DEFAULT_QUESTIONS, answers)


def test_a_number_larger_than_any_float_fits_no_question() -> None:
    questions = parse_questions([{"name": "income", "kind": "number", "text": "How much?"}])
    with pytest.raises(InvalidAnswerError, match="income"):
        check_answers(questions, {"income": -(10**400)})


def test_an_option_is_stored_without_the_spaces_around_it_as_the_page_sends_it() -> None:
    (question,) = parse_questions([{"name": "sex", "kind": "choice", "options": ["left ", " right"]}])
    check_answers([question], {"sex": "left"})


def test_a_required_question_must_be_answered() -> None:
    questions = parse_questions(
        [{"name": "hand", "text": "Which?", "kind": "choice", "options": ["l", "r"], "required": True}]
    )
    check_answers(questions, {"hand": "l"})
    with pytest.raises(InvalidAnswerError, match="hand is not answered"):
        check_answers(questions, {})


def test_an_empty_text_is_no_answer_to_a_required_question() -> None:
    questions = parse_questions([{"name": "criteria", "kind": "text", "required": True}])
    with pytest.raises(InvalidAnswerError, match="criteria is not answered"):
        check_answers(questions, {"criteria": ""})


@pytest.mark.parametrize(
    ("question", "complaint"),
    [
        ("age", "a table"),
        ({"name": "Age", "kind": "number"}, "name is 'Age'"),
        ({"name": "age", "kind": "guess"}, "kind is 'guess'"),
        ({"name": "age", "kind": "number", "max": 3}, "'max' is not known"),
        ({"name": "age", "kind": "number", "maximum": "3"}, "expected a finite number"),
        ({"name": "age", "kind": "number", "minimum": 10**400}, "expected a finite number"),
        ({"name": "age", "kind": "number", "minimum": float("inf")}, "expected a finite number"),
        ({"name": "age", "kind": "number", "minimum": 20, "maximum": 18}, "its minimum 20 is above its maximum 18"),
        ({"name": "age", "kind": "number", "required": "yes"}, "required is 'yes', expected true or false"),
        ({"name": "sex", "kind": "choice", "options": "lr"}, "options is 'lr', expected a list"),
        ({"name": "sex", "kind": "choice", "options": ["l", "r"], "labels": 3}, "labels is 3, expected a list"),
        ({"name": "hand", "kind": "choice", "options": ["l", "r"]}, "no text"),
        ({"name": "sex", "kind": "choice", "options": ["l"]}, "two options"),
        ({"name": "sex", "kind": "choice", "options": ["l", "r"], "labels": ["left"]}, "a label for each"),
        ({"name": "sex", "kind": "choice", "options": ["l", " "]}, "an option is empty"),
        ({"name": "sex", "kind": "choice", "options": ["l", "r", "l "]}, "'l' is there twice"),
        ({"name": "experience", "kind": "scale", "maximum": 100}, "2 to 11"),
        ({"name": "experience", "kind": "scale", "maximum": 5, "labels": ["bad"]}, "a label for each of its two ends"),
    ],
)
def test_a_question_that_is_not_right_is_named(question: Any, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        parse_questions([question])


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ({"stages": []}, "'stages' is not known"),
        ({"optional_stages": ["trial"]}, "holds 'trial'"),
        ({"optional_stages": "interview"}, "expected a list"),
        ({"comprehension": 1}, "true or false"),
        ({"consent": "x" * 20_001}, "consent"),
    ],
)
def test_an_option_that_is_not_right_is_named(content: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        parse_options(content)
