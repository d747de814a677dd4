"""Long work in the background tells that it lives, and is done once."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from threading import Barrier, Event
from threading import enumerate as threads
from typing import Any

import pytest

from app.errors import ConflictError
from app.settings import Settings
from app.store.database.engine import Database, open_database
from app.store.database.server_tasks import BEATS_WITHIN, ServerTask, beat, begin_task, end_task, task_by_id
from app.web.admin import background
from app.web.admin.studies import lifecycle_page
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

    monkeypatch.setattr(lifecycle_page, "create_study", create)
    yield may_end, names
    may_end.set()


def running_task(database: Database, address: str) -> ServerTask:
    with database.reading() as connection:
        task = task_by_id(connection, address.rpartition("/")[2])
    assert task is not None
    return task


def test_work_of_which_one_step_takes_long_is_not_taken_for_lost(
    own_server: str, own: Settings, slow_creation: tuple[Event, list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    has_beaten = Event()

    def beat_and_say_so(*arguments: Any) -> None:
        beat(*arguments)
        has_beaten.set()

    monkeypatch.setattr(background, "BEATS_EVERY_S", 0.02)
    monkeypatch.setattr(background, "beat", beat_and_say_so)
    may_end, _ = slow_creation
    database = open_database(own.url)
    with signed_in(own_server, own, "Eva") as eva:
        address = eva.act("/admin/studies/new", name="Slow", stimulus_set="tiny").url.path
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
        may_end.set()
        for address in (first, other):
            ends(eva, address)
        again = eva.act("/admin/studies/new", name="Twice", stimulus_set="tiny").url.path
        assert again != first
        ends(eva, again)
    assert sorted(names) == ["Another", "Twice", "Twice"]


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
