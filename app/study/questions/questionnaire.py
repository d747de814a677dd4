"""Parse the interview's questions of a study, and check answers against them."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal

from app.study.option_fields import is_list

Kind = Literal["choice", "scale", "number", "text"]
KINDS: tuple[Kind, ...] = ("choice", "scale", "number", "text")

MOST_QUESTIONS = 50
MOST_STEPS = 11  # of a scale
LONGEST_ANSWER = 2000  # characters


class InvalidAnswerError(ValueError):
    """An answer does not fit its question."""


@dataclass(frozen=True)
class Question:
    """A question; it may be left unanswered unless it is required.

    Parameters
    ----------
    name : key of its answer
    kind : choice of options, step of a scale (1, 2, …), number within bounds, or free text
    text : wording; empty: the page has a text under the name, in its language
    options : of a choice, the answers as they are stored
    labels : of a choice, the answers as they are shown (empty: the page has them); of a scale, its two ends
    minimum, maximum : of a number; a scale goes from 1 to `maximum`
    """

    name: str
    kind: Kind
    text: str = ""
    options: tuple[str, ...] = ()
    labels: tuple[str, ...] = ()
    minimum: float | None = None
    maximum: float | None = None
    required: bool = False


DEFAULT_QUESTIONS = (
    Question("age", "number", minimum=16, maximum=120),
    Question("sex", "choice", options=("female", "male", "other", "unsaid")),
    Question("experience", "scale", maximum=5),
    Question("glasses", "choice", options=("none", "glasses", "lenses")),
    Question("criteria", "text"),
)

WORDED_QUESTIONS = (*(question.name for question in DEFAULT_QUESTIONS), "trained")  # the pages have texts for them

DEFAULT_SPOKEN_QUESTIONS = (
    "What did you look at when you compared the two?",
    "Was anything unclear or disturbing?",
    "What else would you like to say?",
)
MOST_SPOKEN_QUESTIONS = 20
LONGEST_QUESTION = 500  # characters


def parse_spoken_questions(content: Any) -> tuple[str, ...]:
    """Read the questions that an experimenter asks aloud from a study file; None gives the default ones.

    Raises
    ------
    ValueError
        If it is not a list of different texts.
    """
    if content is None:
        return DEFAULT_SPOKEN_QUESTIONS
    is_short = is_list(content) and len(content) <= MOST_SPOKEN_QUESTIONS
    if not is_short or not all(
        isinstance(question, str) and 0 < len(question.strip()) <= LONGEST_QUESTION for question in content
    ):
        lengths = f"1 to {LONGEST_QUESTION} characters"
        raise ValueError(f"spoken_questions: expected a list of at most {MOST_SPOKEN_QUESTIONS} texts of {lengths}")
    questions = tuple(question.strip() for question in content)
    if len(set(questions)) < len(questions):
        raise ValueError("spoken_questions: one of them is there twice")
    return questions


def parse_questions(content: Any) -> tuple[Question, ...]:
    """Read the interview's questions from a study file.

    Raises
    ------
    ValueError
        Naming the question and its fault.
    """
    if not is_list(content):
        raise ValueError("questions: expected a list")
    if len(content) > MOST_QUESTIONS:
        raise ValueError(f"{len(content)} questions: expected at most {MOST_QUESTIONS}")
    questions = tuple(_question(entry, number) for number, entry in enumerate(content, start=1))
    names = [question.name for question in questions]
    if twice := [name for name in names if names.count(name) > 1]:
        raise ValueError(f"question {twice[0]!r} is there twice")
    return questions


def check_answers(questions: Sequence[Question], answers: Mapping[str, Any]) -> None:
    """Check that every answer fits its question; null, or an empty text, means that the question was left out.

    Raises
    ------
    InvalidAnswerError
        If an answer belongs to no question, does not fit, or a required one is missing.
    """
    by_name = {question.name: question for question in questions}
    if unknown := sorted(set(answers) - set(by_name)):
        raise InvalidAnswerError(f"{unknown[0]!r} is not asked")
    for question in questions:
        answer = answers.get(question.name)
        if answer is None or (answer == "" and question.kind == "text"):
            if question.required:
                raise InvalidAnswerError(f"{question.name} is not answered")
        elif not _fits(question, answer):
            raise InvalidAnswerError(f"{question.name}: {answer!r:.80} is no answer to it")


def _fits(question: Question, answer: Any) -> bool:
    if question.kind == "choice":
        return answer in question.options
    if question.kind == "text":
        return isinstance(answer, str) and len(answer) <= LONGEST_ANSWER
    if not _is_number(answer):
        return False
    low = 1.0 if question.kind == "scale" else question.minimum
    within = (low is None or answer >= low) and (question.maximum is None or answer <= question.maximum)
    return within and (question.kind == "number" or answer == int(answer))


def _is_number(value: Any) -> bool:
    """Is a value a number that a float can hold?"""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def _question(content: Any, number: int) -> Question:
    if isinstance(content, Question):
        return content
    if not isinstance(content, Mapping):
        raise ValueError(f"question {number}: expected a table of its own")
    known = {field.name for field in fields(Question)}
    if unknown := sorted(set(content) - known):
        raise ValueError(f"question {number}: {unknown[0]!r} is not known; expected some of {', '.join(sorted(known))}")
    name, kind = content.get("name"), _kind(content)
    if not isinstance(name, str) or not re.fullmatch(r"[a-z][a-z0-9_]{0,39}", name):
        raise ValueError(f"question {number}: its name is {name!r}, expected letters a-z, digits and _")
    question = Question(
        name,
        kind,
        str(content.get("text", "")),
        _texts(content, "options"),
        _texts(content, "labels"),
        content.get("minimum"),
        content.get("maximum"),
        content.get("required", False),
    )
    _check_kind(question)
    return question


def _texts(content: Mapping[str, Any], part: str) -> tuple[str, ...]:
    value = content.get(part, ())
    if not is_list(value):
        raise ValueError(f"question {content['name']}: its {part} are {value!r:.80}, expected a list of texts")
    return tuple(str(text).strip() for text in value)


def _kind(content: Mapping[str, Any]) -> Kind:
    for kind in KINDS:
        if content.get("kind") == kind:
            return kind
    given, kinds = content.get("kind"), ", ".join(KINDS)
    raise ValueError(f"question {content.get('name')}: its kind is {given!r}, expected one of {kinds}")


def _check_kind(question: Question) -> None:
    if not question.text and question.name not in WORDED_QUESTIONS:
        raise ValueError(f"question {question.name}: it has no text")
    if question.kind == "choice" and len(question.options) < 2:
        raise ValueError(f"question {question.name}: a choice needs at least two options")
    if question.kind == "choice" and not all(question.options):
        raise ValueError(f"question {question.name}: an option is empty; delete it, as questions may be left out")
    if twice := [option for option in question.options if question.options.count(option) > 1]:
        raise ValueError(f"question {question.name}: the option {twice[0]!r} is there twice")
    if question.kind == "choice" and question.labels and len(question.labels) != len(question.options):
        raise ValueError(f"question {question.name}: expected a label for each of its options")
    if question.kind == "scale" and question.maximum not in range(2, MOST_STEPS + 1):
        raise ValueError(f"question {question.name}: its maximum is {question.maximum!r}, expected 2 to {MOST_STEPS}")
    if question.kind == "scale" and question.labels and len(question.labels) != 2:
        raise ValueError(f"question {question.name}: expected a label for each of its two ends, or none")
    for bound in (question.minimum, question.maximum):
        if bound is not None and not _is_number(bound):
            raise ValueError(
                f"question {question.name}: the bound {bound!r:.80} is no finite number; leave it out for none"
            )
    low, high = question.minimum, question.maximum
    if low is not None and high is not None and low > high:
        raise ValueError(f"question {question.name}: its minimum {low:g} is above its maximum {high:g}")
    if not isinstance(question.required, bool):
        raise ValueError(f"question {question.name}: required is {question.required!r:.80}, expected true or false")
