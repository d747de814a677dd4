"""What an experimenter does at the dashboard, from a stimulus set to the erasure of a participant."""

from __future__ import annotations

import io
import re
import shutil
import socket
import time
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
import shapes
from dashboard import Dashboard, signed_in

from app import operate
from app.main import running_server
from app.settings import Settings
from app.simulate import begin, next_trial, simulate
from app.web.admin.votes import looks_of

ABILITIES = {"id_fa": -1.0, "id_fb": 0.0, "pm_fb": 1.0}
NewStudy = Callable[[], dict[str, Any]]


@pytest.fixture
def experimenter(server: str, settings: Settings) -> Iterator[Dashboard]:
    with signed_in(server, settings, "Eva Example", "experimenter") as dashboard:
        yield dashboard


@pytest.fixture(scope="module")
def taken(server: str, token: str, new_study: NewStudy) -> dict[str, Any]:
    study = new_study()
    simulate(server, study["slug"], study["invitation"], token, 4, ABILITIES, 0.2, seed=4)
    return study


def ends(dashboard: Dashboard, path: str) -> httpx.Response:
    """The page at the end of some work in the background."""
    for _ in range(200):
        answer = dashboard.get(path)
        if 'http-equiv="refresh"' not in answer.text:
            return answer
        time.sleep(0.05)
    raise AssertionError(f"{path}: the work does not end")


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory, stimulus_set: Path) -> Settings:
    """A server whose folder of stimulus sets holds one."""
    settings = Settings(data_dir=tmp_path_factory.mktemp("own"), largest_upload_mb=1)
    shutil.copytree(stimulus_set.parent, settings.sets_dir / "tiny")
    return settings


@pytest.fixture(scope="module")
def own_server(own: Settings) -> Iterator[str]:
    with running_server(own) as url:
        yield url


@pytest.mark.slow
def test_a_study_is_created_from_a_stimulus_set_and_pauses_until_it_is_opened(own_server: str, own: Settings) -> None:
    with signed_in(own_server, own, "Eva") as eva:
        assert "tiny" in eva.get("/admin/studies/new").text
        fields = {"name": "First", "stimulus_set": "tiny", "stage": "interview", "consent": "I agree.\r\n\r\nReally."}
        job = eva.act("/admin/studies/new", **fields)
        page = ends(eva, job.url.path)
        assert page.url.path == "/admin/studies/first"
        code = operate.list_studies(own)[0]["invitations"][0]
        assert eva.get(f"/s/{code}").status_code == 403
        assert "Close to new participants" in eva.act("/admin/studies/first/state", state="open").text
        assert eva.get(f"/s/{code}").status_code == 200
        again = ends(eva, eva.act("/admin/studies/new", name="First", stimulus_set="tiny").url.path)
        assert "there is already a study" in again.text


@pytest.mark.parametrize("name", ["../tiny", "/etc", "", "tiny/../../x", "unknown"])
def test_no_path_from_outside_reaches_the_file_system(own_server: str, own: Settings, name: str) -> None:
    with signed_in(own_server, own, "Eva") as eva:
        answer = eva.act("/admin/studies/new", name="Path", stimulus_set=name)
        assert answer.status_code in (404, 422)


def upload(dashboard: Dashboard, content: bytes, **headers: str) -> httpx.Response:
    token = {"X-CSRF-Token": dashboard.form_token}
    return dashboard.put("/admin/stimuli/upload", content=content, headers=token | headers)


def zipped(files: dict[str, bytes]) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return content.getvalue()


