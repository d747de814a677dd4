"""A database with a study of two datasets and three conditions; its videos exist in name only."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from itertools import combinations
from pathlib import Path

import pytest

from app.stimuli import PairVideo, Stimulus, StimulusSet
from app.store.designs import insert_design
from app.store.engine import Database, open_database
from app.store.invitations import Invitation, insert_invitation, invitation_by_code
from app.store.migrate import upgrade
from app.store.studies import insert_study

NOW = datetime(2026, 3, 1, 12, 0, tzinfo=UTC)
MakeInvitation = Callable[[int | None], Invitation]


@pytest.fixture
def now() -> datetime:
    return NOW


@pytest.fixture
def database(new_database_url: Callable[[], str]) -> Iterator[Database]:
    database = open_database(new_database_url())
    upgrade(database)
    yield database
    database.dispose()


@pytest.fixture
def study_id(database: Database) -> int:
    stimuli = [_stimulus(dataset, approach) for dataset in ("ball", "box") for approach in ("id_fa", "id_fb", "pm_fb")]
    of = StimulusSet(Path(), "test", "0" * 64, {}, tuple(stimuli))
    pairs = [_pair(*pair) for dataset in of.datasets for pair in combinations(of.of_dataset(dataset), 2)]
    row = {
        "slug": "test",
        "name": "Test",
        "state": "open",
        "exposure_s": 1.0,
        "seed": 1,
        "factors": {},
        "manifest_sha256": of.sha256,
        "created_at": NOW,
    }
    with database.writing() as connection:
        study_id = insert_study(connection, row)
        insert_design(connection, study_id, of, pairs)
    return study_id


@pytest.fixture
def invite(database: Database, study_id: int) -> MakeInvitation:
    def make(places: int | None) -> Invitation:
        with database.writing() as connection:
            code = insert_invitation(connection, study_id, places, NOW)
            invitation = invitation_by_code(connection, code)
        assert invitation is not None
        return invitation

    return make


def _stimulus(dataset: str, approach: str) -> Stimulus:
    return Stimulus(
        dataset=dataset, approach=approach, video="v.mp4", sha256="0" * 64, width=64, height=48, fps=25, n_frames=25
    )


def _pair(top: Stimulus, bottom: Stimulus) -> PairVideo:
    return PairVideo(top, bottom, "file.mp4", "0" * 64, 64, 48, 16, 25, 25)
