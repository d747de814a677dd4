"""Group participants by their interview answers: by choice, or at the median of a number or scale."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from statistics import median_low
from typing import Any

from app.study.questions.questionnaire import Question

SMALLEST_GROUP = 3  # participants; members of smaller groups could be recognised


def groupings(questions: Sequence[Question], answers: Iterable[Mapping[str, Any]]) -> dict[str, dict[str, str]]:
    """Return question -> participant -> group, for questions that divide the participants into at least two groups.

    Parameters
    ----------
    answers : rows with `participant`, `question` and `answer`, which is None where left out
    """
    kinds = {question.name: question.kind for question in questions}
    given: dict[str, dict[str, Any]] = {}
    for row in answers:
        if row["answer"] is not None and kinds.get(row["question"]) in ("choice", "scale", "number"):
            given.setdefault(row["question"], {})[row["participant"]] = row["answer"]
    divided = {
        name: _chosen(by_participant) if kinds[name] == "choice" else _halves(by_participant)
        for name, by_participant in sorted(given.items())
    }
    large = {name: without_small_groups(groups) for name, groups in divided.items()}
    return {name: groups for name, groups in large.items() if len(set(groups.values())) > 1}


def _chosen(answers: Mapping[str, Any]) -> dict[str, str]:
    return {participant: str(answer) for participant, answer in answers.items()}


def _halves(answers: Mapping[str, Any]) -> dict[str, str]:
    """Split answers into up to the median, and above it."""
    middle = median_low([float(answer) for answer in answers.values()])
    return {
        participant: f"up to {middle:g}" if float(answer) <= middle else f"above {middle:g}"
        for participant, answer in answers.items()
    }


def without_small_groups(groups: Mapping[str, str]) -> dict[str, str]:
    """Return participant -> group without the groups whose members could be recognised."""
    names = list(groups.values())
    return {participant: name for participant, name in groups.items() if names.count(name) >= SMALLEST_GROUP}
