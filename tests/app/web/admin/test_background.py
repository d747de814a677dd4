"""Long work in the background tells that it lives, and is done once."""

from __future__ import annotations

import re
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from pathlib import Path
from threading import Barrier, Event
from threading import enumerate as threads
from typing import Any

import httpx
import pytest

from app.errors import ConflictError
from app.main import running_server
from app.operations import tasks
from app.operations.studies import creation, manage
from app.operations.studies.creation import CREATION
from app.settings import Settings
from app.store.database.engine import Database, open_database
from app.store.database.keys import utc_now
from app.store.database.server_tasks import BEATS_WITHIN, ServerTask, beat, begin_task, end_task, task_by_id
from app.store.studies.audit import Actor
from ground.progress import Progress
from tests.app.web.admin.dashboard_client import ends, signed_in
from tests.seeded_studies import NOW

TIMEOUT_S = 60


@pytest.fixture
def slow_creation(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Event, list[str]]]:
    """Creating a study takes until the event is set; the names of those that were begun."""
    may_end, names = Event(), list[str]()

    def create(_settings: Settings, _folder: object, name: str, **_: Any) -> dict[str, str]:
        names.append(name)
        may_end.wait(6 * TIMEOUT_S)
        return {"slug": "none"}

    monkeypatch.setattr(creation, "create_study", create)
    yield may_end, names
    may_end.set()


def running_task(database: Database, address: str) -> ServerTask:
    with database.reading() as connection:
        task = task_by_id(connection, address.rpartition("/")[2])
    assert task is not None
    return task


