"""A database with a study of two datasets and three conditions; its videos exist in name only."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime

import pytest

from app.store.database.engine import Database
from app.store.participants.invitations import Invitation, insert_invitation, invitation_by_code
from app.store.trials import orders
from tests.seeded_studies import NOW, seed_study

MakeInvitation = Callable[[int | None], Invitation]


@pytest.fixture
def now() -> datetime:
    return NOW


@pytest.fixture(autouse=True)
def times_that_tests_say(monkeypatch: pytest.MonkeyPatch) -> None:
    """How long ago a session began is told by the times that a test passes in, as after a new start of the machine."""
    monkeypatch.setattr(orders, "this_start", lambda: None)


@pytest.fixture
def study_id(database: Database) -> int:
    return seed_study(database, ("ball", "box"), ("id_fa", "id_fb", "pm_fb"))


@pytest.fixture
def invite(database: Database, study_id: int) -> MakeInvitation:
    def make(places: int | None) -> Invitation:
        with database.writing() as connection:
            code = insert_invitation(connection, study_id, places, NOW)
            invitation = invitation_by_code(connection, code)
        assert invitation is not None
        return invitation

    return make
