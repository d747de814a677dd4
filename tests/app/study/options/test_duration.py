"""How long a session takes, as its pages announce it."""

from __future__ import annotations

import pytest

from app.study.kinds import PAPER, PRESETS
from app.study.options.duration import n_breaks, stage_minutes, whole_minutes
from app.study.options.options import parse_options
from app.study.options.presets import read_preset


def test_every_stage_with_something_to_do_is_counted() -> None:
    for name in PRESETS:
        options = parse_options(read_preset(name).options)
        minutes = stage_minutes(options, 75, 15.0)
        assert tuple(minutes) == options.way[:-1]
        assert all(value > 0 for value in minutes.values())


def test_the_papers_session_takes_about_as_long_as_its_summary_says() -> None:
    preset = read_preset(PAPER)
    assert "about 40 minutes" in preset.summary
    options = parse_options(preset.options)
    assert sum(stage_minutes(options, 75, 15.0).values()) == pytest.approx(40, abs=2)
    assert "minutes" not in options.consent, "the page beside it says how long this study takes"


def test_more_to_do_takes_longer() -> None:
    short = {"optional_stages": ["screening", "practice", "interview"], "screening": {"tests": ["colour"]}}
    shorter = stage_minutes(parse_options(short), 10, 5.0)
    pairs = [{"dataset": "ball", "a": "x", "b": "y"}, {"dataset": "box", "a": "x", "b": "y"}]
    more = {
        "screening": {"tests": ["acuity", "colour"], "distance": "blind spot"},
        "practice_pairs": pairs,
        "break_s": 120,
        "break_every": 5,
        "consent": "We ask you to take part. " * 20,
        "comprehension": True,
        "questions": [{"name": "why", "kind": "text", "text": "Why?"}],
    }
    longer = stage_minutes(parse_options(short | more), 20, 5.0)
    assert [stage for stage in longer if longer[stage] <= shorter[stage]] == ["interview"], "one question, not three"


@pytest.mark.parametrize("outside", [{"id": "PROLIFIC_PID"}, {"code": "C1A2"}, {"random_codes": True}])
def test_spoken_questions_take_no_time_of_people_from_a_platform(outside: dict[str, object]) -> None:
    here = {"optional_stages": ["interview"]}
    silent = stage_minutes(parse_options(here | {"spoken_questions": []}), 10, 5.0)
    assert stage_minutes(parse_options(here), 10, 5.0)["interview"] == pytest.approx(silent["interview"] + 2.25)
    assert stage_minutes(parse_options(here | {"outside": outside}), 10, 5.0) == silent


@pytest.mark.parametrize(("n_trials", "break_every", "expected"), [(75, 25, 2), (75, 0, 0), (29, 25, 0), (30, 25, 1)])
def test_no_break_is_offered_shortly_before_the_end(n_trials: int, break_every: int, expected: int) -> None:
    assert n_breaks(n_trials, break_every) == expected


def test_the_experimenter_reads_the_minutes_that_participants_are_told() -> None:
    minutes = {"introduction": 2.2, "screening": 4.3, "practice": 0.9, "trial": 1.4, "interview": 4.2}
    assert sum(whole_minutes(minutes).values()) == 12  # as static/js/time-left.js tells, though all of it is 13.0
    assert whole_minutes({"introduction": 0.2, "trial": 4.5}) == {"introduction": 1, "trial": 5}
