"""Participants see, take along and delete what they gave; a study forgets them when it said it would."""

from __future__ import annotations

import csv
import html
import json
import re
import shutil
from collections.abc import Callable, Iterator
from datetime import timedelta
from pathlib import Path
from typing import Any

import httpx
import pytest
from playwright.sync_api import Browser, expect

from app.files import packaged
from app.main import running_server
from app.operations.studies import manage
from app.operations.studies.create import create_study
from app.operations.upkeep.backup import back_up, restore
from app.operations.upkeep.erasure import LIST, enforce_retention
from app.operations.upkeep.housekeeping import Housekeeper
from app.settings import Settings
from app.simulation.participants import next_trial
from app.store.database.engine import open_database
from app.store.database.keys import utc_now
from app.store.studies.audit import Actor
from app.store.studies.studies import study_by_slug
from app.study.languages.language_pack import SHIPPED
from app.study.options.options import parse_options
from tests.app.tiny_stimuli import APPROACHES
from tests.app.web.admin.dashboard_client import signed_in

pytestmark = pytest.mark.slow

SECRET = "I have never told anybody of the green lighthouse"
INTERVIEW = "/api/v1/session/stages/interview"
OPTIONS = {
    "optional_stages": ["interview"],
    "questions": [{"name": "secret", "kind": "text", "text": "Your secret?"}],
    "privacy": {"responsible": "Prof. Example <Lab>", "contact": "lab@example.org", "keep_days": 30},
    "outside": {"id": "PROLIFIC_PID"},
}

VoteBody = Callable[..., dict[str, Any]]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    return Settings(data_dir=tmp_path_factory.mktemp("made"))


@pytest.fixture(scope="module")
def study(made: Settings, stimulus_set: Path) -> dict[str, Any]:
    return create_study(made, stimulus_set, "Private", exposure_s=0.4, seed=1, options=parse_options(OPTIONS))


@pytest.fixture
def settings(made: Settings, study: dict[str, Any], tmp_path: Path) -> Settings:  # noqa: ARG001 (it is in the folder)
    return Settings(data_dir=Path(shutil.copytree(made.data_dir, tmp_path / "data")))


@pytest.fixture
def server(settings: Settings) -> Iterator[str]:
    with running_server(settings) as url:
        yield url


@pytest.fixture
def client(server: str) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=server, timeout=30) as client:
        yield client


def take(client: httpx.Client, study: dict[str, Any], vote_body: VoteBody) -> dict[str, Any]:
    """Take a study to its end, with an answer to its question; the session as it began."""
    session = votes(client, study, vote_body)
    client.put(INTERVIEW, json={"data": {"answers": {"secret": SECRET}}}).raise_for_status()
    return session


def votes(client: httpx.Client, study: dict[str, Any], vote_body: VoteBody, why: str = "") -> dict[str, Any]:
    """Take a study as far as its questions, though films may fail; the session as it began."""
    invitation = {"invitation": study["invitation"], "outside": {"PROLIFIC_PID": "5f2a9c0d"}}
    session: dict[str, Any] = client.post(f"/api/v1/studies/{study['slug']}/sessions", json=invitation).json()
    client.put("/api/v1/session/stages/introduction", json={}).raise_for_status()
    while (trial := next_trial(client, session["token"])) is not None:
        if why:
            client.put(f"/api/v1/session/trials/{trial['trial']}/trouble", json={"why": why}).raise_for_status()
        client.put(f"/api/v1/session/trials/{trial['trial']}/vote", json=vote_body(trial)).raise_for_status()
    return session


def write_of(server: str, settings: Settings, study: dict[str, Any], label: str) -> None:
    """Let an experimenter write the secret wherever they can write of a participant."""
    base = f"/admin/studies/{study['slug']}"
    with signed_in(server, settings, "Wanda Writer", "experimenter") as writer:
        votes = writer.get(f"{base}/votes", params={"participant": label}).text
        trial = re.findall(rf'href="{base}/votes/([^"?]+)"', votes)[0]
        written = {
            f"{base}/participants/{label}/exclude": {"reason": SECRET},
            f"{base}/participants/{label}/include": {},
            f"{base}/votes/{trial}/comment": {"comment": SECRET},
            f"{base}/participants/comments/tag": {
                "participant": label,
                "source": "written",
                "subject": "secret",
                "tag": SECRET,
            },
        }
        for address, fields in written.items():
            writer.act(address, **fields).raise_for_status()
    note_as_before(settings, study["slug"], label)


def note_as_before(settings: Settings, slug: str, label: str) -> None:
    """Note an exclusion as the audit log held it of old, with its reason."""
    with open_database(settings.url) as database, database.writing() as connection:
        known = study_by_slug(connection, slug)
        Actor(0, "Wanda Writer", utc_now()).note(connection, "participant excluded", known, label, reason=SECRET)


