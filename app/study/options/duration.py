"""Estimate how long each stage of a session takes, for what the pages announce."""

from __future__ import annotations

import math
from collections.abc import Mapping

from app.study.options.options import StudyOptions
from app.study.options.recruiting import OutsideOptions
from app.study.screening.acuity import AcuityTest
from app.study.screening.screening import ScreeningOptions, colour_setup, n_items
from app.study.stages import INTERVIEW, INTRODUCTION, PRACTICE, SCREENING, TRIAL

# Seconds as they were needed in trial runs, on the generous side: who is told too short a time feels hurried.
INSTRUCTIONS_S = 90.0  # welcome and three pages
WORDS_PER_S = 3.5  # careful reading; Brysbaert 2019 gives 4 for plain texts
COMPREHENSION_S = 15.0
CARD_S = 60.0  # fitted twice
DISTANCE_S = {"typed": 20.0, "fixed": 0.0, "blind spot": 75.0}
RING_S, PLATE_S = 4.0, 5.0
USUAL_SHARE = 0.75  # of a test's pictures: most people's verdict is certain before (of rings half, of plates 14 of 18)
TEST_INTRODUCTION_S = 20.0
PRACTICE_PAGES_S = 30.0
FIXATION_S = 0.5
VOTING_S = 5.0
BREAK_S = 60.0  # where the study has no minimum
FEWEST_AFTER_BREAK = 5  # trials: no break is offered shortly before the end
ANSWER_S = {"number": 8.0, "choice": 8.0, "scale": 8.0, "text": 45.0}
SPOKEN_ANSWER_S = 45.0


def stage_minutes(options: StudyOptions, n_trials: int, exposure_s: float) -> dict[str, float]:
    """Return how long each stage of a study takes, minutes, in the order of its stages.

    Parameters
    ----------
    options : of the study
    n_trials : that a participant sees
    exposure_s : how long a trial is shown; with a free exposure about as long
    """
    seconds = {
        INTRODUCTION: INSTRUCTIONS_S
        + len(options.consent.split()) / WORDS_PER_S
        + COMPREHENSION_S * options.comprehension,
        SCREENING: _screening_s(options.screening),
        PRACTICE: PRACTICE_PAGES_S + trials_s(options.n_practice, exposure_s),
        TRIAL: trials_s(n_trials, exposure_s) + n_breaks(n_trials, options.break_every) * max(BREAK_S, options.break_s),
        INTERVIEW: sum(ANSWER_S[question.kind] for question in options.questions)
        + SPOKEN_ANSWER_S * len(_asked_aloud(options)),
    }
    return {stage: round(seconds[stage] / 60, 2) for stage in options.way if stage in seconds}


def whole_minutes(minutes: Mapping[str, float]) -> dict[str, int]:
    """Return each stage's minutes as participants are told them; the sum is what they are told of all."""
    return {stage: max(1, math.floor(n + 0.5)) for stage, n in minutes.items()}


def trials_s(n_trials: int, exposure_s: float) -> float:
    """Return how long trials take without breaks, s: with the fixation, the answer and "Next"."""
    return n_trials * (FIXATION_S + exposure_s + VOTING_S)


def n_breaks(n_trials: int, break_every: int) -> int:
    """Count the breaks that a session offers."""
    if break_every == 0:
        return 0
    return max(0, n_trials - FEWEST_AFTER_BREAK) // break_every


def _asked_aloud(options: StudyOptions) -> tuple[str, ...]:
    """Return the spoken questions; none where people come from a recruiting platform, as nobody is there to ask."""
    return options.spoken_questions if options.outside == OutsideOptions() else ()


def _screening_s(screening: ScreeningOptions) -> float:
    seconds = 0.0
    if "acuity" in screening.tests:
        measuring_s = CARD_S + DISTANCE_S[screening.distance]
        seconds += measuring_s + TEST_INTRODUCTION_S + USUAL_SHARE * AcuityTest.n_trials * RING_S
    if "colour" in screening.tests:
        n_plates = n_items("colour", colour_setup(screening, seed=0))
        seconds += TEST_INTRODUCTION_S + USUAL_SHARE * n_plates * PLATE_S
    return seconds
