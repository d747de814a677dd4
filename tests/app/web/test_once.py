"""Work that several requests ask for at once."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pytest

from app.web.once import Latest, Shared

WAIT_S = 10


def test_what_many_ask_for_at_once_is_made_once() -> None:
    shared = Shared[str](n_kept=2)
    begun, go_on = threading.Event(), threading.Event()
    made = []

    def make() -> str:
        made.append(1)
        begun.set()
        assert go_on.wait(WAIT_S)
        return "scores"

    with ThreadPoolExecutor(4) as requests:
        first = requests.submit(shared.get, "votes", make)
        assert begun.wait(WAIT_S)
        others = [requests.submit(shared.get, "votes", make) for _ in range(3)]
        go_on.set()
        assert {one.result(WAIT_S) for one in (first, *others)} == {"scores"}
    assert len(made) == 1


def test_the_least_recently_asked_for_is_forgotten() -> None:
    shared = Shared[int](n_kept=2)
    for number, key in enumerate(("a", "b", "a", "c")):
        shared.get(key, partial(int, number))
    assert shared.get("a", lambda: 9) == 0
    assert shared.get("b", lambda: 9) == 9


def test_a_failure_is_told_and_tried_again() -> None:
    shared = Shared[str](n_kept=2)

    def fail() -> str:
        raise ValueError("no level of depth")

    for _ in range(2):
        with pytest.raises(ValueError, match="no level"):
            shared.get("votes", fail)
    assert shared.get("votes", lambda: "scores") == "scores"


def test_what_takes_long_goes_on_while_the_latest_is_shown() -> None:
    latest, may_end = Latest[int]("test"), threading.Event()
    assert latest.get("study", lambda: 1, WAIT_S) == (1, True)

    def slow() -> int:
        assert may_end.wait(WAIT_S)
        return 2

    assert latest.get("study", slow, 0.0) == (1, False)
    assert latest.get("study", lambda: 3, 0.0) == (1, False), "another one waits for the work that goes on"
    assert latest.get("other", lambda: 4, 0.0) == (None, False)
    may_end.set()
    assert latest.get("study", lambda: 5, WAIT_S) in ((2, True), (5, True))
    assert latest.get("study", lambda: 6, WAIT_S) == (6, True)
