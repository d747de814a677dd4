"""Jobs are started, shown, cancelled and retried on the dashboard and over REST, by those who may."""

from __future__ import annotations

import re
from collections.abc import Iterator

import httpx
import pytest

from app.main import running_server
from app.operations.jobs.command import LOG, job_folder
from app.operations.studies import manage
from app.settings import Settings
from app.store.database.engine import open_database
from app.store.database.keys import utc_now
from app.store.queue import JobProgress, NewJob, Worker, beat, end_job, enqueue, take_job, tell_progress
from app.web.admin.work import jobs_page
from tests.app.web.admin.dashboard_client import signed_in, until

FORM = "/admin/work/new/import-films"


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    settings = Settings(data_dir=tmp_path_factory.mktemp("work"))
    for name in ("mine", "yours"):
        (settings.intake_dir / "films" / name).mkdir(parents=True)
    return settings


@pytest.fixture(scope="module")
def server(here: Settings) -> Iterator[str]:
    with running_server(here) as url:
        yield url


@pytest.fixture
def client(server: str, here: Settings, request: pytest.FixtureRequest) -> Iterator[httpx.Client]:
    """A program with a token for jobs."""
    token = manage.add_token(here, request.node.name, ["jobs"])["token"]
    with httpx.Client(base_url=f"{server}/api/v1", headers={"Authorization": f"Bearer {token}"}) as client:
        yield client


@pytest.mark.slow
def test_a_job_is_started_watched_cancelled_and_resumed(server: str, here: Settings) -> None:
    database = open_database(here.url)
    with signed_in(server, here, "Eva", "experimenter") as eva:
        assert "No worker runs" in eva.get("/admin/work").text
        assert "<option selected>yours</option>" in eva.get(f"{FORM}?films=yours").text
        refused = eva.act(FORM, films="../mine")
        assert refused.status_code == 422
        assert "expected the name of something in films" in refused.text
        begun = eva.act(FORM, films="mine", practice="box")
        address = begun.url.path
        public_id = address.rpartition("/")[2]
        assert "No worker is there that can run it" in begun.text
        assert eva.act(FORM, films="mine").status_code == 409
        beat(database, Worker("laboratory 4711", ("import-films",), 1, utc_now(), utc_now()), utc_now())
        assert "the next to begin" in eva.get(address).text
        with database.writing() as connection:
            changing = enqueue(connection, NewJob("segment", {}, "films/mine"), "Olga", utc_now())
        take_job(database, "laboratory 4711", ("segment",), utc_now())
        assert f'It waits until <a href="/admin/work/{changing}">Segment a capture: mine</a>' in eva.get(address).text
        end_job(database, "laboratory 4711", changing, "done", "", utc_now())
        take_job(database, "laboratory 4711", ("import-films",), utc_now())
        tell_progress(database, "laboratory 4711", public_id, JobProgress("copied", 3, 18, 125.0))
        folder = job_folder(here, public_id)
        folder.mkdir(parents=True)
        (folder / LOG).write_text("a line <of the log>\n")
        shown = eva.get(address).text
        assert "copied: 3 of 18, about 2 min left of this step" in shown
        assert "How long the whole job takes is not known yet." in shown
        assert "a line &lt;of the log&gt;" in shown
        assert "a line <of the log>" in eva.get(f"{address}/log").text
        listed = eva.get("/admin/work").text
        assert "1 worker: laboratory" in listed
        for live in (f"{address}/live", "/admin/work/live"):
            with eva.stream("GET", live) as stream:
                until(stream.iter_lines(), "3 of 18")
        assert "stopping" in eva.act(f"{address}/cancel").text
        end_job(database, "laboratory 4711", public_id, "cancelled", "", utc_now())
        assert "Resume" in eva.get(address).text
        assert "queued" in eva.act(f"{address}/retry").text
        take_job(database, "laboratory 4711", ("import-films",), utc_now())
        end_job(database, "laboratory 4711", public_id, "failed", "films/mine: holds no video", utc_now())
        failed = eva.get(address).text
        assert "films/mine: holds no video" in failed
        assert "Try again" in failed
        assert "Look at what there is" not in failed  # it failed before it made anything
        made = here.sets_dir / "mine"
        made.mkdir(parents=True)
        assert "Look at what there is" in eva.get(address).text
        made.rmdir()
        again = re.search(r'href="(/admin/work/new/[^"]+)"', failed)
        assert again
        asked = (
            "films=mine&amp;conform=no&amp;untagged_range=ask&amp;practice=box&amp;then=nothing&amp;study_preset=quick"
        )
        assert again[1] == f"{FORM}?{asked}"
        assert eva.get("/admin/work/unknown").status_code == 404
        log = eva.get("/admin/audit").text
        assert all(action in log for action in ("job queued", "job cancelled", "job queued again"))
    with signed_in(server, here, "Vera", "viewer") as vera:
        assert vera.get("/admin/work").status_code == vera.get(address).status_code == 403
        assert "/admin/work" not in vera.get("/admin").text
        assert vera.act(FORM, films="mine").status_code == 403
    database.dispose()


