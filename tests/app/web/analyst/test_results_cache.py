"""What the votes say is worked out anew whenever something has changed, and votes are not read while nothing has."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from datetime import timedelta
from typing import Any

import numpy as np
import pytest
from sqlalchemy import Connection, update

from app.analysis import votes_from_rows
from app.analysis.reading.votes_table import A, B, VotesTable
from app.intake.reports import Measure
from app.store.database.engine import Database
from app.store.database.tables import study as study_table
from app.store.database.tables import vote
from app.store.participants.participants import exclude, participant_labelled, undo_exclusion, withdraw_participant
from app.store.studies.measurements import replace_measurements
from app.store.studies.studies import Study, all_studies
from app.store.trials.deletion import erase
from app.store.trials.vote_records import keep_votes, vote_records
from app.web.analyst import results
from app.web.analyst.results import grouped_results_of, results_of
from app.web.analyst.study_votes import read_votes_table
from tests.seeded_studies import NOW, seed_voters


@pytest.fixture
def n_read(monkeypatch: pytest.MonkeyPatch) -> Callable[[], int]:
    """How often all votes were read since this was asked last; not analysed, as that takes long."""
    reads: list[int] = []

    def noted(connection: Connection, study_id: int, *arguments: Any, **options: Any) -> Any:
        reads.append(study_id)
        return read_votes_table(connection, study_id, *arguments, **options)

    def count() -> int:
        n = len(reads)
        reads.clear()
        return n

    monkeypatch.setattr(results, "read_votes_table", noted)
    monkeypatch.setattr(results, "_analysed", lambda votes, inputs: {"votes": votes, **inputs.settings})
    return count


@pytest.mark.slow
def test_whatever_changes_is_seen_and_votes_are_read_only_then(database: Database, n_read: Callable[[], int]) -> None:
    voters = seed_voters(database, 2, 3)
    with database.reading() as connection:
        (study,) = all_studies(connection)
        first, second = (participant_labelled(connection, study.id, label) for label in ("P001", "P002"))
    votes = [voter.vote(number) for number in range(2) for voter in voters]
    changes: list[Callable[[Connection], object]] = [
        lambda connection: exclude(connection, first, "looked away", "Eva", NOW),
        lambda connection: undo_exclusion(connection, first, "Eva", NOW),
        lambda connection: exclude(connection, first, "slept", "Eva", NOW),
        lambda connection: replace_measurements(connection, study.id, [_measure(1.0)], NOW),
        lambda connection: replace_measurements(connection, study.id, [_measure(2.0)], NOW),
        lambda connection: connection.execute(update(study_table).values(options={"random_effects": "participants"})),
        lambda connection: withdraw_participant(connection, first, NOW),
        lambda connection: erase(connection, second, NOW),
    ]
    digests = [_looked_at(database, study, n_read)]
    for ballot in votes:
        keep_votes(database, [ballot])
        digests.append(_looked_at(database, study, n_read))
    for change in changes:
        with database.writing() as connection:
            change(connection)
        digests.append(_looked_at(database, study, n_read))
    before_exclusion, undone = len(votes), len(votes) + 2
    assert digests[undone] == digests[before_exclusion]
    assert len(set(digests)) == len(digests) - 1


@pytest.mark.slow
def test_as_many_votes_of_a_restored_backup_are_told_apart(database: Database, n_read: Callable[[], int]) -> None:
    (voter,) = seed_voters(database, 1, 3)
    with database.reading() as connection:
        (study,) = all_studies(connection)
    keep_votes(database, [voter.vote(0)])
    before = results_of(database, study.id)
    with database.writing() as connection:
        connection.execute(vote.delete())
    later = voter.vote(0)
    keep_votes(database, [replace(later, choice="b", received_at=NOW + timedelta(days=1))])
    after = results_of(database, study.id)
    assert after != before
    assert [made.analysis and made.analysis["votes"].choice.tolist() for made in (before, after)] == [[A], [B]]
    assert n_read() == 2


def test_counting_everybody_is_the_same_analysis_while_nobody_is_excluded(
    database: Database, n_read: Callable[[], int]
) -> None:
    (voter,) = seed_voters(database, 1, 3)
    with database.reading() as connection:
        (study,) = all_studies(connection)
    keep_votes(database, [voter.vote(0)])
    assert results_of(database, study.id) is results_of(database, study.id, with_excluded=True)
    assert n_read() == 1


def _looked_at(database: Database, study: Study, n_read: Callable[[], int]) -> str:
    """The digest of the results, which are those of the votes as they are now; votes are read once at most."""
    n_read()
    now = results_of(database, study.id)
    assert n_read() <= 1
    with database.reading() as connection:
        rows = list(vote_records(connection, study.id))
    assert (now.analysis is None) == (not rows)
    if rows:
        assert_same(now.analysis["votes"], votes_from_rows(rows))
    assert results_of(database, study.id) is now
    assert n_read() == 0
    counting_all = results_of(database, study.id, with_excluded=True)
    grouped = grouped_results_of(database, study)
    n_read()
    assert results_of(database, study.id, with_excluded=True) is counting_all
    assert grouped_results_of(database, study) is grouped
    assert n_read() == 0
    return now.digest


def assert_same(votes: VotesTable, expected: VotesTable) -> None:
    """Every name and column is the same, to the last bit."""
    for field in fields(VotesTable):
        column, wanted = getattr(votes, field.name), getattr(expected, field.name)
        if isinstance(wanted, tuple):
            assert column == wanted, field.name
        else:
            assert column.dtype == wanted.dtype, field.name
            np.testing.assert_array_equal(column, wanted, field.name)


def _measure(value: float) -> Measure:
    return Measure(
        dataset="ball", approach="a_0", measure="roughness", value=value, direction="less is better", unit="mm"
    )