def holds(settings: Settings, text: str) -> list[str]:
    """The files of the data folder that hold a text."""
    files = [path for path in settings.data_dir.rglob("*") if path.is_file()]
    return sorted(path.name for path in files if text.encode() in path.read_bytes())


def count(settings: Settings, table: str) -> int:
    database = open_database(settings.url)
    with database.reading() as connection:
        n_rows = connection.exec_driver_sql(f"SELECT count(*) FROM {table}").scalar_one()
    database.dispose()
    return int(n_rows)


def test_a_participant_takes_along_what_they_gave_without_names_of_methods(
    client: httpx.Client, study: dict[str, Any], vote_body: VoteBody
) -> None:
    take(client, study, vote_body)
    answer = client.get("/api/v1/session/export")
    assert answer.headers["content-disposition"] == 'attachment; filename="private-P001.json"'
    assert answer.headers["cache-control"] == "no-store"
    given = answer.json()
    assert [vote["choice"] for vote in given["votes"]] == ["a"] * 6
    assert given["recruiting"][0]["outside_id"] == "5f2a9c0d"
    assert {"stage": "interview", "data": {"answers": {"secret": SECRET}}}.items() <= given["stages"][-1].items()
    for name in (*APPROACHES, "ball", "box", "_id"):
        assert name not in answer.text.replace("outside_id", ""), name
    assert httpx.get(f"{client.base_url}/api/v1/session/export").status_code == 401


