"""An acknowledged vote outlives the server's sudden death."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any
from uuid import uuid4

import httpx
import pytest

from app.operations import create, manage
from app.settings import Settings
from app.simulation.participants import begin
from app.store.studies import study_by_slug
from app.store.vote_records import vote_records

ROOT = Path(__file__).parents[3]
SERVER = """
import sys
from pathlib import Path
from app.main import serve
from app.settings import Settings
serve(Settings(data_dir=Path(sys.argv[1])), port=0, on_start=lambda base_url: print(base_url, flush=True))
"""


@pytest.mark.slow
def test_votes_acknowledged_before_a_kill_are_there_after_it(stimulus_set: Path, tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    study = create.create_study(settings, stimulus_set, "Killed")
    acknowledged: list[str] = []
    for _ in range(2):
        process = subprocess.Popen([sys.executable, "-c", SERVER, str(tmp_path)], stdout=subprocess.PIPE, cwd=ROOT)
        try:
            assert process.stdout is not None
            base_url = process.stdout.readline().decode().strip()
            acknowledged += votes_until_killed(base_url, study, process.pid)
        finally:
            process.kill()
            process.communicate()
    database = manage.open_store(settings)
    with database.reading() as connection:
        found = study_by_slug(connection, study["slug"])
        assert found is not None
        kept = [row["trial"] for row in vote_records(connection, found.id)]
    database.dispose()
    assert sorted(kept) == sorted(acknowledged)
    assert len(kept) == 6


def votes_until_killed(base_url: str, study: dict[str, Any], pid: int) -> list[str]:
    """Three votes; the server dies as soon as the third is acknowledged."""
    trials: list[str] = []
    with httpx.Client(base_url=base_url, timeout=30) as client:
        begin(client, study["slug"], study["invitation"])
        for _ in range(3):
            trial = client.get("/api/v1/session/trials/next").json()
            viewing = {"first_shown": trial["first_shown"], "shown_ms": 1, "response_ms": 1, "switches": []}
            body = {"id": str(uuid4()), "choice": "a", "viewing": viewing}
            assert client.put(f"/api/v1/session/trials/{trial['trial']}/vote", json=body).status_code == 201
            trials.append(trial["trial"])
        os.kill(pid, signal.SIGKILL)
    return trials
