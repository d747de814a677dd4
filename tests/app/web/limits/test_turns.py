"""Checks of uploads wait for one another: one of a person at a time, two in all."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import pytest

from app.web.limits import turns
from app.web.limits.turns import in_turn


class WaitedError(Exception):
    """Raised instead of waiting."""


def tells(*_: object) -> None:
    raise WaitedError


def test_one_check_of_a_person_runs_at_a_time_and_two_in_all(tmp_path: Path) -> None:
    with in_turn(tmp_path, "Ada", tells):
        with pytest.raises(WaitedError), in_turn(tmp_path, "Ada", tells):
            pass
        with in_turn(tmp_path, "Ben", tells), pytest.raises(WaitedError), in_turn(tmp_path, "Cleo", tells):
            pass
        with in_turn(tmp_path, "Cleo", tells):
            pass
    with in_turn(tmp_path, "Ada", tells):
        pass


def test_who_waits_goes_on_when_a_place_is_free_and_is_told_meanwhile(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(turns, "LOOKS_EVERY_S", 0)
    told = []
    with ExitStack() as others:
        others.enter_context(in_turn(tmp_path, "Ada", tells))
        others.enter_context(in_turn(tmp_path, "Ben", tells))

        def tell(what: str, _done: int, _total: int) -> None:
            told.append(what)
            others.close()

        with in_turn(tmp_path, "Cleo", tell):
            assert told == ["waiting for other uploads"]