@pytest.mark.slow
def test_work_of_which_one_step_takes_long_is_not_taken_for_lost(
    own_server: str, own: Settings, slow_creation: tuple[Event, list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    has_beaten = Event()

    def beat_and_say_so(*arguments: Any) -> None:
        beat(*arguments)
        has_beaten.set()

    monkeypatch.setattr(tasks, "BEATS_EVERY_S", 0.02)
    monkeypatch.setattr(tasks, "beat", beat_and_say_so)
    may_end, _ = slow_creation
    database = open_database(own.url)
    with signed_in(own_server, own, "Eva") as eva:
        address = eva.act("/admin/studies/new", name="Of one long step", stimulus_set="tiny").url.path
        assert has_beaten.wait(TIMEOUT_S), "the task is silent"
        task = running_task(database, address)
        assert task.beat_at > task.started_at
        may_end.set()
        ends(eva, address)
    database.dispose()
    for thread in threads():
        if thread.name.startswith("beat-"):
            thread.join(TIMEOUT_S)
            assert not thread.is_alive()


@pytest.mark.slow
def test_who_clicks_twice_is_led_to_the_work_that_runs(
    own_server: str, own: Settings, slow_creation: tuple[Event, list[str]]
) -> None:
    may_end, names = slow_creation
    with signed_in(own_server, own, "Eva") as eva, signed_in(own_server, own, "Ada") as ada:
        first = eva.act("/admin/studies/new", name="Twice", stimulus_set="tiny").url.path
        assert eva.act("/admin/studies/new", name="twice!", stimulus_set="tiny").url.path == first
        refused = ada.act("/admin/studies/new", name="Twice", stimulus_set="tiny")
        assert refused.status_code == 409
        assert "Eva" in refused.text
        other = eva.act("/admin/studies/new", name="Another", stimulus_set="tiny").url.path
        assert other != first
        assert re.findall(r'href="(/admin/tasks/[^"]+)">([^<]+)</a>', eva.get("/admin").text) == [
            (first, "Creating the study Twice"),
            (other, "Creating the study Another"),
        ]  # who left the page finds the work again
        may_end.set()
        for address in (first, other):
            ends(eva, address)
        again = eva.act("/admin/studies/new", name="Twice", stimulus_set="tiny").url.path
        assert again != first
        ends(eva, again)
    assert sorted(names) == ["Another", "Twice", "Twice"]


def test_the_beginning_of_a_step_is_told_however_soon_it_follows_another(database: Database) -> None:
    seen = []

    def work(progress: Progress) -> str:
        for done, total in ((0, 8), (8, 8), (0, 3)):
            progress("films", done, total)
            task = running_task(database, begun)
            seen.append((task.done, task.total))
        return "/admin"

    begun = begin_task(database, "ada", "Creating", utc_now()).public_id
    tasks._run(database, Actor(1, "ada", utc_now()), "Creating", begun, work)
    assert seen == [(0, 8), (0, 8), (0, 3)]


def test_work_is_begun_once_when_all_ask_at_once(database: Database) -> None:
    together = Barrier(4)

    def begin(_number: int) -> tuple[str, bool]:
        together.wait(TIMEOUT_S)
        begun = begin_task(database, "Eva", "Creating", NOW, "study x")
        return begun.public_id, begun.is_new

    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(begin, range(4)))
    assert len({public_id for public_id, _ in found}) == 1
    assert sorted(is_new for _, is_new in found) == [False, False, False, True]


def test_work_that_was_lost_or_has_ended_can_be_begun_again(database: Database) -> None:
    lost = begin_task(database, "Eva", "Creating", NOW, "study x")
    later = NOW + BEATS_WITHIN
    with pytest.raises(ConflictError, match="Eva"):
        begin_task(database, "Ada", "Creating", later, "study x")
    later += timedelta(seconds=1)
    second = begin_task(database, "Ada", "Creating", later, "study x")
    assert second.is_new
    with database.reading() as connection:
        found = task_by_id(connection, lost.public_id)
    assert found is not None
    assert (found.state, "was stopped" in found.detail) == ("failed", True)
    end_task(database, second.public_id, "/", later)
    assert begin_task(database, "Eva", "Creating", later, "study x").is_new
    assert begin_task(database, "Eva", "Checking", later).is_new
    assert begin_task(database, "Eva", "Checking", later).is_new


@pytest.mark.slow
def test_a_study_goes_on_being_made_after_the_server_was_killed(stimulus_set: Path, tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    manage.upgrade_database(settings)
    kept = {"kind": CREATION, "folder": str(stimulus_set.parent), "study": 'name = "Killed"\n', "by": "Eva"}
    database = open_database(settings.url)
    begun = begin_task(database, "Eva", "Creating the study Killed", utc_now(), "study killed", kept)  # and no more
    with running_server(settings):
        tasks.wait_for_task(begun.public_id, TIMEOUT_S)
        made = running_task(database, begun.public_id)
        assert (made.state, made.result) == ("done", "/admin/studies/killed")
    again = begin_task(database, "Eva", "Creating the study Killed", made.started_at, "study killed", kept)
    with running_server(settings):  # it was killed between the last step and the end of the task
        tasks.wait_for_task(again.public_id, TIMEOUT_S)
    assert running_task(database, again.public_id).result == "/admin/studies/killed"
    database.dispose()


def test_a_study_that_is_being_made_can_be_cancelled_and_made_again(
    own_server: str, own: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    has_begun, may_go_on = Event(), Event()

    def create(*_: object, progress: Any, **__: object) -> dict[str, str]:
        progress("encoding", 1, 9)
        has_begun.set()
        may_go_on.wait(TIMEOUT_S)
        progress("encoding", 2, 9)
        return {"slug": "none"}

    monkeypatch.setattr(creation, "create_study", create)
    monkeypatch.setattr(tasks, "TELLS_EVERY_S", 0.0)
    with signed_in(own_server, own, "Eva") as eva:
        address = eva.act("/admin/studies/new", name="Stopped", stimulus_set="tiny").url.path
        assert has_begun.wait(TIMEOUT_S)
        assert "It stops after the step" in eva.act(f"{address}/cancel").text
        may_go_on.set()
        assert "It was cancelled" in ends(eva, address).text
        assert "It was cancelled" in eva.get(address.replace("/tasks/", "/jobs/")).text  # its address in 1.0
        again = eva.act("/admin/studies/new", name="Stopped", stimulus_set="tiny").url.path
        assert again != address
        ends(eva, again)


def test_over_rest_long_work_is_answered_with_its_task(
    own_server: str, own: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    may_end = Event()

    def create(*_: object, **__: object) -> dict[str, str]:
        may_end.wait(TIMEOUT_S)
        return {"slug": "made-slowly"}

    monkeypatch.setattr(creation, "create_study", create)
    token = manage.add_token(own, "maker", ["studies:write"])["token"]
    with httpx.Client(base_url=own_server, headers={"Authorization": f"Bearer {token}"}, timeout=60) as program:
        answer = program.post("/api/v1/studies?wait_s=0", json={"name": "Made slowly", "stimulus_set": "tiny"})
        assert answer.status_code == 202
        assert answer.json()["state"] == "running"
        address = answer.headers["Location"]
        assert program.delete(address).json()["is_cancelled"] is True
        may_end.set()
        tasks.wait_for_task(answer.json()["task"], TIMEOUT_S)
        assert program.get(address).json()["study"] == "made-slowly"  # it was over before it could stop
        assert program.get("/api/v1/tasks/nothing").status_code == 404
