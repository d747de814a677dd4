"""What a study asks of its participants besides the votes: its optional stages and their content."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from app.study.design import Repetition
from app.study.questionnaire import (
    DEFAULT_QUESTIONS,
    DEFAULT_SPOKEN_QUESTIONS,
    Question,
    parse_questions,
    parse_spoken_questions,
)
from app.study.screening import ScreeningOptions, parse_screening
from app.study.stages import INTERVIEW, OPTIONAL_STAGES, way_through
from app.study.technique import TWO_VIDEOS, WEBCODECS

LONGEST_TEXT = 20_000  # characters of a consent text
MOST_CHECKS = 100  # of a kind in each dataset
MOST_ADAPTIVE = 10_000  # pairs of each dataset
BREAK_EVERY = 25  # trials
SECOND_CODECS = ("", "vp9", "av1")  # besides H.264
FALLBACKS = ("", WEBCODECS, TWO_VIDEOS)
ABANDONED_AFTER_H = 24.0  # without an answer; whoever comes back the next day still finds their slot


@dataclass(frozen=True)
class StudyOptions:
    """A study's options; the defaults are the quickest study there is.

    Parameters
    ----------
    optional_stages : of screening, practice and interview, those that are on
    screening : its tests and limits
    consent : what a participant agrees to, paragraphs apart by an empty line; empty: none is asked for
    consent_version : how its authors call this text
    comprehension : whether the instructions end with a question on them
    questions : of the interview
    spoken_questions : what the experimenter asks aloud, noted in a form of the dashboard
    debriefing : what participants read at the end, paragraphs apart by an empty line
    both_orders, repeated_pairs, identical_pairs : what is shown besides every pair once, see `Repetition`
    adaptive_pairs : so many pairs of each dataset, chosen from the votes so far, instead of every pair; 0: every pair
    free_exposure : the participant ends the exposure; the films go on until then
    reference : the condition that is shown as the reference beside every pair, and compared with nothing; empty: none
    second_codec : in which films are there too, for browsers without H.264; empty: in none
    fallback : how a pair is shown where a browser plays no film of both: decoded picture by picture from a film of
        each (webcodecs); failing that, by two players, which may be a frame apart (two videos); empty: not at all
    break_every : trials after which a break is offered; 0: never
    abandoned_after_h : hours without an answer after which a slot that was not finished is given to somebody else
    """

    optional_stages: tuple[str, ...] = ()
    screening: ScreeningOptions = field(default_factory=ScreeningOptions)
    consent: str = ""
    consent_version: str = ""
    comprehension: bool = False
    questions: tuple[Question, ...] = ()
    spoken_questions: tuple[str, ...] = DEFAULT_SPOKEN_QUESTIONS
    debriefing: str = ""
    both_orders: bool = False
    repeated_pairs: int = 0
    identical_pairs: int = 0
    adaptive_pairs: int = 0
    free_exposure: bool = False
    reference: str = ""
    second_codec: str = ""
    fallback: str = WEBCODECS
    break_every: int = BREAK_EVERY
    abandoned_after_h: float = ABANDONED_AFTER_H

    @property
    def repetition(self) -> Repetition:
        return Repetition(self.both_orders, self.repeated_pairs, self.identical_pairs)

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
            "screening": {key: value for key, value in content["screening"].items() if value is not None},
            "questions": [asdict(q) for q in self.questions],
            "spoken_questions": list(self.spoken_questions),
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
    return StudyOptions(
        optional_stages=tuple(stages),
        screening=parse_screening(content.get("screening", {})),
        consent=_text(content, "consent"),
        consent_version=_text(content, "consent_version"),
        comprehension=_flag(content, "comprehension"),
        questions=questions,
        spoken_questions=parse_spoken_questions(content.get("spoken_questions")),
        debriefing=_text(content, "debriefing"),
        both_orders=_flag(content, "both_orders"),
        repeated_pairs=_count(content, "repeated_pairs", 0, MOST_CHECKS),
        identical_pairs=_count(content, "identical_pairs", 0, MOST_CHECKS),
        adaptive_pairs=_count(content, "adaptive_pairs", 0, MOST_ADAPTIVE),
        free_exposure=_flag(content, "free_exposure"),
        reference=_text(content, "reference"),
        second_codec=_one_of(content, "second_codec", SECOND_CODECS),
        fallback=_one_of(content, "fallback", FALLBACKS, WEBCODECS),
        break_every=_count(content, "break_every", BREAK_EVERY, 10_000),
        abandoned_after_h=_hours(content, "abandoned_after_h"),
    )


def _flag(content: Mapping[str, Any], name: str) -> bool:
    value = content.get(name, False)
    if not isinstance(value, bool):
        raise ValueError(f"{name} is {value!r}, expected true or false")
    return value


def _one_of(content: Mapping[str, Any], name: str, known: Sequence[str], default: str = "") -> str:
    value = content.get(name, default)
    if value not in known:
        raise ValueError(f"{name} is {value!r}, expected one of {', '.join(filter(None, known))}, or nothing")
    return str(value)


def _count(content: Mapping[str, Any], name: str, default: int, most: int) -> int:
    value = content.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= most:
        raise ValueError(f"{name} is {value!r}, expected a whole number from 0 to {most}")
    return value


def _hours(content: Mapping[str, Any], name: str) -> float:
    value = content.get(name, ABANDONED_AFTER_H)
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < math.inf:
        raise ValueError(f"{name} is {value!r}, expected hours, more than 0")
    return float(value)


def _text(content: Mapping[str, Any], name: str) -> str:
    value = content.get(name, "")
    if not isinstance(value, str) or len(value) > LONGEST_TEXT:
        raise ValueError(f"{name}: expected a text of at most {LONGEST_TEXT} characters")
    return value.strip()
