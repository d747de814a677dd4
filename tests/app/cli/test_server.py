"""The server by the command line: the links that it shows, and settings, of which it tells in a line what is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.settings import Settings
from app.store.access.rights import SCOPES
from tests.command_line import Command


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("PUBLIC_URL", "https://study.example.org/", "http:// or https:// and a host, without a path"),
        ("LOG_FORMAT", "JSON", "one of text, json"),
        ("LARGEST_UPLOAD_MB", "4 GB", "a whole number of at least 1"),
    ],
)
def test_a_setting_that_is_wrong_is_named_in_one_line(
    command: Command, monkeypatch: pytest.MonkeyPatch, name: str, value: str, expected: str
) -> None:
    monkeypatch.setenv(f"RECONSTUDY_{name}", value)
    told = command("status")
    assert told.code == 1
    assert told.err.startswith(f"reconstudy: RECONSTUDY_{name} is '{value}', expected {expected}. ")
    assert told.err.count("\n") == 1
    assert str(Settings.model_fields[name.lower()].description) in told.err


@pytest.mark.parametrize(
    ("misspelled", "meant"),
    [("SECURE_COOKIE", "SECURE_COOKIES"), ("DATADIR", "DATA_DIR"), ("DATABSE_URL", "DATABASE_URL")],
)
def test_a_misspelled_setting_is_named_with_what_was_meant(
    command: Command, monkeypatch: pytest.MonkeyPatch, misspelled: str, meant: str
) -> None:
    """Nothing else would tell that the server goes without it."""
    monkeypatch.setenv(f"RECONSTUDY_{misspelled}", "true")
    told = command("--version").err
    assert told == (
        f"warning: RECONSTUDY_{misspelled} is no setting and changes nothing; did you mean RECONSTUDY_{meant}?\n"
    )


def test_the_help_of_tokens_names_every_scope(command: Command) -> None:
    told = " ".join(command("token", "add", "--help").out.split())
    assert [scope for scope in SCOPES if scope not in told] == []


def test_no_other_variable_is_taken_for_a_misspelled_setting(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("REAL_DATA", "DEBUG", "FILES_BELOW", "PROGRESS_FILE", "PUBLIC_URL"):
        monkeypatch.setenv(f"RECONSTUDY_{name}", "x")
    assert command("--version").err == ""


@pytest.mark.parametrize("url", ["study.example.org", "https://", "https://study.example.org/s"])
def test_an_address_for_links_that_leads_nowhere_is_refused(command: Command, url: str) -> None:
    told = command("admin", "add", "Me", "--url", url)
    assert told.code == 2
    assert "is no address of a server; expected" in told.err


@pytest.mark.slow
def test_the_links_that_a_server_shows_are_those_of_studies_that_take_people(
    command: Command, monkeypatch: pytest.MonkeyPatch, stimuli: Path, tmp_path: Path
) -> None:
    monkeypatch.setattr("app.main.serve", lambda *_, on_start, **__: on_start("http://127.0.0.1:8000"))
    for name in ("Under way", "Done"):
        command("study", "create", stimuli, "--name", name)
    command("study", "close", "done")
    (tmp_path / "paid.toml").write_text('outside.id = "PROLIFIC_PID"')
    command("study", "create", stimuli, "--name", "Paid", "--options", tmp_path / "paid.toml")
    command("study", "invite", "under-way", "--places", "1")
    shown = command("serve").out
    assert shown.count("participants of Under way") == 1, "one person's link is nobody else's"
    assert "participants of Under way: http://127.0.0.1:8000/s/" in shown
    assert "Done" not in shown
    paid = shown.partition("participants of Paid: ")[2].partition("\n")[0]
    assert paid.endswith("?PROLIFIC_PID={{%PROLIFIC_PID%}}")
    invited = command("study", "invite", "paid").out
    assert "?PROLIFIC_PID={{%PROLIFIC_PID%}} once `reconstudy serve` runs" in invited
