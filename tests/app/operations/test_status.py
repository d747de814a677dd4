"""What the status tells of a data folder and its server."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from sqlalchemy import text

from app import main
from app.main import running_server, serve
from app.operations import running
from app.operations.extras import MODULES
from app.operations.running import DEFAULT_URL, alone, noted, running_url, url_for_links
from app.operations.status import server_status
from app.operations.studies.manage import upgrade_database
from app.settings import Settings
from app.store.database.engine import open_database
from app.store.database.keys import utc_now
from app.store.queue import NewJob, Worker, beat, enqueue, take_job
from tests.command_line import Command


def test_the_status_of_an_empty_folder_makes_nothing(tmp_path: Path) -> None:
    status = server_status(Settings(data_dir=tmp_path / "reconstudy"))
    assert status["data_dir"] == str(tmp_path / "reconstudy")
    assert (status["database"]["version"], status["studies"], status["server"]) == (None, None, None)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["what? ", "50%41", "a#b", "two\nlines", "Jürgen's study"])
def test_the_database_lies_in_its_data_folder_whatever_that_is_called(tmp_path: Path, name: str) -> None:
    settings = Settings(data_dir=tmp_path / name)
    upgrade_database(settings)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert server_status(settings)["database"]["place"] == str(settings.data_dir / "study.sqlite")


def test_an_empty_address_of_a_database_is_none(tmp_path: Path) -> None:
    """As a file of settings leaves it where nothing is filled in."""
    assert Settings(data_dir=tmp_path, database_url="").url == Settings(data_dir=tmp_path).url


@pytest.mark.slow
def test_a_folders_second_server_leaves_the_first_one_noted(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    with running_server(settings) as first, noted(settings, first):
        with running_server(settings) as second, noted(settings, second):
            assert running_url(settings) == second
        assert running_url(settings) == first
    assert not (settings.data_dir / "server.json").exists()


def test_a_second_server_of_a_folder_with_sqlite_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(main, "create_app", lambda _settings: pytest.fail("it began to serve"))
    settings = Settings(data_dir=tmp_path)
    with alone(settings), pytest.raises(ValueError, match=f"serves {tmp_path} already; stop it"):
        serve(settings, port=0)


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGINT])
def test_a_server_that_is_told_to_end_is_noted_no_longer(tmp_path: Path, how: signal.Signals) -> None:
    settings = Settings(data_dir=tmp_path)
    heed = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"  # what runs unattended ignores it
    command = [sys.executable, "-c", f"{heed}; from app.cli import main; main()", "serve", "--port=0", "--jobs=0"]
    environment = os.environ | settings.as_environment()
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as server:
        assert server.stdout is not None
        assert server.stdout.readline().startswith(b"Serving ")
        assert (tmp_path / "server.json").exists()
        server.send_signal(how)
        server.communicate(timeout=60)
    assert server.returncode == (-how if how == signal.SIGTERM else 130)
    assert not (tmp_path / "server.json").exists()


@pytest.mark.slow
def test_commands_print_links_of_the_server_that_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: Command
) -> None:
    settings = Settings(data_dir=tmp_path / "reconstudy")
    monkeypatch.setenv("RECONSTUDY_DATA_DIR", str(settings.data_dir))
    with running_server(settings) as url, noted(settings, url):
        told = json.loads(command("status", "--json").out)
        assert told["server"] == url
        assert told["database"]["version"] == told["database"]["newest"]
        assert told["studies"] == {"n": 0, "open": 0, "participants": 0, "votes": 0}
        assert json.loads(command("admin", "add", "Eva", "--json").out)["link"].startswith(f"{url}/admin/login/")
        assert f"Server:         {url}\n" in command("status").out
    assert url_for_links(settings) == DEFAULT_URL
    assert not (settings.data_dir / "server.json").exists()


@pytest.mark.slow
def test_links_of_a_server_on_every_network_open_on_this_computer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running, "TIMEOUT_S", 60.0)  # the server's first answer loads it, in this process
    settings = Settings(data_dir=tmp_path / "reconstudy")
    with running_server(settings) as url, noted(settings, url.replace("127.0.0.1", "0.0.0.0")):
        assert url_for_links(settings) == url


def test_a_server_that_died_is_not_taken_for_running(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    with socket.create_server(("127.0.0.1", 0)) as bound:
        url = f"http://127.0.0.1:{bound.getsockname()[1]}"
    with noted(settings, url):
        assert server_status(settings)["server"] is None


def test_a_database_that_does_not_answer_is_named_without_its_password(tmp_path: Path) -> None:
    address = "postgresql+psycopg://reader:{}@127.0.0.1:1/votes"
    told = server_status(Settings(data_dir=tmp_path, database_url=address.format("secret")))["database"]
    assert (told["place"], told["answers"]) == (address.format("***"), False)


def test_a_command_without_its_database_says_what_the_database_said(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To a participant it says to try again soon; who runs a command has to mend it."""
    (tmp_path / "study.sqlite").mkdir()
    monkeypatch.setenv("RECONSTUDY_DATA_DIR", str(tmp_path))
    told = command("admin", "add", "Eva")
    assert told.code == 1
    assert told.err.splitlines()[-1] == (
        "reconstudy: the database cannot be used: unable to open database file; `reconstudy status` tells where it "
        "lies and what space is left; run it as the server's user"
    )