@pytest.mark.slow
def test_a_program_does_with_jobs_what_people_do(client: httpx.Client) -> None:
    described = {kind["kind"]: kind for kind in client.get("/jobs/kinds").json()["kinds"]}
    assert described["import-films"]["fields"][0]["choices"] == ["mine", "yours"]
    body = {"kind": "import-films", "arguments": {"films": "yours", "name": "set of yours"}}
    made = client.post("/jobs", json=body)
    assert made.status_code == 201
    job = made.json()
    assert (job["state"], job["output"], job["arguments"]["films"]) == ("queued", "sets/set of yours", "yours")
    assert client.get(f"/jobs/{job['job']}").json() == job
    assert job in client.get("/jobs", params={"state": "queued"}).json()
    assert client.post("/jobs", json=body).status_code == 409
    assert client.post(f"/jobs/{job['job']}/cancel").json()["state"] == "cancelled"
    assert client.post(f"/jobs/{job['job']}/cancel").status_code == 409
    assert client.post(f"/jobs/{job['job']}/retry").json()["state"] == "queued"
    assert client.get(f"/jobs/{job['job']}/log").text == ""
    for wrong in ({"kind": "serve"}, {"kind": "import-films", "arguments": {"films": "../x"}}, {"kind": "check"}):
        assert client.post("/jobs", json=wrong).status_code == 422
    assert client.post("/jobs/unknown/cancel").status_code == 404


@pytest.mark.slow
def test_jobs_take_their_own_scope_and_a_cookie_alone_starts_none(server: str, here: Settings) -> None:
    token = manage.add_token(here, "reads")["token"]
    body = {"kind": "import-films", "arguments": {"films": "mine", "name": "other"}}
    with httpx.Client(base_url=server) as stranger:
        reading = {"Authorization": f"Bearer {token}"}
        assert stranger.get("/api/v1/jobs", headers=reading).status_code == 403
        assert stranger.post("/api/v1/jobs", json=body, headers=reading).status_code == 403
        assert stranger.get("/api/v1/jobs").status_code == stranger.post("/api/v1/jobs", json=body).status_code == 401
    with signed_in(server, here, "Ada", "experimenter") as ada:
        assert ada.get("/api/v1/jobs").status_code == 200
        assert ada.post("/api/v1/jobs", json=body).status_code == 403
        with_token = ada.post("/api/v1/jobs", json=body, headers={"X-CSRF-Token": ada.form_token})
        assert with_token.status_code == 201
    with signed_in(server, here, "Vera", "viewer") as vera:
        assert vera.get("/api/v1/jobs").status_code == 403


@pytest.mark.slow
def test_a_server_without_the_extra_says_what_it_cannot_do(
    server: str, here: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jobs_page, "has_extra", lambda _extra: False)
    with signed_in(server, here, "Eva", "experimenter") as eva:
        said = eva.get("/admin/work").text
        assert "without the reconstruction" in said
        assert "Reconstruct" in said
        assert "pip install" not in said
        assert 'href="/admin/manual/work"' in said
        assert "without the reconstruction" in eva.get("/admin/work/new/check").text
        assert "without the reconstruction" not in eva.get(FORM).text


def test_a_form_says_of_each_empty_field_what_it_means(server: str, here: Settings) -> None:
    with signed_in(server, here, "Eva", "experimenter") as eva:
        form = eva.get("/admin/work/new/validate-views").text
    assert "of the report&#39;s folder; empty: after what is chosen above" in form
    assert "none: where the run says that it was" in form
    assert '<option value="">none</option>' in form
    assert "empty: all of the run; for example 0:25" in form
