"""What a study asks of its participants besides the votes: its optional stages and their content."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

from app.study.questionnaire import DEFAULT_QUESTIONS, Question, parse_questions
from app.study.stages import INTERVIEW, OPTIONAL_STAGES, way_through

LONGEST_TEXT = 20_000  # characters of a consent text


@dataclass(frozen=True)
class StudyOptions:
    """A study's options; the defaults are the quickest study there is.

    Parameters
    ----------
    optional_stages : of practice and interview, those that are on
    consent : what a participant agrees to, paragraphs apart by an empty line; empty: none is asked for
    consent_version : how its authors call this text
    comprehension : whether the instructions end with a question on them
    questions : of the interview
    debriefing : what participants read at the end, paragraphs apart by an empty line
    """

    optional_stages: tuple[str, ...] = ()
    consent: str = ""
    consent_version: str = ""
    comprehension: bool = False
    questions: tuple[Question, ...] = ()
    debriefing: str = ""

    @property
    def way(self) -> tuple[str, ...]:
        return way_through(self.optional_stages)

    @property
    def consent_sha256(self) -> str:
        return hashlib.sha256(self.consent.encode()).hexdigest() if self.consent else ""

    def as_json(self) -> dict[str, Any]:
        """What `parse_options` reads again."""
        content = asdict(self)
        return {
            **content,
            "optional_stages": list(self.optional_stages),
            "questions": [asdict(q) for q in self.questions],
        }


def parse_options(content: Mapping[str, Any]) -> StudyOptions:
    """Options from a study file or the database.

    Raises
    ------
    ValueError
        If a key is unknown or a value is not as described: says which.
    """
    known = {one.name for one in fields(StudyOptions)}
    if unknown := sorted(set(content) - known):
        raise ValueError(f"option {unknown[0]!r} is not known; expected some of {', '.join(sorted(known))}")
    stages = content.get("optional_stages", ())
    if not isinstance(stages, Sequence) or isinstance(stages, str):
        raise ValueError(f"optional_stages is {stages!r}, expected a list of {', '.join(OPTIONAL_STAGES)}")
    way_through(stages)
    questions = parse_questions(content.get("questions", ()))
    if INTERVIEW in stages and not questions:
        questions = DEFAULT_QUESTIONS
    comprehension = content.get("comprehension", False)
    if not isinstance(comprehension, bool):
        raise ValueError(f"comprehension is {comprehension!r}, expected true or false")
    return StudyOptions(
        optional_stages=tuple(stages),
        consent=_text(content, "consent"),
        consent_version=_text(content, "consent_version"),
        comprehension=comprehension,
        questions=questions,
        debriefing=_text(content, "debriefing"),
    )


def _text(content: Mapping[str, Any], name: str) -> str:
    value = content.get(name, "")
    if not isinstance(value, str) or len(value) > LONGEST_TEXT:
        raise ValueError(f"{name}: expected a text of at most {LONGEST_TEXT} characters")
    return value.strip()
