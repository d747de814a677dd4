"""Studies in name only, whose videos nobody sees, and participants with all their trials given out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import combinations
from pathlib import Path
from typing import Any
from uuid import uuid4

from sqlalchemy import select, update

from app.films.pairs import PairVideo
from app.intake.stimuli import Stimulus, StimulusSet
from app.store.database.engine import Database, open_database
from app.store.database.migrate import upgrade
from app.store.database.tables import assignment, session, trial
from app.store.participants.invitations import Invitation, insert_invitation, invitation_by_code
from app.store.studies.studies import insert_study
from app.store.trials.admission import Admission, admit
from app.store.trials.designs import insert_design
from app.store.trials.sessions import session_by_token
from app.store.trials.vote_records import Vote

NOW = datetime(2026, 3, 1, 12, 0, tzinfo=UTC)


@dataclass(frozen=True)
class Voter:
    """A session's token and its trials: public id and what is shown first."""

    token: str
    trials: Sequence[tuple[str, str]]

    def vote(self, number: int) -> Vote:
        """A vote for A on one of the trials."""
        trial, first_shown = self.trials[number]
        viewing = {"first_shown": first_shown, "shown_ms": 1000.0, "response_ms": 500.0, "switches": []}
        return Vote(self.token, trial, str(uuid4()), "a", viewing, NOW)


def seed_study(database: Database, datasets: Sequence[str], approaches: Sequence[str]) -> int:
    """Insert a study of every pair within each dataset; its id."""
    stimuli = [stimulus(dataset, approach) for dataset in datasets for approach in approaches]
    stimulus_set = StimulusSet(Path(), "test", "0" * 64, {}, tuple(stimuli))
    pairs = [
        pair_video(*pair)
        for dataset in stimulus_set.datasets
        for pair in combinations(stimulus_set.of_dataset(dataset), 2)
    ]
    row = {
        "slug": "test",
        "name": "Test",
        "state": "open",
        "exposure_s": 1.0,
        "seed": 1,
        "factors": {},
        "manifest_sha256": stimulus_set.sha256,
        "created_at": NOW,
    }
    with database.writing() as connection:
        study_id = insert_study(connection, row)
        insert_design(connection, study_id, stimulus_set, pairs)
    return study_id


def begin_session(database: Database, invitation: Invitation, now: datetime) -> str:
    """Let a participant in; the session's token."""
    return admit(database, invitation, Admission(), now).token


def seed_voters(database: Database, n_voters: int, n_approaches: int) -> list[Voter]:
    """Insert a study, and participants who may vote on every pair of so many approaches."""
    study_id = seed_study(database, ["ball"], [f"a_{number}" for number in range(n_approaches)])
    with database.writing() as connection:
        invitation = invitation_by_code(connection, insert_invitation(connection, study_id, None, NOW))
    assert invitation is not None
    tokens = [begin_session(database, invitation, NOW) for _ in range(n_voters)]
    with database.writing() as connection:
        connection.execute(update(session).values(stage="trial"))
        connection.execute(update(trial).values(served_at=NOW))
        voters = []
        for token in tokens:
            begun = session_by_token(connection, token)
            assert begun is not None
            rows = connection.execute(
                select(trial.c.public_id, assignment.c.first_shown)
                .join(assignment)
                .where(trial.c.session_id == begun.id)
                .order_by(assignment.c.position)
            )
            voters.append(Voter(token, [(public_id, first_shown) for public_id, first_shown in rows]))
    return voters


def seeded_voters(url: str, n_voters: int, n_approaches: int) -> list[Voter]:
    """Migrate a database, and insert voters as `seed_voters` does."""
    with open_database(url) as database:
        upgrade(database)
        return seed_voters(database, n_voters, n_approaches)


def stimulus(dataset: str, approach: str) -> Stimulus:
    return Stimulus(
        dataset=dataset, approach=approach, video="v.mp4", sha256="0" * 64, width=64, height=48, fps=25, n_frames=25
    )


def pair_video(top: Stimulus, bottom: Stimulus, **other_films: Any) -> PairVideo:
    return PairVideo(top, bottom, "file.mp4", "0" * 64, 64, 48, 16, 25, 25, **other_films)
