"""Check what a participant sends to complete a stage: consent, comprehension, practice, answers."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

from app.study.options.options import StudyOptions
from app.study.options.wording import consent_in
from app.study.questions.comprehension import right_answer
from app.study.questions.questionnaire import InvalidAnswerError, check_answers
from app.study.stages import INTERVIEW, INTRODUCTION, PRACTICE


class InvalidStageError(ValueError):
    """The data sent do not complete the stage."""


def check_stage_data(stage: str, data: Mapping[str, Any], options: StudyOptions, language: str) -> None:
    """Check the data of a completed stage; data that the study does not ask for pass unchecked.

    Parameters
    ----------
    stage : the stage completed
    data : sent with it
    options : the study's
    language : of the session, in which its participant read the consent

    Raises
    ------
    InvalidStageError
        If the consent is missing or to another text, the instructions were not understood, a round of practice had no
        switch, or an answer does not fit.
    """
    if stage == INTRODUCTION:
        _check_introduction(data, options, language)
    if stage == PRACTICE:
        _check_practice(data, options)
    if stage == INTERVIEW:
        _check_interview(data, options)


def _check_introduction(data: Mapping[str, Any], options: StudyOptions, language: str) -> None:
    expected = consent_to_send(options, language)
    if expected is not None and data.get("consent") != expected:
        raise InvalidStageError(f"the consent is {data.get('consent')!r:.120}, expected one to {expected}")
    if options.comprehension and data.get("comprehension") != right_answer(options.protocol):
        raise InvalidStageError("the question on the instructions is not answered right")


def consent_to_send(options: StudyOptions, language: str) -> dict[str, str] | None:
    """Return what a participant sends to agree: version and digest of the text in their language; None: nothing."""
    text = consent_in(options, language)
    return {"version": options.consent_version, "sha256": hashlib.sha256(text.encode()).hexdigest()} if text else None


def _check_practice(data: Mapping[str, Any], options: StudyOptions) -> None:
    rounds = data.get("rounds")
    if not isinstance(rounds, list) or len(rounds) != options.n_practice:
        raise InvalidStageError(f"expected {options.n_practice} rounds of practice")
    for number, practice in enumerate(() if options.is_shown_alone else rounds, start=1):
        n_switches = practice.get("n_switches") if isinstance(practice, Mapping) else None
        if isinstance(n_switches, bool) or not isinstance(n_switches, int) or n_switches < 1:
            raise InvalidStageError(f"round {number} has {n_switches!r} switches, expected at least one")


def _check_interview(data: Mapping[str, Any], options: StudyOptions) -> None:
    answers = data.get("answers")
    if not isinstance(answers, Mapping):
        raise InvalidStageError("expected the answers, by question")
    try:
        check_answers(options.questions, answers)
    except InvalidAnswerError as error:
        raise InvalidStageError(str(error)) from error
