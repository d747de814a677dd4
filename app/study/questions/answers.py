"""Word the answers of the questionnaire as a reader would say them: labels for options, a scale with its ends."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from app.study.languages.language_pack import model_texts
from app.study.questions.questionnaire import Question

LEFT_OUT = "left out"
QUESTIONS = "questions"  # begins the keys of their texts


@dataclass(frozen=True)
class AskedQuestion:
    """A question with its English texts, or those of the study's first language where it has none.

    Parameters
    ----------
    question : of the study's options
    text : its wording
    labels : of a choice, the answers as they are shown; of a scale, its two ends
    """

    question: Question
    text: str
    labels: tuple[str, ...]

    def label(self, answer: Any) -> str:
        """Return an option or a step of the scale as it is shown."""
        if self.question.kind == "choice" and answer in self.question.options and self.labels:
            return self.labels[self.question.options.index(answer)]
        ends = dict(zip((1, self.question.maximum), self.labels, strict=False))
        step = f"{answer:.15g}" if isinstance(answer, int | float) else str(answer)
        return f"{step} ({ends[answer]})" if self.question.kind == "scale" and answer in ends else step


@dataclass(frozen=True)
class WordedAnswer:
    """A question and its answer, both as people read them."""

    question: str
    answer: str
    is_left_out: bool = False


def worded_questions(questions: Sequence[Question], said: Mapping[str, Any]) -> dict[str, AskedQuestion]:
    """Return a study's questions by name, worded for its experimenters.

    Parameters
    ----------
    questions : of the study
    said : the study's own texts by key; for those that it lacks, the English pack's stand in
    """
    asked = {}
    for question in questions:
        key = f"{QUESTIONS}.{question.name}"
        text = str(said.get(f"{key}.text") or model_texts().get(f"{key}.text") or question.name)
        labels = said.get(f"{key}.labels") or pack_labels(question, model_texts())
        asked[question.name] = AskedQuestion(question, text, tuple(labels))
    return asked


def is_text_of(key: str, asked: Container[str]) -> bool:
    """Is it a text of the study, or of a question that is asked?"""
    group, _, rest = key.partition(".")
    return group != QUESTIONS or rest.partition(".")[0] in asked


def pack_labels(question: Question, texts: Mapping[str, Any]) -> list[str]:
    """Return a pack's labels of a question; none where it does not know it."""
    before = f"{QUESTIONS}.{question.name}."
    if question.kind == "scale":
        return list(texts.get(f"{before}ends", ()))
    labels = [texts.get(f"{before}options.{option}") for option in question.options]
    return [label for label in labels if label] if all(labels) else []


def worded_answers(asked: Mapping[str, AskedQuestion], answers: Mapping[str, Any]) -> list[WordedAnswer]:
    """Word the answers of a participant, in the order of the study's questions; then those to no question of it."""
    rows = [_worded(each, answers[name]) for name, each in asked.items() if name in answers]
    return rows + [WordedAnswer(name, str(answer)) for name, answer in answers.items() if name not in asked]


def _worded(asked: AskedQuestion, answer: Any) -> WordedAnswer:
    if answer is None or answer == "":
        return WordedAnswer(asked.text, LEFT_OUT, is_left_out=True)
    if asked.question.kind == "scale":
        ends = f", from 1 ({asked.labels[0]}) to {asked.question.maximum:g} ({asked.labels[1]})" if asked.labels else ""
        return WordedAnswer(asked.text, f"{answer:g} of {asked.question.maximum:g}{ends}")
    return WordedAnswer(asked.text, asked.label(answer))
