"""The trials that were voted on or interrupted, a page at a time: what is found, in which order, and what it costs."""

from __future__ import annotations

from collections.abc import Callable
from datetime import timedelta
from itertools import product
from typing import Any

import pytest

from app.store.database.engine import Database
from app.store.participants.invitations import Invitation
from app.store.participants.participants import exclude, participant_labelled, withdraw_participant
from app.store.studies.studies import study_by_id
from app.store.trials.admission import begin_preview
from app.store.trials.deletion import erase
from app.store.trials.given_trials import SoughtTrials, given_labels, given_trials, n_given_trials
from app.store.trials.trial_records import trial_records
from app.store.trials.trials import void_trial
from tests.app.store.voting import keep_vote, let_in, rows_read, serve_next, vote_on
from tests.seeded_studies import NOW

N_VOTES = 4  # of six


@pytest.fixture
def given(database: Database, study_id: int, invite: Callable[[int | None], Invitation]) -> int:
    """A study in which five have voted and been interrupted; some of them at the same moment, some do not count."""
    invitation = invite(None)
    switch = [{"to": "b", "at_ms": 300.0}]
    for turn in range(6):
        person = let_in(database, invitation)
        if turn == 5:  # has begun, and given nothing yet
            break
        for number in range(N_VOTES):
            trial = serve_next(database, person)
            at = NOW + timedelta(seconds=number // 2)  # of all five at once
            if number == turn:
                seen = {"first_shown": trial.first_shown, "switches": []}
                void_trial(database, person.id, trial.public_id, "hidden", seen, at)
                continue
            sent = vote_on(trial, choice=("a", "b", "none")[(turn + number) % 3])
            if trial.first_shown == "a" and turn % 2:
                sent.viewing["switches"].extend(switch)
            keep_vote(database, person, trial.public_id, sent, at)
    with database.writing() as connection:
        exclude(connection, participant_labelled(connection, study_id, "P002"), "looked away", "Eva", NOW)
        withdraw_participant(connection, participant_labelled(connection, study_id, "P003"), NOW)
        erase(connection, participant_labelled(connection, study_id, "P004"), NOW)
        of = study_by_id(connection, study_id)
    assert of is not None
    begin_preview(database, of, NOW)
    return study_id


def looked_through(database: Database, study_id: int) -> list[dict[str, Any]]:
    """Every trial with a vote or an interruption, the latest first, without the database's help."""
    with database.reading() as connection:
        rows = [row for row in trial_records(connection, study_id) if row["choice"] or row["voided_at"]]
    return sorted(rows, key=lambda row: row["voted_at"] or row["voided_at"], reverse=True)


KINDS: dict[str, Callable[[dict[str, Any]], bool]] = {
    "": lambda _row: True,
    "voided": lambda row: row["voided_at"] is not None,
    "ties": lambda row: row["choice"] == "none",
    "unswitched": lambda row: row["n_switches"] == 0,
    "excluded": lambda row: row["withdrawn"] or row["exclusion"] is not None,
    "unheard of": lambda _row: True,
}


@pytest.mark.slow
def test_every_filter_finds_what_looking_through_all_trials_finds(database: Database, given: int) -> None:
    rows = looked_through(database, given)
    with database.reading() as connection:
        for participant, dataset, kind in product(("", "P001", "P003", "P999"), ("", "box", "none"), KINDS):
            sought = SoughtTrials(participant, dataset, kind)
            expected = [
                row
                for row in rows
                if participant in ("", row["participant"]) and dataset in ("", row["dataset"]) and KINDS[kind](row)
            ]
            assert given_trials(connection, given, sought, limit=1000) == expected, sought
            assert n_given_trials(connection, given, sought) == len(expected), sought
    assert all(any(KINDS[kind](row) for row in rows) for kind in KINDS)


def test_pages_follow_each_other_and_leave_nothing_out(database: Database, given: int) -> None:
    rows = looked_through(database, given)
    with database.reading() as connection:
        pages = [
            given_trials(connection, given, SoughtTrials(), limit=3, offset=at) for at in range(0, len(rows) + 3, 3)
        ]
    assert [row for page in pages for row in page] == rows


def test_everybody_is_listed_who_has_given_something(database: Database, given: int) -> None:
    with database.reading() as connection:
        assert given_labels(connection, given) == ["P001", "P002", "P003", "P004", "P005"]


@pytest.mark.parametrize("new_database_url", ["sqlite"], indirect=True)  # whose driver tells of every row
def test_a_page_reads_no_more_trials_than_it_shows(
    database: Database, given: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.store.trials.given_trials.MOST_COUNTED", 3)
    read = rows_read(database)
    with database.reading() as connection:
        n_ids = 7 + sum(row["voided_at"] is not None for row in looked_through(database, given))
        read.clear()
        given_trials(connection, given, SoughtTrials(), limit=5, offset=2)
        assert len(read) <= n_ids + 5 + 1  # the newest ids, the trials, and the study's protocol
        read.clear()
        assert n_given_trials(connection, given, SoughtTrials()) == 2 * 3 or n_ids < 7 + 3
        assert len(read) == 2