def test_the_status_names_the_job_that_a_worker_runs(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = Settings(data_dir=tmp_path)
    monkeypatch.setenv("RECONSTUDY_DATA_DIR", str(tmp_path))
    upgrade_database(settings)
    with open_database(settings.url) as database:
        with database.writing() as connection:
            for name in ("first", "second"):
                enqueue(connection, NewJob("render", {}, f"sets/{name}"), "Eva", utc_now())
        beat(database, Worker("Anna's", ("render",), 1, utc_now(), utc_now()), utc_now())
        take_job(database, "Anna's", ["render"], utc_now())
    assert "Work:           Render films: sets/first\n" in command("status").out


def test_the_status_does_not_advise_to_upgrade_what_is_newer(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = Settings(data_dir=tmp_path)
    monkeypatch.setenv("RECONSTUDY_DATA_DIR", str(tmp_path))
    upgrade_database(settings)
    with open_database(settings.url) as database, database.writing() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    assert "version 9999, expected " in (told := command("status").out)
    assert "they need a newer version of reconstudy" in told
    assert "db upgrade" not in told


@pytest.mark.slow
@pytest.mark.parametrize(("public_url", "is_told"), [(None, True), ("http://192.168.1.20:8000", False)])
def test_who_serves_a_laboratory_is_told_that_links_need_this_computers_address(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, public_url: str | None, *, is_told: bool
) -> None:
    def started(*_: object, on_start: Callable[[str], None], **__: object) -> None:
        on_start("http://0.0.0.0:8000")

    monkeypatch.setattr("app.main.serve", started)
    monkeypatch.setenv("RECONSTUDY_DATA_DIR", str(tmp_path))
    if public_url:
        monkeypatch.setenv("RECONSTUDY_PUBLIC_URL", public_url)
    told = command("serve", "--host", "0.0.0.0").out
    assert ("on other computers, with this one's name or address for 0.0.0.0" in told) is is_told
    assert f"experimenters: {public_url or 'http://0.0.0.0:8000'}/admin" in told


@pytest.mark.parametrize("log_format", ["text", "json"])
def test_a_server_whose_output_is_a_log_prints_no_links(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, log_format: str
) -> None:
    """The journal keeps what a server under systemd prints: links would open a session, or make an owner."""
    monkeypatch.setattr("app.main.serve", lambda *_, on_start, **__: on_start("http://127.0.0.1:8000"))
    listed = [{"name": "Ball", "state": "open", "shared_links": ["/s/m65rdenpqzuj"]}]
    monkeypatch.setattr("app.operations.studies.manage.list_studies", lambda _: listed)
    monkeypatch.setenv("RECONSTUDY_DATA_DIR", str(tmp_path))
    monkeypatch.setenv("RECONSTUDY_LOG_FORMAT", log_format)
    told = command("serve").out
    assert told.startswith(f"Serving {tmp_path} at http://127.0.0.1:8000")
    assert [secret in told for secret in ("/s/m65rdenpqzuj", "/admin/setup/")] == [log_format == "text"] * 2


def test_extras_are_found_without_loading_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(MODULES, "s3", ("json",))
    monkeypatch.setitem(MODULES, "cluster", ("json", "no_such_module"))
    extras = server_status(Settings(data_dir=tmp_path))["extras"]
    assert (extras["s3"], extras["cluster"]) == (True, False)


def test_a_port_that_is_taken_is_named_with_what_to_do(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as bound:
        port = bound.getsockname()[1]
        with pytest.raises(ValueError, match=f"port {port} is in use: another program.*--port 0 for any free one"):
            serve(Settings(data_dir=tmp_path), port=port)
    assert list(tmp_path.iterdir()) == []
