"""Places and slots when participants come to many processes at once."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from sqlalchemy import select

from app.store.database.engine import Database
from app.store.database.tables import assignment, participant
from app.store.participants.invitations import Invitation

ROOT = Path(__file__).parents[4]
N_PROCESSES, N_EACH, N_THREADS, N_PLACES = 2, 60, 15, 115


@pytest.mark.slow
def test_every_place_is_given_once_and_nobody_is_refused_while_one_is_free(
    database: Database, invite: Callable[[int | None], Invitation]
) -> None:
    code = invite(N_PLACES).code
    url = database.engine.url.render_as_string(hide_password=False)
    command = [sys.executable, "-m", "tests.app.store.enrol_participants", url, code, str(N_EACH), str(N_THREADS)]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    processes = [
        subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        for _ in range(N_PROCESSES)
    ]
    for process in processes:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    for process in processes:
        assert process.stdin is not None
        process.stdin.write("go\n")
        process.stdin.flush()
    admitted = [int(process.communicate()[0]) for process in processes]
    assert sum(admitted) == N_PLACES
    with database.reading() as connection:
        slots = sorted(connection.scalars(select(participant.c.slot)))
        assert slots == list(range(N_PLACES))
        assert len(connection.scalars(select(assignment.c.id)).all()) == 6 * N_PLACES
