"""Parse the interview's questions of a study, and check answers against them."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal, Self, get_args

from pydantic import AfterValidator, BeforeValidator, Field, StringConstraints, model_validator

from app.study.option_fields import Different, ListOf, Options, Setting, SettingError

Kind = Literal["choice", "scale", "number", "text"]
KINDS: tuple[Kind, ...] = get_args(Kind)

MOST_QUESTIONS = 50
MOST_STEPS = 11  # of a scale
LONGEST_ANSWER = 2000  # characters
WORDED_QUESTIONS = ("age", "sex", "experience", "glasses", "criteria", "trained")  # the pages have texts for them
A_NUMBER = "a finite number; leave it out for none"


class InvalidAnswerError(ValueError):
    """An answer does not fit its question."""


Words = Annotated[str, BeforeValidator(str), StringConstraints(strip_whitespace=True)]  # a number is a text, too


def _is_number(value: Any) -> bool:
    """Is a value a number that a float can hold?"""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def _faults(question: Question) -> Iterator[str]:
    if not question.text and question.name not in WORDED_QUESTIONS:
        yield "it has no text"
    if question.kind == "choice" and len(question.options) < 2:
        yield "a choice needs at least two options"
    if question.kind == "choice" and not all(question.options):
        yield "an option is empty; delete it, as questions may be left out"
    if twice := [option for option in question.options if question.options.count(option) > 1]:
        yield f"the option {twice[0]!r} is there twice"
    if question.kind == "choice" and question.labels and len(question.labels) != len(question.options):
        yield "expected a label for each of its options"
    if question.kind == "scale" and question.maximum not in range(2, MOST_STEPS + 1):
        yield f"its maximum is {question.maximum!r}, expected 2 to {MOST_STEPS}"
    if question.kind == "scale" and question.labels and len(question.labels) != 2:
        yield "expected a label for each of its two ends, or none"
    for bound in (question.minimum, question.maximum):
        if bound is not None and not _is_number(bound):
            yield f"the bound {bound!r:.80} is too large, expected {A_NUMBER}"
    low, high = question.minimum, question.maximum
    if low is not None and high is not None and low > high:
        yield f"its minimum {low:g} is above its maximum {high:g}"


class Question(Options):
    """A question; it may be left unanswered unless it is required."""

    called: ClassVar[str] = "question"

    name: Annotated[str, Setting("Name", "key of its answer", expected="letters a-z, digits and _")] = Field(
        pattern="^[a-z][a-z0-9_]{0,39}$"
    )
    kind: Annotated[
        Kind, Setting("Kind", "choice of options, step of a scale (1, 2, …), number within bounds, or free text")
    ]
    text: Annotated[
        str,
        BeforeValidator(str),
        Setting("Wording", "empty: the page has a text under the name, in its language"),
    ] = ""
    options: Annotated[
        ListOf[Words],
        Setting("Options", "of a choice, the answers as they are stored", expected="a list of texts"),
    ] = ()
    labels: Annotated[
        ListOf[Words],
        Setting(
            "Labels",
            "of a choice, the answers as they are shown (empty: the page has them); of a scale, its two ends",
            expected="a list of texts",
        ),
    ] = ()
    minimum: Annotated[int | float | None, Setting("Least", "of a number", expected=A_NUMBER)] = None
    maximum: Annotated[
        int | float | None, Setting("Most", "of a number; a scale goes from 1 to it", expected=A_NUMBER)
    ] = None
    required: Annotated[bool, Setting("Required", "must be answered")] = False

    @model_validator(mode="after")
    def _fits_kind(self) -> Self:
        if fault := next(_faults(self), ""):
            raise SettingError("questions", fault, f"question {self.name}:")
        return self


DEFAULT_QUESTIONS = (
    Question(name="age", kind="number", minimum=16, maximum=120),
    Question(name="sex", kind="choice", options=("female", "male", "other", "unsaid")),
    Question(name="experience", kind="scale", maximum=5),
    Question(name="glasses", kind="choice", options=("none", "glasses", "lenses")),
    Question(name="criteria", kind="text"),
)

DEFAULT_SPOKEN_QUESTIONS = (
    "What did you look at when you compared the two?",
    "Was anything unclear or disturbing?",
    "What else would you like to say?",
)
MOST_SPOKEN_QUESTIONS = 20
LONGEST_QUESTION = 500  # characters


def _have_different_names(questions: tuple[Question, ...]) -> tuple[Question, ...]:
    names = [question.name for question in questions]
    if twice := [name for name in names if names.count(name) > 1]:
        raise SettingError("questions", "is there twice", f"question {twice[0]!r}")
    return questions


Questions = Annotated[ListOf[Question], Field(max_length=MOST_QUESTIONS), AfterValidator(_have_different_names)]
SpokenQuestions = Annotated[
    ListOf[Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=LONGEST_QUESTION)]],
    Field(max_length=MOST_SPOKEN_QUESTIONS),
    Different,
    BeforeValidator(lambda content: DEFAULT_SPOKEN_QUESTIONS if content is None else content),
]


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
            raise InvalidAnswerError(f"{question.name}: this is no answer to it")  # what is refused is logged


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
