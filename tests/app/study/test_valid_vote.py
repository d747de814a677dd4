from __future__ import annotations

from typing import Any

import pytest

from app.study.valid_vote import InvalidVoteError, Vote, check_vote, check_vote_on_trial, has_seen_both, is_same


def vote(*switches: tuple[str, float], first_shown: str = "a", **changes: Any) -> Vote:
    viewing = {
        "first_shown": first_shown,
        "shown_ms": 1000.0,
        "response_ms": 10.0,
        "switches": [{"to": to, "at_ms": at_ms, "media_time_s": 0.0} for to, at_ms in switches],
    }
    return Vote(**{"client_id": "one", "choice": "none", "viewing": viewing} | changes)


@pytest.mark.parametrize("switches", [(), (("b", 10.0),), (("b", 10.0), ("a", 10.0), ("b", 900.0))])
def test_looks_that_alternate_in_time_are_valid(switches: tuple[tuple[str, float], ...]) -> None:
    check_vote(vote(*switches))


@pytest.mark.parametrize(
    ("wrong", "complaint"),
    [
        (vote(("a", 10.0)), "switch 1 goes to 'a'"),
        (vote(("b", 10.0), ("b", 20.0)), "switch 2 goes to 'b'"),
        (vote(("b", 10.0), ("a", 9.0)), "switch 2 is at 9.0 ms"),
    ],
)
def test_contradictions_are_refused_with_their_place(wrong: Vote, complaint: str) -> None:
    with pytest.raises(InvalidVoteError, match=complaint):
        check_vote(wrong)


def test_a_vote_on_what_the_trial_did_not_show_is_refused() -> None:
    check_vote_on_trial(vote(("b", 10.0)), "a")
    with pytest.raises(InvalidVoteError, match="first_shown is 'b'"):
        check_vote_on_trial(vote(first_shown="b"), "a")
    looked_at_it = vote(("b", 10.0), ("reference", 20.0))
    with pytest.raises(InvalidVoteError, match="switch 2 goes to the reference"):
        check_vote_on_trial(looked_at_it, "a")
    check_vote_on_trial(looked_at_it, "a", has_reference=True)


@pytest.mark.parametrize(
    ("looks", "both"), [([], False), ([("reference", 1.0)], False), ([("reference", 1.0), ("b", 2.0)], True)]
)
def test_who_saw_the_reference_only_has_not_seen_both(looks: list[tuple[str, float]], both: bool) -> None:
    assert has_seen_both(vote(*looks).viewing) is both


def test_a_vote_is_the_same_when_all_of_it_is() -> None:
    assert is_same(vote(("b", 1.0)), vote(("b", 1.0)))
    assert not is_same(vote(), vote(choice="a"))
    assert not is_same(vote(), vote(client_id="two"))
    assert not is_same(vote(), vote(("b", 1.0)))
