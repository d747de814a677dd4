"""A vote is counted once, whatever the network does."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import datetime, timedelta

import pytest
from sqlalchemy import select

from app.errors import ConflictError, GoneError, InvalidError, NoSessionError, NotFoundError
from app.store.database.engine import Database, open_database
from app.store.database.tables import session, vote
from app.store.participants.invitations import Invitation
from app.store.trials.sessions import withdraw
from app.store.trials.trial_records import trial_records
from app.store.trials.trials import NextTrial, next_trials, void_trial
from app.store.trials.vote_records import KeptVote, Vote, keep_votes, vote_records
from tests.app.store.voting import (
    Participant,
    keep_vote,
    let_in,
    n_votes,
    serve_next,
    serve_trials,
    vote_on,
)
from tests.seeded_studies import NOW

MakeInvitation = Callable[[int | None], Invitation]


@pytest.fixture
def of(database: Database, invite: MakeInvitation) -> Participant:
    return let_in(database, invite(None))


def test_a_vote_is_counted_once_when_it_is_sent_twice(database: Database, of: Participant, now: datetime) -> None:
    trial = serve_next(database, of)
    sent = vote_on(trial)
    first, second = (keep_vote(database, of, trial.public_id, sent, now) for _ in range(2))
    assert first.is_new
    assert not second.is_new
    assert replace(second, is_new=True) == first
    assert n_votes(database) == 1


def test_a_vote_is_counted_once_when_it_is_sent_many_times_at_once(
    database: Database, of: Participant, now: datetime
) -> None:
    trial = serve_next(database, of)
    sent = vote_on(trial)
    kept: list[KeptVote] = []
    barrier = threading.Barrier(8)

    def send() -> None:
        barrier.wait()
        kept.append(keep_vote(database, of, trial.public_id, sent, now))

    threads = [threading.Thread(target=send) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert Counter(one.is_new for one in kept) == {True: 1, False: 7}
    assert n_votes(database) == 1


@pytest.mark.slow
def test_a_second_vote_on_a_trial_is_refused(database: Database, of: Participant, now: datetime) -> None:
    trial = serve_next(database, of)
    sent = vote_on(trial)
    keep_vote(database, of, trial.public_id, sent, now)
    for other in (vote_on(trial), replace(sent, choice="b"), vote_on(trial, client_id=sent.client_id, choice="none")):
        with pytest.raises(ConflictError, match="has a vote already"):
            keep_vote(database, of, trial.public_id, other, now)
    with database.reading() as connection:
        assert connection.scalar(select(vote.c.choice)) == "a"


def test_a_votes_id_cannot_serve_for_another_trial(database: Database, of: Participant, now: datetime) -> None:
    first = serve_next(database, of)
    sent = vote_on(first)
    keep_vote(database, of, first.public_id, sent, now)
    second = serve_next(database, of)
    with pytest.raises(ConflictError, match="belongs to another vote"):
        keep_vote(database, of, second.public_id, vote_on(second, client_id=sent.client_id), now)


def test_a_trial_of_somebody_else_does_not_exist(
    database: Database, of: Participant, invite: MakeInvitation, now: datetime
) -> None:
    trial = serve_next(database, of)
    with pytest.raises(NotFoundError):
        keep_vote(database, let_in(database, invite(None)), trial.public_id, vote_on(trial), now)


def test_who_has_no_session_is_told_so(database: Database, of: Participant, now: datetime) -> None:
    trial = serve_next(database, of)
    with pytest.raises(NoSessionError):
        keep_vote(database, replace(of, token="invented"), trial.public_id, vote_on(trial), now)


def test_a_trial_that_was_not_given_out_takes_no_vote(database: Database, of: Participant, now: datetime) -> None:
    with database.reading() as connection:
        following = next_trials(connection, of.id)[1]
    with pytest.raises(ConflictError, match="not been given out"):
        keep_vote(database, of, following.public_id, vote_on(following), now)


def test_a_vote_that_contradicts_its_trial_is_not_kept(database: Database, of: Participant, now: datetime) -> None:
    trial = serve_next(database, of)
    wrong = dict(vote_on(trial).viewing) | {"first_shown": "b" if trial.first_shown == "a" else "a"}
    with pytest.raises(InvalidError, match="first_shown"):
        keep_vote(database, of, trial.public_id, vote_on(trial, viewing=wrong), now)
    assert n_votes(database) == 0


def test_the_last_vote_ends_the_session(database: Database, of: Participant, study_id: int, now: datetime) -> None:
    stages = []
    for _ in range(6):
        trial = serve_next(database, of)
        keep_vote(database, of, trial.public_id, vote_on(trial), now)
        with database.reading() as connection:
            stages.append(connection.scalar(select(session.c.stage)))
    assert stages == ["trial"] * 5 + ["finished"]
    with database.reading() as connection:
        assert next_trials(connection, of.id) == []
        assert connection.scalar(select(session.c.finished_at)) == now
        assert len(list(vote_records(connection, study_id))) == 6


def test_an_exported_vote_names_what_was_behind_the_labels(
    database: Database, of: Participant, study_id: int, now: datetime
) -> None:
    trial = serve_next(database, of)
    keep_vote(database, of, trial.public_id, vote_on(trial, choice="b"), now)
    with database.reading() as connection:
        (exported,) = vote_records(connection, study_id)
        planned = next(row for row in trial_records(connection, study_id) if row["trial"] == trial.public_id)
    assert exported["choice"] == "b"
    assert exported["response_ms"] == 12.5
    for column in ("participant", "dataset", "item_a", "item_b", "first_shown"):
        assert exported[column] == planned[column]
    assert exported["first_shown"] == exported["item_a" if trial.first_shown == "a" else "item_b"]


def test_who_has_withdrawn_gets_the_old_answer_and_no_new_one(
    database: Database, of: Participant, now: datetime
) -> None:
    first, second = serve_trials(database, of, 2)
    sent = vote_on(first)
    keep_vote(database, of, first.public_id, sent, now)
    withdraw(database, of.session, now)
    assert not keep_vote(database, of, first.public_id, sent, now).is_new
    with pytest.raises(GoneError):
        keep_vote(database, of, second.public_id, vote_on(second), now)
    assert n_votes(database) == 1


def test_many_votes_are_kept_together_and_a_refused_one_harms_no_other(
    database: Database, of: Participant, invite: MakeInvitation
) -> None:
    other = let_in(database, invite(None))
    mine, theirs = serve_trials(database, of, 6), serve_trials(database, other, 6)
    good = [vote_on(trial, of.token) for trial in mine] + [vote_on(trial, other.token) for trial in theirs[:3]]
    wrong = [
        vote_on(mine[0], other.token),
        replace(vote_on(theirs[3], other.token), token="invented"),
        replace(vote_on(theirs[3], other.token), trial="invented"),
        vote_on(theirs[3], other.token, client_id=good[0].client_id),
    ]
    outcomes = keep_votes(database, [*wrong[:2], *good, *wrong[2:]])
    assert [type(outcome) for outcome in outcomes[:2]] == [NotFoundError, NoSessionError]
    assert [outcome.is_new for outcome in outcomes[2:-2] if isinstance(outcome, KeptVote)] == [True] * 9
    assert [type(outcome) for outcome in outcomes[-2:]] == [NotFoundError, ConflictError]
    assert n_votes(database) == 9
    with database.reading() as connection:
        assert list(connection.scalars(select(session.c.stage).order_by(session.c.id))) == ["finished", "trial"]


def test_votes_that_come_again_among_new_ones_are_told_from_them(database: Database, of: Participant) -> None:
    trials = serve_trials(database, of, 6)
    votes = [vote_on(trial, of.token) for trial in trials]
    keep_votes(database, votes[1:3])
    another = vote_on(trials[1], of.token, choice="b")
    outcomes = keep_votes(database, [*votes, another])
    assert isinstance(outcomes.pop(), ConflictError)
    are_new = [outcome.is_new for outcome in outcomes if isinstance(outcome, KeptVote)]
    assert are_new == [True, False, False, True, True, True]
    assert n_votes(database) == 6
    with database.reading() as connection:
        assert connection.scalar(select(session.c.stage)) == "finished"


def test_a_vote_is_kept_to_the_last_digit(database: Database, of: Participant) -> None:
    trial = serve_next(database, of)
    switches = [{"to": "b" if trial.first_shown == "a" else "a", "at_ms": 1 / 3, "media_time_s": 0.1 + 0.2}]
    viewing = dict(vote_on(trial).viewing) | {"shown_ms": 1e4 / 7, "response_ms": 2**0.5, "switches": switches}
    sent = vote_on(trial, of.token, viewing=viewing)
    keep_votes(database, [sent])
    with database.reading() as connection:
        row = connection.execute(select(vote)).one()
    assert (row.viewing, row.shown_ms, row.response_ms) == (viewing, 1e4 / 7, 2**0.5)
    assert row.received_at == sent.received_at


def test_votes_are_kept_however_the_clock_jumps(database: Database, of: Participant) -> None:
    for number, jump_days in enumerate([0, -400, 3, 3000, -1, 0]):
        trial = serve_next(database, of)
        assert trial.position == number
        keep_vote(database, of, trial.public_id, vote_on(trial), NOW + timedelta(days=jump_days))
    with database.reading() as connection:
        assert connection.scalar(select(session.c.stage)) == "finished"
    assert n_votes(database) == 6


def test_the_same_vote_many_times_in_one_batch_is_kept_once(database: Database, of: Participant) -> None:
    trial = serve_next(database, of)
    sent, another = vote_on(trial, of.token), vote_on(trial, of.token, choice="b")
    outcomes = keep_votes(database, [sent, another, sent, replace(sent)])
    assert isinstance(outcomes.pop(1), ConflictError)
    assert sum(outcome.is_new for outcome in outcomes if isinstance(outcome, KeptVote)) >= 1
    assert all(isinstance(outcome, KeptVote) for outcome in outcomes)
    with database.reading() as connection:
        assert connection.scalars(select(vote.c.choice)).all() == [sent.choice]


def test_an_id_that_two_trials_use_at_once_is_kept_for_one(
    database: Database, of: Participant, invite: MakeInvitation
) -> None:
    """Two processes, as two engines: who comes second is refused, and not answered with the other's vote."""
    elsewhere = open_database(str(database.engine.url))
    other = let_in(database, invite(None))
    for mine, theirs in zip(serve_trials(database, of, 6), serve_trials(database, other, 6), strict=True):
        sent = vote_on(mine, of.token)
        votes = [sent, vote_on(theirs, other.token, client_id=sent.client_id)]
        barrier = threading.Barrier(2)

        def vote_at_once(where: Database, sent: Vote, barrier: threading.Barrier = barrier) -> object:
            barrier.wait()
            return keep_votes(where, [sent])[0]

        with ThreadPoolExecutor(2) as pool:
            outcomes = list(pool.map(vote_at_once, [database, elsewhere], votes))
        assert sorted(type(outcome).__name__ for outcome in outcomes) == ["ConflictError", "KeptVote"]
    elsewhere.dispose()
    assert n_votes(database) == 6


def test_a_vote_and_an_interruption_at_once_never_both_count(database: Database, invite: MakeInvitation) -> None:
    """Two processes, as two engines: the trial is either voted on or comes again."""
    elsewhere = open_database(str(database.engine.url))
    for _ in range(10):
        of = let_in(database, invite(None))
        trial = serve_next(database, of)
        barrier = threading.Barrier(2)

        def vote_here(sent: Vote, barrier: threading.Barrier = barrier) -> bool:
            barrier.wait()
            return isinstance(keep_votes(database, [sent])[0], KeptVote)

        def void_there(of: Participant, trial: NextTrial, barrier: threading.Barrier = barrier) -> bool:
            barrier.wait()
            try:
                return void_trial(elsewhere, of.id, trial.public_id, "hidden", {}, NOW)
            except ConflictError:
                return False

        with ThreadPoolExecutor(2) as pool:
            voted = pool.submit(vote_here, vote_on(trial, of.token))
            voided = pool.submit(void_there, of, trial)
        assert voted.result() != voided.result()
    elsewhere.dispose()