def files_of(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_an_uploaded_set_is_checked_and_can_be_used(own_server: str, own: Settings, stimulus_set: Path) -> None:
    files = files_of(stimulus_set.parent)
    files["manifest.json"] = files["manifest.json"].replace(b'"name": "tiny"', b'"name": "Sent by post"')
    with signed_in(own_server, own, "Eva") as eva:
        sent = upload(eva, zipped({f"folder/{name}": data for name, data in files.items()}))
        assert sent.status_code == 202
        assert ends(eva, sent.json()["job"]).url.path == "/admin/sets"
        assert "Sent by post" in eva.get("/admin/studies/new").text
        assert (own.sets_dir / "sent-by-post" / "manifest.json").is_file()


@pytest.mark.parametrize(
    ("files", "complaint"),
    [
        ({"../evil.mp4": b"x"}, "not plain letters"),
        ({"/etc/passwd": b"x"}, "not plain letters"),
        ({"a\\..\\b.mp4": b"x"}, "not plain letters"),
        ({"manifest.json": b"0" * 3_000_000}, "far more than such files do"),
    ],
)
def test_a_hostile_zip_is_refused_with_a_message_and_an_entry(
    own_server: str, own: Settings, files: dict[str, bytes], complaint: str
) -> None:
    before = sorted(own.sets_dir.rglob("*"))
    with signed_in(own_server, own, "Eva") as eva:
        answer = upload(eva, zipped(files), Accept="application/json")
        assert answer.status_code in (413, 422)
        assert complaint in answer.json()["detail"]
        assert complaint in eva.get("/admin/audit?search=upload+refused").text
    assert sorted(own.sets_dir.rglob("*")) == before


def test_a_page_that_calls_itself_a_film_is_refused(own_server: str, own: Settings) -> None:
    with signed_in(own_server, own, "Eva") as eva:
        sent = upload(eva, zipped({"film.mp4": b"<!doctype html><script>alert(1)</script>"}))
        assert "not an MP4 film" in ends(eva, sent.json()["job"]).text
        assert "not an MP4 film" in eva.get("/admin/audit?search=work+failed").text
    assert not [path for path in own.sets_dir.iterdir() if path.name.startswith(".upload")]


@pytest.fixture(scope="module")
def compared(own: Settings, stimulus_set: Path) -> str:
    """The address of a study to which results are uploaded."""
    return f"/admin/studies/{operate.create_study(own, stimulus_set, 'Compared')['slug']}"


def send_results(dashboard: Dashboard, study: str, files: dict[str, bytes]) -> httpx.Response:
    token = {"X-CSRF-Token": dashboard.form_token, "Accept": "application/json"}
    return dashboard.put(f"{study}/upload", content=zipped(files), headers=token)


REPORT = b'{"kind": "sphere", "measures": []}'


def test_reports_and_models_are_uploaded(own_server: str, own: Settings, compared: str, tmp_path: Path) -> None:
    files = files_of(shapes.write_folder(tmp_path))
    with signed_in(own_server, own, "Eva") as eva:
        for page in ("objective", "models"):
            assert f'data-to="{compared}/upload"' in eva.get(f"{compared}/{page}").text
        sent = send_results(eva, compared, files)  # a folder for meshes and one for clouds, and nothing around them
        shown = ends(eva, sent.json()["job"])
        assert shown.url.path == f"{compared}/models"
        assert "pm_fb" in shown.text
        sent = send_results(eva, compared, {"a/report.json": REPORT, "a/curve.csv": b"threshold\n1\n"})
        shown = ends(eva, sent.json()["job"])
        assert shown.url.path == f"{compared}/objective"
        assert "the whole study" in shown.text
        assert eva.get("/admin/audit?search=results+attached").text.count("results attached") >= 2
    assert not list((own.data_dir / "uploads").iterdir())


@pytest.mark.parametrize(
    ("files", "complaint"),
    [
        ({"../report.json": REPORT}, "not plain letters"),
        ({"meshes/ball/<script>.ply": b"ply\n"}, "not plain letters"),
        ({"report.json": b"0" * 3_000_000}, "far more than such files do"),
        ({"report.json": REPORT, "curve.svg": b"<!doctype html>"}, "is no SVG file"),
        ({"report.json": REPORT, "curve.svg": b"<svg><SCRIPT>alert(1)</SCRIPT></svg>"}, "holds a script"),
        ({"report.json": REPORT, "run.exe": b"MZ"}, "no part of reports or models"),
        ({"meshes/ball/id_fa.ply": b"ply\nformat ascii 1.0\n"}, "no binary little-endian PLY"),
        ({"notes.txt": b"x"}, "holds neither a report"),
        ({"report.json": REPORT}, "lists no measure and comes without tables"),
    ],
)
def test_hostile_results_are_refused_with_a_message_and_an_entry(
    own_server: str, own: Settings, compared: str, files: dict[str, bytes], complaint: str
) -> None:
    with signed_in(own_server, own, "Eva") as eva:
        answer = send_results(eva, compared, files)
        if answer.status_code == 202:
            answer = ends(eva, answer.json()["job"])
        assert complaint in answer.text
        assert str(own.data_dir) not in answer.text
        assert complaint in eva.get("/admin/audit").text
    assert not list((own.data_dir / "uploads").iterdir())


def test_results_are_taken_with_the_forms_token_and_from_experimenters_only(
    own_server: str, own: Settings, compared: str
) -> None:
    with signed_in(own_server, own, "Eva") as eva:
        assert eva.put(f"{compared}/upload", content=b"").status_code == 403
    with signed_in(own_server, own, "Vito", "viewer") as vito:
        assert send_results(vito, compared, {"report.json": REPORT}).status_code == 403
        assert "upload-form" not in vito.get(f"{compared}/objective").text


def test_an_upload_that_is_too_large_is_refused_before_it_is_sent(own_server: str, own: Settings) -> None:
    with signed_in(own_server, own, "Eva") as eva:
        cookie, token = eva.cookies["experimenter"], eva.form_token
        head = (
            f"PUT /admin/stimuli/upload HTTP/1.1\r\nHost: server\r\nAccept: application/json\r\n"
            f"Cookie: experimenter={cookie}\r\nX-CSRF-Token: {token}\r\nContent-Length: {10 * 2**30}\r\n\r\n"
        )
        host, port = own_server.removeprefix("http://").split(":")
        with socket.create_connection((host, int(port)), timeout=10) as connection:
            connection.sendall(head.encode())
            assert connection.recv(100).startswith(b"HTTP/1.1 413")
        assert "has 10240 MB" in eva.get("/admin/audit?search=upload+refused").text
        assert upload(eva, b"0" * (2**20 + 1), Accept="application/json").status_code == 413
        assert upload(eva, b"no zip", Accept="application/json").status_code == 422


def test_a_form_edits_a_study_and_two_editors_are_told_of_each_other(
    experimenter: Dashboard, new_study: NewStudy
) -> None:
    base = f"/admin/studies/{new_study()['slug']}"
    page = experimenter.get(f"{base}/edit").text
    revision = re.findall(r'name="revision" value="(\d+)"', page)[0]
    fields = {"name": "Renamed", "exposure_s": "1.5", "stage": "interview", "consent": "One.\r\n\r\nTwo."}
    edited = experimenter.act(f"{base}/edit", revision=revision, **fields)
    assert "Renamed" in edited.text
    assert 'value="1.5"' in edited.text
    late = experimenter.act(f"{base}/edit", revision=revision, **fields | {"name": "Overwritten"})
    assert late.status_code == 409
    assert "Somebody else has changed this study" in late.text
    assert "Renamed" in experimenter.get(base).text
    log = experimenter.get("/admin/audit").text
    assert "study edited" in log
    assert "edit refused" in log


def test_a_form_sets_the_limits_of_the_screening_and_refuses_impossible_ones(
    experimenter: Dashboard, new_study: NewStudy
) -> None:
    base = f"/admin/studies/{new_study()['slug']}"
    fields = {
        "name": "Seen well",
        "exposure_s": "0.4",
        "stage": "screening",
        "screening": "true",
        "test": "acuity",
        "acuity_limit": "0.1",
        "distance": "fixed",
        "distance_cm": "60",
        "colour_axis": "protan",
        "colour_misses": "2",
        "on_failure": "stop",
    }
    page = experimenter.act(f"{base}/edit", revision="1", **fields).text
    for line in ("acuity_limit = 0.1", 'distance = "fixed"', "distance_cm = 60", "colour_misses = 2"):
        assert line in page.replace("&#34;", '"'), line
    for wrong in ({"distance_cm": ""}, {"acuity_limit": "3"}, {"test": "smell"}, {"on_failure": "explode"}):
        refused = experimenter.act(f"{base}/edit", revision="2", **fields | wrong)
        assert refused.status_code == 422, wrong
        assert "Nothing was changed" in refused.text


def test_a_file_edits_a_study_and_bad_files_change_nothing(experimenter: Dashboard, new_study: NewStudy) -> None:
    base = f"/admin/studies/{new_study()['slug']}"
    good = 'name = "By file"\nexposure_s = 2\n[options]\nbreak_every = 5\n'
    assert "break_every = 5" in experimenter.act(f"{base}/edit/file", revision="1", text=good).text
    unknown = 'name = "x"\nexposure_s = 2\ncolour = "red"'
    for text in ("name = ", unknown, good + "unknown = 1", 'name = ""\nexposure_s=1'):
        refused = experimenter.act(f"{base}/edit/file", revision="2", text=text)
        assert refused.status_code == 422
        assert "Nothing was changed" in refused.text
    assert "By file" in experimenter.get(base).text


def test_what_participants_see_stays_once_somebody_has_begun(
    experimenter: Dashboard, client: httpx.Client, new_study: NewStudy
) -> None:
    study = new_study()
    begin(client, study["slug"], study["invitation"])
    base = f"/admin/studies/{study['slug']}"
    refused = experimenter.act(f"{base}/edit", revision="1", name="Same", exposure_s="9")
    assert refused.status_code == 409
    assert "exposure_s cannot change" in refused.text
    allowed = experimenter.act(f"{base}/edit", revision="1", name="Same", debriefing="Thank you.")
    assert "Thank you." in allowed.text


@pytest.mark.slow
def test_a_duplicate_has_the_pairs_and_nobody_in_it(
    experimenter: Dashboard, analyst: httpx.Client, taken: dict[str, Any]
) -> None:
    experimenter.act(f"/admin/studies/{taken['slug']}/duplicate", name=f"{taken['name']} twin")
    twin = analyst.get(f"/api/v1/studies/{taken['slug']}-twin").json()
    assert (twin["state"], twin["n_pairs"], twin["n_started"]) == ("paused", 6, 0)
    assert twin["conditions"] == analyst.get(f"/api/v1/studies/{taken['slug']}").json()["conditions"]


def test_a_paused_study_tells_who_comes_to_come_back(
    experimenter: Dashboard, client: httpx.Client, new_study: NewStudy
) -> None:
    study = new_study()
    experimenter.act(f"/admin/studies/{study['slug']}/state", state="paused")
    page = client.get(f"/s/{study['invitation']}")
    assert page.status_code == 403
    assert "come back later" in page.text


def test_a_preview_walks_the_whole_study_and_leaves_no_vote(
    experimenter: Dashboard, analyst: httpx.Client, vote_body: Callable[..., dict[str, Any]], new_study: NewStudy
) -> None:
    study = new_study()
    base = f"/admin/studies/{study['slug']}"
    for _ in range(2):
        page = experimenter.act(f"{base}/preview")
        assert page.url.path.startswith("/s/")
        assert 'data-state="mine"' in page.text
        token = experimenter.cookies["session"]
        bearer = {"Authorization": f"Bearer {token}"}
        with httpx.Client(base_url=experimenter.base_url, headers=bearer) as walker:
            walker.put("/api/v1/session/stages/introduction", json={"data": {}})
            for _ in range(6):
                trial = next_trial(walker, token)
                assert trial is not None
                assert walker.put(f"/api/v1/session/trials/{trial['trial']}/vote", json=vote_body(trial)).is_success
            assert walker.get("/api/v1/session").json()["stage"] == "finished"
    summary = analyst.get(f"/api/v1/studies/{study['slug']}").json()
    assert (summary["n_started"], summary["n_votes"]) == (0, 0)
    assert analyst.get(f"/api/v1/studies/{study['slug']}/votes").json() == []
    assert "Nobody has begun yet" in experimenter.get(base).text
    begun = begin(analyst, study["slug"], study["invitation"])
    assert analyst.get(f"/api/v1/studies/{study['slug']}/trials", params={"session": begun["session"]}).json()
    assert "P001" in experimenter.get(base).text


@pytest.mark.slow
def test_an_exclusion_needs_a_reason_counts_at_once_and_can_be_undone(
    experimenter: Dashboard, analyst: httpx.Client, taken: dict[str, Any]
) -> None:
    person = f"/admin/studies/{taken['slug']}/participants/P002"
    assert experimenter.act(f"{person}/exclude", reason="").status_code == 422
    page = experimenter.act(f"{person}/exclude", reason="=cmd() looked at a telephone")
    assert "looked at a telephone" in page.text
    assert experimenter.act(f"{person}/exclude", reason="again").status_code == 409
    votes = analyst.get(f"/api/v1/studies/{taken['slug']}/votes").json()
    assert {vote["participant"] for vote in votes if vote["excluded"]} == {"P002"}
    results = f"/admin/studies/{taken['slug']}/results"
    assert "6 votes are left out" in experimenter.get(results).text
    assert "Everybody is counted" in experimenter.get(results, params={"everybody": "true"}).text
    experimenter.act(f"{person}/include")
    assert "Every vote is counted" in experimenter.get(results).text
    assert "undone by Eva Example" in experimenter.get(person).text
    assert experimenter.act(f"{person}/include").status_code == 409


@pytest.mark.slow
def test_what_a_participant_gave_can_be_exported_and_erased(
    experimenter: Dashboard, analyst: httpx.Client, server: str, token: str, new_study: NewStudy
) -> None:
    study = new_study()
    simulate(server, study["slug"], study["invitation"], token, 2, ABILITIES, seed=1)
    person = f"/admin/studies/{study['slug']}/participants/P001"
    given = experimenter.get(f"{person}/export.json").json()
    assert len(given["vote"]) == 6
    assert not re.search(r"_hash|token", str(given.keys()) + str(given["session"]))
    assert experimenter.act(f"{person}/erase", again="P002").status_code == 422
    assert "erased" in experimenter.act(f"{person}/erase", again="P001").text
    assert experimenter.get(f"{person}/export.json").json()["vote"] == []
    votes = analyst.get(f"/api/v1/studies/{study['slug']}/votes").json()
    assert {vote["participant"] for vote in votes} == {"P002"}
    assert experimenter.act(f"{person}/erase", again="P001").status_code == 409


def test_invitations_are_made_shown_as_qr_and_ended(
    experimenter: Dashboard, client: httpx.Client, new_study: NewStudy
) -> None:
    study = new_study()
    base = f"/admin/studies/{study['slug']}/invitations"
    codes = set(re.findall(r"/s/([a-z0-9]+)<", experimenter.act(base, places="1", number="3").text))
    assert len(codes - {study["invitation"]}) == 3
    assert "<svg" in experimenter.get(f"{base}/{study['invitation']}/qr.svg").text
    assert experimenter.get(f"{base}/forged/qr.svg").status_code == 404
    (unused, *_) = codes - {study["invitation"]}
    begin(client, study["slug"], study["invitation"])
    for code in (unused, study["invitation"]):
        assert experimenter.act(f"{base}/{code}/end").status_code == 200
        refused = client.post(f"/api/v1/studies/{study['slug']}/sessions", json={"invitation": code})
        assert refused.status_code in (404, 410)


def test_votes_are_filtered_and_replayed(experimenter: Dashboard, taken: dict[str, Any]) -> None:
    base = f"/admin/studies/{taken['slug']}/votes"
    page = experimenter.get(base, params={"participant": "P003", "dataset": "ball"}).text
    assert "3 trials" in page
    trial = re.findall(rf'href="({base}/[^"?]+)"', page)[0]
    replay = experimenter.get(trial).text
    assert 'class="look look-' in replay
    assert "/media/" in replay
    assert experimenter.get(f"{base}/forged").status_code == 404


def test_a_replay_divides_the_time_between_the_two() -> None:
    switches = [{"to": "b", "at_ms": 300.0}, {"to": "a", "at_ms": 700.0}]
    looks = looks_of({"first_shown": "a", "shown_ms": 1000.0, "switches": switches}, 0)
    assert [(look.label, look.from_ms, look.to_ms) for look in looks] == [
        ("a", 0.0, 300.0),
        ("b", 300.0, 700.0),
        ("a", 700.0, 1000.0),
    ]
    assert looks_of({}, 1000) == ()


@pytest.mark.slow
def test_stimuli_are_seen_and_a_damaged_film_is_found(own_server: str, own: Settings, stimulus_set: Path) -> None:
    operate.create_study(own, stimulus_set, "Films", exposure_s=0.4)
    with signed_in(own_server, own, "Eva") as eva:
        page = eva.get("/admin/studies/films/stimuli").text
        stills = re.findall(r'src="(/admin/studies/films/stimuli/[^"]+\.jpg)"', page)
        assert len(stills) == 6
        assert eva.get(stills[0]).content.startswith(b"\xff\xd8")
        assert "films are there and are what they were" in eva.act("/admin/studies/films/stimuli").text
        damaged = next(own.media_dir.glob("*.mp4"))
        content = damaged.read_bytes()
        damaged.write_bytes(content + b"x")
        assert "not what it was" in eva.act("/admin/studies/films/stimuli").text
        damaged.write_bytes(content)


@pytest.mark.slow
def test_the_design_tells_balance_duration_and_power(experimenter: Dashboard, taken: dict[str, Any]) -> None:
    page = experimenter.get(f"/admin/studies/{taken['slug']}/design", params={"participants": 6, "effect": 1}).text
    assert "as planned" in page
    assert re.search(r"found in \d+ % of studies in\s+one dataset", page)
    assert experimenter.get(f"/admin/studies/{taken['slug']}/design?participants=1e9").status_code == 422


def test_the_monitor_follows_a_participant_by_server_sent_events(
    experimenter: Dashboard, client: httpx.Client, vote_body: Callable[..., dict[str, Any]], new_study: NewStudy
) -> None:
    study = new_study()
    session = begin(client, study["slug"], study["invitation"])
    with experimenter.stream("GET", f"/admin/studies/{study['slug']}/live", timeout=10) as stream:
        lines = stream.iter_lines()
        until(lines, "0 of 6")
        trial = next_trial(client, session["token"])
        assert trial is not None
        client.put(f"/api/v1/session/trials/{trial['trial']}/vote", json=vote_body(trial))
        until(lines, "1 of 6")


def until(lines: Iterator[str], text: str) -> None:
    assert any(text in line for line in lines), f"{text!r} never came"


def test_a_stranger_gets_no_live_events(client: httpx.Client, taken: dict[str, Any]) -> None:
    assert client.get(f"/admin/studies/{taken['slug']}/live").status_code == 401


def test_results_tell_when_nothing_is_new(experimenter: Dashboard, taken: dict[str, Any]) -> None:
    results = f"/admin/studies/{taken['slug']}/results"
    digest = re.findall(r'data-digest="([0-9a-f]+)"', experimenter.get(results).text)[0]
    assert experimenter.get(results, params={"seen": digest}).status_code == 204
    assert experimenter.get(results, params={"seen": digest, "everybody": "true"}).status_code in (200, 204)


def test_the_server_page_keeps_the_database_address_to_itself(server: str, settings: Settings) -> None:
    with signed_in(server, settings, "Olga", "owner") as olga:
        page = olga.get("/admin/settings").text
    assert "RECONSTUDY_DATA_DIR" in page
    assert "sqlite:///" not in page
