"""The worker beside a server knows the server's settings, and no secret that it has no use for."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from app.operations.jobs.beside_server import _start
from app.settings import Settings
from tests.processes import kill

SECRETS = ("PGPASSWORD", "AWS_SECRET_ACCESS_KEY", "MY_TOKEN", "RECONSTUDY_MY_TOKEN")


def surroundings(settings: Settings) -> dict[str, str]:
    """The environment of a worker, as the system tells it."""
    process = _start(settings, 1)
    while not (said := Path(f"/proc/{process.pid}/environ").read_text()):
        time.sleep(0.01)  # the system tells it a moment after the program has begun
    kill(process.pid)
    process.wait()
    return dict(each.split("=", 1) for each in said.split("\0") if each)


@pytest.mark.parametrize("url", [None, "postgresql+psycopg://reader:secret@host/study"])
def test_a_worker_is_told_the_settings_and_no_secret_of_its_surroundings(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, url: str | None
) -> None:
    for name in SECRETS:
        monkeypatch.setenv(name, "planted")
    monkeypatch.setenv("NUMBA_CACHE_DIR", "kept")
    told = surroundings(Settings(data_dir=tmp_path, database_url=url, longest_job_h=7))
    assert "planted" not in told.values()
    assert told["NUMBA_CACHE_DIR"] == "kept"
    assert told["RECONSTUDY_LONGEST_JOB_H"] == "7.0"
    assert told["RECONSTUDY_DATA_DIR"] == str(tmp_path)
    assert told.get("RECONSTUDY_DATABASE_URL") == url


def test_a_worker_gets_the_password_of_a_postgresql_whose_address_holds_none(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PGPASSWORD", "of libpq")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "planted")
    told = surroundings(Settings(data_dir=tmp_path, database_url="postgresql+psycopg://reader@host/study"))
    assert told["PGPASSWORD"] == "of libpq"
    assert "planted" not in told.values()
