"""What looks unusual, beside a study's live monitor: looked for seldom, once for all who watch."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import httpx
import pytest

from app.operations.database import open_store
from app.settings import Settings
from app.simulation.participants import begin, next_trial
from app.store.trials.counted_votes import VoteState
from app.web.admin import flags as of_flags
from app.web.admin.flags import AT_MOST_EVERY, Flags
from tests.app.web.admin.dashboard_client import Dashboard, until

NOW = datetime(2026, 3, 1, 9, 0, tzinfo=UTC)
SOON = NOW + AT_MOST_EVERY / 2
LATER = NOW + AT_MOST_EVERY
STUDY = 1
WAIT_S = 10


class Analysis:
    """In place of one: it waits until it may end, counts how often it was begun, and finds something each time."""

    def __init__(self) -> None:
        self.n_begun = 0
        self.may_end = threading.Event()
        self.may_end.set()

    def __call__(self, *_: Any) -> dict[str, Any]:
        self.n_begun += 1
        number = self.n_begun
        assert self.may_end.wait(WAIT_S)
        return {"observers": [{"participant": "P001", "flags": [f"look {number}"]}]}


@pytest.fixture
def analysis(monkeypatch: pytest.MonkeyPatch) -> Analysis:
    analysis = Analysis()
    monkeypatch.setattr(of_flags, "analysis_of", analysis)
    return analysis


@pytest.fixture
def flags(tmp_path: Path, analysis: Analysis) -> Iterator[Flags]:
    database = open_store(Settings(data_dir=tmp_path))
    with Flags(database) as flags:
        yield flags
        analysis.may_end.set()
    database.dispose()


def votes(n_votes: int = 1, **changes: Any) -> VoteState:
    return replace(VoteState(n_votes, "newest", {}, (), ()), **changes)


def shown(flags: Flags, state: VoteState, at: datetime) -> str:
    return " ".join(flags.of(STUDY, state, at, WAIT_S).get("P001", ()))


def test_nothing_is_looked_for_again_while_nothing_changes(flags: Flags, analysis: Analysis) -> None:
    assert shown(flags, votes(0), NOW) == ""
    for minutes in range(60):
        assert shown(flags, votes(), NOW + timedelta(minutes=minutes)) == "look 1"
    assert analysis.n_begun == 1


@pytest.mark.parametrize("change", [{"n_votes": 2}, {"excluded": {"P001": "looked away"}}, {"withdrawn": ("P001",)}])
def test_a_change_is_looked_into_before_long(flags: Flags, change: dict[str, Any]) -> None:
    assert shown(flags, votes(), NOW) == "look 1"
    assert shown(flags, votes(**change), SOON) == "look 1"
    assert shown(flags, votes(**change), LATER) == "look 2"


def test_who_watches_does_not_wait_for_a_long_look_nor_begin_another(flags: Flags, analysis: Analysis) -> None:
    analysis.may_end.clear()
    assert [flags.of(STUDY, votes(n_votes), LATER) for n_votes in (1, 2, 3)] == [{}] * 3
    analysis.may_end.set()
    assert shown(flags, votes(4), LATER) == "look 1"


def test_a_look_that_fails_is_told_and_made_again(flags: Flags, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: Any) -> None:
        raise ValueError("no level of depth")

    with monkeypatch.context() as patch:
        patch.setattr(of_flags, "analysis_of", fails)
        with pytest.raises(ValueError, match="no level"):
            shown(flags, votes(), NOW)
    assert shown(flags, votes(), SOON) == ""
    assert shown(flags, votes(), LATER) == "look 1"


@pytest.fixture
def voted(
    client: httpx.Client, vote_body: Callable[..., dict[str, Any]], new_study: Callable[[], dict[str, Any]]
) -> dict[str, Any]:
    """A study with one vote, of which no page has shown what is unusual yet."""
    study = new_study()
    session = begin(client, study["slug"], study["invitation"])
    trial = next_trial(client, session["token"])
    assert trial is not None
    client.put(f"/api/v1/session/trials/{trial['trial']}/vote", json=vote_body(trial)).raise_for_status()
    return study


@pytest.mark.slow
def test_participants_are_shown_while_what_is_unusual_is_looked_for(
    experimenter: Dashboard, analysis: Analysis, voted: dict[str, Any]
) -> None:
    pages = [f"/admin/studies/{voted['slug']}/participants{which}" for which in ("", "/P001")]
    analysis.may_end.clear()
    for page in pages:
        assert "are being checked for anything unusual" in experimenter.get(page).text
    analysis.may_end.set()
    for page in pages:
        text = experimenter.get(page).text
        assert "look 1" in text
        assert "are being checked for anything unusual" not in text


def test_an_open_overview_shows_what_is_unusual_and_looks_once(
    experimenter: Dashboard, analysis: Analysis, voted: dict[str, Any]
) -> None:
    page = f"/admin/studies/{voted['slug']}"
    assert "look 1" in experimenter.get(page).text
    for _ in range(2):
        with experimenter.stream("GET", f"{page}/live", timeout=30) as stream:
            until(stream.iter_lines(), "look 1")
    assert analysis.n_begun == 1