def test_who_erases_their_data_is_in_no_file_and_in_no_restored_backup(
    client: httpx.Client,
    settings: Settings,
    study: dict[str, Any],
    vote_body: VoteBody,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    session = votes(client, study, vote_body, why=SECRET)
    client.put(INTERVIEW, json={"data": {"answers": {"secret": SECRET}}}).raise_for_status()
    write_of(str(client.base_url), settings, study, "P001")
    back_up(settings, tmp_path / "before.zip")
    assert holds(settings, SECRET)
    assert client.put("/api/v1/session/erasure", json={"confirmed": False}).status_code == 422
    assert client.put("/api/v1/session/erasure", json={"confirmed": True}).status_code == 204
    assert client.get("/api/v1/session").status_code == 401
    assert client.post("/api/v1/session/resume", json={"resume_code": session["resume_code"]}).status_code == 404
    assert holds(settings, SECRET) == holds(settings, "5f2a9c0d") == []
    assert "was not shown" in caplog.text
    assert SECRET not in caplog.text
    assert SECRET not in (settings.data_dir / LIST).read_text()
    assert (settings.data_dir / LIST).stat().st_mode & 0o777 == 0o600
    restored = restore(settings, tmp_path / "before.zip", replace=True)
    assert restored["erased_again"] == 1
    assert holds(settings, SECRET) == []
    assert (count(settings, "vote"), count(settings, "recruit")) == (0, 0)


def test_an_answer_that_is_refused_is_in_no_log(
    client: httpx.Client, study: dict[str, Any], vote_body: VoteBody, caplog: pytest.LogCaptureFixture
) -> None:
    votes(client, study, vote_body)
    for answer in (SECRET * 500, [SECRET], {SECRET: SECRET}):
        refused = client.put(INTERVIEW, json={"data": {"answers": {"secret": answer}}})
        assert refused.status_code == 422
    assert "refused: 422" in caplog.text
    assert SECRET not in caplog.text


@pytest.mark.browser
def test_the_last_page_gives_the_data_and_deletes_them_when_it_is_ticked(
    browser: Browser, server: str, settings: Settings, study: dict[str, Any], vote_body: VoteBody
) -> None:
    with httpx.Client(base_url=server, timeout=30) as client:
        token = take(client, study, vote_body)["token"]
    context = browser.new_context()
    context.add_cookies([{"name": "session", "value": token, "url": server}])
    page = context.new_page()
    page.goto(f"{server}/s/{study['invitation']}")
    with page.expect_download() as download:
        page.get_by_role("link", name="Download my data").click()
    assert SECRET in download.value.path().read_text(encoding="utf-8")
    page.locator("[data-view=thanks]").get_by_role("button", name="Withdraw").click()
    page.get_by_label("Also delete for good what I have given").check()
    page.get_by_role("button", name="Yes, withdraw").click()
    expect(page.get_by_text("All that you gave was deleted.")).to_be_visible()
    page.goto(f"{server}/s/{study['invitation']}?PROLIFIC_PID=5f2a9c0d")
    expect(page.get_by_role("button", name="Begin", exact=True)).to_be_visible()
    expect(page.locator("[data-view=known]")).to_be_hidden()  # the browser, too, has forgotten that they began here
    context.close()
    assert holds(settings, SECRET) == []


def test_a_list_of_erasures_that_cannot_be_read_stops_the_restore(settings: Settings, tmp_path: Path) -> None:
    back_up(settings, tmp_path / "backup.zip")
    (settings.data_dir / LIST).write_text(json.dumps({"at": "2026-01-01T00:00:00+00:00"}) + "\n")
    with pytest.raises(ValueError, match=f"{LIST}, line 1: is no erasure, so nothing was restored"):
        restore(settings, tmp_path / "backup.zip", replace=True)


def test_a_study_forgets_its_people_and_keeps_their_votes_when_its_days_are_over(
    client: httpx.Client, settings: Settings, study: dict[str, Any], vote_body: VoteBody, tmp_path: Path
) -> None:
    take(client, study, vote_body)
    write_of(str(client.base_url), settings, study, "P001")
    database = open_database(settings.url)
    soon, later = utc_now() + timedelta(days=29), utc_now() + timedelta(days=31)
    assert enforce_retention(settings, database, later) == []  # it is open
    back_up(settings, tmp_path / "open.zip")
    manage.change_study_standing(settings, study["slug"], "closed")
    assert enforce_retention(settings, database, soon) == []
    with signed_in(str(client.base_url), settings, "Olga") as olga:
        assert "personal data are deleted" in olga.get(f"/admin/studies/{study['slug']}").text
        hours = iter((0.0, 3600.0, 7200.0))
        keeper = Housekeeper(settings, database, lambda: next(hours))
        for now in (soon, later):  # as the server does, whose clock jumps by two days
            keeper.keep_house(now)
            assert "personal data are deleted" in olga.get(f"/admin/studies/{study['slug']}").text
        keeper.keep_house(later + timedelta(hours=1))
        assert "personal data were deleted" in olga.get(f"/admin/studies/{study['slug']}").text
        assert "personal data deleted" in olga.get("/admin/audit").text
    assert enforce_retention(settings, database, later) == []
    database.dispose()
    assert holds(settings, SECRET) == holds(settings, "5f2a9c0d") == []
    assert client.get("/api/v1/session").status_code == 401
    assert (count(settings, "vote"), count(settings, "stage_record")) == (6, 0)
    restore(settings, tmp_path / "open.zip", replace=True)
    assert (count(settings, "vote"), count(settings, "stage_record")) == (6, 0)


def test_the_privacy_page_says_what_the_study_does_in_the_readers_language(
    client: httpx.Client, settings: Settings, stimulus_set: Path
) -> None:
    packs = {path.stem: json.loads(path.read_text()) for path in packaged(SHIPPED).glob("*.json")}
    content = {"privacy": OPTIONS["privacy"], "languages": list(packs), "optional_stages": ["screening"]}
    study = create_study(settings, stimulus_set, "Read", exposure_s=0.4, seed=1, options=parse_options(content))
    for language, pack in packs.items():
        page = html.unescape(client.get(f"/s/{study['invitation']}/privacy?language={language}").text)
        said = pack["privacy"]
        contact = said["contact"].format(contact="lab@example.org")
        for text in (said["kept_days"].format(days=30), contact, "Prof. Example <Lab>", said["collected"]["screening"]):
            assert text in page, language
        for text in (said["kept"], said["ask"], said["collected"]["outside"], said["collected"]["invitation"]):
            assert text not in page, language
    first = client.get(f"/s/{study['invitation']}").text
    assert f'href="/s/{study["invitation"]}/privacy?language=' in first
    assert client.get("/s/forged/privacy").status_code == 404


def test_who_is_invited_by_name_reads_that_the_name_is_kept_and_finds_it_in_the_export(
    client: httpx.Client, settings: Settings, stimulus_set: Path
) -> None:
    study = create_study(settings, stimulus_set, "By name", exposure_s=0.4, seed=1)
    said = json.loads((packaged(SHIPPED) / "en.json").read_text())["privacy"]["collected"]["invitation"]
    with signed_in(str(client.base_url), settings, "Olga") as olga:
        base = f"/admin/studies/{study['slug']}"
        olga.act(f"{base}/invitations/people", people="Ada Example, ada@example.org")
        olga.act(f"{base}/invitations", places="2", label="Monday")
        codes = [
            row["code"] for row in csv.DictReader(olga.get(f"{base}/invitations/invitations.csv").text.splitlines())
        ]
        for code, is_named in zip(codes, (False, True, False), strict=True):
            page = html.unescape(client.get(f"/s/{code}/privacy?language=en").text)
            assert (said in page) == is_named, code
            assert "not stored" in page
            assert "Your name" not in page
            begun = {"invitation": code}
            client.post(f"/api/v1/studies/{study['slug']}/sessions", json=begun).raise_for_status()
        exports = [olga.get(f"{base}/participants/{label}/export.json").text for label in ("P001", "P002", "P003")]
        assert ["Ada Example" in export for export in exports] == [False, True, False]
        assert not any("Monday" in export for export in exports)
