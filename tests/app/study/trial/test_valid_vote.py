from __future__ import annotations

from typing import Any

import pytest

from app.study.trial.valid_vote import (
    InvalidVoteError,
    check_viewing,
    has_seen_both,
    press_to_picture_ms,
    without_unknowns,
)


def looks(*switches: tuple[str, float], first_shown: str = "a") -> dict[str, Any]:
    """A viewing record."""
    return {
        "first_shown": first_shown,
        "shown_ms": 1000.0,
        "response_ms": 10.0,
        "switches": [{"to": to, "at_ms": at_ms, "media_time_s": 0.0} for to, at_ms in switches],
    }


@pytest.mark.parametrize("switches", [(), (("b", 0.0),), (("b", 10.0), ("a", 10.0), ("b", 900.0))])
def test_looks_that_alternate_in_time_are_valid(switches: tuple[tuple[str, float], ...]) -> None:
    check_viewing(looks(*switches), "a")


@pytest.mark.parametrize(
    ("wrong", "complaint"),
    [
        (looks(("a", 10.0)), "switch 1 goes to 'a'"),
        (looks(("b", 10.0), ("b", 20.0)), "switch 2 goes to 'b'"),
        (looks(("b", 10.0), ("a", 9.0)), "switch 2 is at 9.0 ms"),
        (looks() | {"shown_ms": 0.0}, "shown_ms is 0.0"),
    ],
)
def test_contradictions_are_refused_with_their_place(wrong: dict[str, Any], complaint: str) -> None:
    with pytest.raises(InvalidVoteError, match=complaint):
        check_viewing(wrong, "a")


def test_a_vote_on_what_the_trial_did_not_show_is_refused() -> None:
    with pytest.raises(InvalidVoteError, match="first_shown is 'b'"):
        check_viewing(looks(first_shown="b"), "a")
    with_reference = looks(("b", 10.0), ("reference", 20.0))
    with pytest.raises(InvalidVoteError, match="switch 2 goes to the reference"):
        check_viewing(with_reference, "a")
    check_viewing(with_reference, "a", has_reference=True)


@pytest.mark.parametrize(
    ("switches", "both"), [([], False), ([("reference", 1.0)], False), ([("reference", 1.0), ("b", 2.0)], True)]
)
def test_who_saw_the_reference_only_has_not_seen_both(switches: list[tuple[str, float]], both: bool) -> None:
    assert has_seen_both(looks(*switches)) is both


def test_the_time_from_press_to_picture_is_the_median_of_what_is_recorded() -> None:
    viewing = looks(("b", 100.0), ("a", 200.0), ("b", 300.0), ("a", 400.0))
    assert press_to_picture_ms(viewing) is None
    for switch, presented_ms in zip(
        viewing["switches"], (120.0, 230.0, 299.0), strict=False
    ):  # the third is impossible
        switch["presented_ms"] = presented_ms
    assert press_to_picture_ms(viewing) == 25.0
    viewing["switches"][3]["presented_ms"] = 400.0  # within the same millisecond
    assert press_to_picture_ms(viewing) == 20.0


def test_what_a_client_does_not_know_is_left_out() -> None:
    known = looks(("b", 1.0)) | {"dwell_ms": {"a": 1.0, "b": 2.0}}
    nulls = known | {
        "n_stalls": None,
        "switches": [known["switches"][0] | {"frame": None}],
        "dwell_ms": {"a": 1.0, "b": 2.0, "reference": None},
    }
    assert without_unknowns(nulls) == known
    assert without_unknowns(known | {"dwell_ms": None}) == looks(("b", 1.0))
