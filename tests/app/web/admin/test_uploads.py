"""Stimulus sets, reports and models that an experimenter uploads, and what is refused."""

from __future__ import annotations

import logging
import socket
import time
from datetime import timedelta
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest
from sqlalchemy import update

from app.operations.database import open_store
from app.operations.studies import create
from app.settings import Settings
from app.store.access.experimenters import OLD_TOKEN_LASTS, TOKEN_LASTS
from app.store.database.keys import utc_now
from app.store.database.tables import experimenter_session
from tests.app import tiny_stimuli
from tests.app.web.admin import small_models
from tests.app.web.admin.dashboard_client import Dashboard, ends, files_of, signed_in, zipped

pytestmark = pytest.mark.slow


def upload(dashboard: Dashboard, content: bytes, **headers: str) -> httpx.Response:
    token = {"X-CSRF-Token": dashboard.form_token}
    return dashboard.put("/admin/stimuli/upload", content=content, headers=token | headers)


def test_an_uploaded_set_is_checked_and_can_be_used(own_server: str, own: Settings, stimulus_set: Path) -> None:
    files = files_of(stimulus_set.parent)
    files["manifest.json"] = files["manifest.json"].replace(b'"name": "tiny"', b'"name": "Sent by post"')
    with signed_in(own_server, own, "Eva") as eva:
        sent = upload(eva, zipped({f"folder/{name}": data for name, data in files.items()}))
        assert sent.status_code == 202
        assert ends(eva, sent.json()["task"]).url.path == "/admin/sets/sent-by-post"
        assert "Sent by post" in eva.get("/admin/studies/new").text
        assert (own.sets_dir / "sent-by-post" / "manifest.json").is_file()


def test_a_zip_of_plain_films_becomes_a_set_that_says_what_was_found(
    own_server: str, own: Settings, tmp_path: Path
) -> None:
    for name in ("a", "b"):
        tiny_stimuli.encode(tmp_path / "street" / f"{name}.mkv", tiny_stimuli.flat("gray"), "-vf", "setsar=2/1")
    with signed_in(own_server, own, "Eva") as eva:
        token = {"X-CSRF-Token": eva.form_token}
        content = zipped(files_of(tmp_path))
        sent = eva.put("/admin/stimuli/upload?name=My+films", content=content, headers=token)
        page = ends(eva, sent.json()["task"])
        assert page.url.path == "/admin/sets/my-films"
        assert "scaled from 64x48 with pixels 2:1 to 128x48" in page.text
        assert "(guessed)" in page.text
        flat = upload(eva, zipped({"a.mp4": (own.sets_dir / "my-films" / "street" / "a.mp4").read_bytes()}))
        refused = ends(eva, flat.json()["task"]).text
        assert "a.mp4 lies in no folder" in refused
        assert str(own.sets_dir) not in refused


TABLE = "file,dataset,condition\n1.mp4,street,plain\n2.mp4,street,sharp\n"


@pytest.mark.parametrize(
    ("names", "table", "understood"),
    [
        (
            ("street_night_plain", "street_night_sharp", "park_plain", "park_sharp"),
            "",
            ("2 scenes in 2", "street_night"),
        ),
        (("1", "2"), TABLE, ("1 scene in 2", "sharp")),
    ],
)
def test_films_without_folders_are_named_by_their_names_or_by_a_table(
    own_server: str, own: Settings, tmp_path: Path, names: tuple[str, ...], table: str, understood: tuple[str, str]
) -> None:
    tiny_stimuli.encode(tmp_path / "film.mp4", tiny_stimuli.flat("gray"))
    files = {f"{name}.mp4": (tmp_path / "film.mp4").read_bytes() for name in names}
    files |= {"films.csv": table.encode()} if table else {}
    with signed_in(own_server, own, "Eva") as eva:
        token = {"X-CSRF-Token": eva.form_token}
        address = f"/admin/stimuli/upload?then=study&name=Flat+{len(names)}"
        sent = eva.put(address, content=zipped(files), headers=token)
        page = ends(eva, sent.json()["task"])
    assert page.url.path == "/admin/studies/new"
    assert all(words in page.text for words in understood)


def test_films_for_another_study_get_a_number_where_nobody_was_asked_for_their_name(
    own_server: str, own: Settings, tmp_path: Path
) -> None:
    tiny_stimuli.encode(tmp_path / "film.mp4", tiny_stimuli.flat("gray"))
    content = zipped(dict.fromkeys(("street/sharp.mp4", "street/soft.mp4"), (tmp_path / "film.mp4").read_bytes()))
    token = {}

    def made(query: str) -> str:
        sent = eva.put(f"/admin/stimuli/upload{query}", content=content, headers=token).json()
        return ends(eva, sent["task"]).text

    with signed_in(own_server, own, "Eva") as eva:
        token["X-CSRF-Token"] = eva.form_token
        for _ in range(2):
            made("?then=study&name=Again")
            made("")
        assert "there are films called &#39;again&#39; already" in made("?name=Again")
    assert {"again", "again-2", "films", "films-2"} <= {folder.name for folder in own.sets_dir.iterdir()}


@pytest.mark.parametrize(
    ("files", "complaint"),
    [
        ({"../evil.mp4": b"x"}, "is not plain"),
        ({"/etc/passwd": b"x"}, "is not plain"),
        ({"a\\..\\b.mp4": b"x"}, "is not plain"),
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


@pytest.mark.parametrize("path", ["/admin/stimuli/upload", "/api/v1/studies"])
def test_other_tabs_stay_signed_in_while_an_answer_takes_minutes(own_server: str, own: Settings, path: str) -> None:
    with signed_in(own_server, own, "Eva") as eva, Dashboard(own_server) as other_tab:
        other_tab.cookies = eva.cookies
        token = {"X-CSRF-Token": eva.form_token}
        last_renewed(own, TOKEN_LASTS + timedelta(minutes=1))
        httpx.request("PUT" if "upload" in path else "GET", own_server + path, headers=token, cookies=eva.cookies)
        last_renewed(own, OLD_TOKEN_LASTS + timedelta(minutes=1), only_later=True)  # as long as the answer took
        assert other_tab.get("/admin").status_code == 200


def last_renewed(settings: Settings, ago: timedelta, *, only_later: bool = False) -> None:
    """Let time go by since sessions got their tokens."""
    at = utc_now() - ago
    database = open_store(settings)
    with database.writing() as connection:
        renewed = update(experimenter_session).values(rotated_at=at)
        connection.execute(renewed.where(experimenter_session.c.rotated_at > at) if only_later else renewed)
    database.dispose()


def test_a_page_that_calls_itself_a_film_is_refused(own_server: str, own: Settings) -> None:
    with signed_in(own_server, own, "Eva") as eva:
        sent = upload(eva, zipped({"film.mp4": b"<!doctype html><script>alert(1)</script>"}))
        assert "is no MP4 file" in ends(eva, sent.json()["task"]).text
        assert "is no MP4 file" in eva.get("/admin/audit?search=work+failed").text
    assert not [path for path in own.sets_dir.iterdir() if path.name.startswith(".upload")]


@pytest.fixture(scope="module")
def compared(own: Settings, stimulus_set: Path) -> str:
    """The address of a study to which results are uploaded."""
    return f"/admin/studies/{create.create_study(own, stimulus_set, 'Compared')['slug']}"


def send_results(dashboard: Dashboard, study: str, files: dict[str, bytes]) -> httpx.Response:
    token = {"X-CSRF-Token": dashboard.form_token, "Accept": "application/json"}
    return dashboard.put(f"{study}/upload", content=zipped(files), headers=token)


REPORT = b'{"kind": "sphere", "measures": []}'


def test_reports_and_models_are_uploaded(own_server: str, own: Settings, compared: str, tmp_path: Path) -> None:
    files = files_of(small_models.write_folder(tmp_path))
    with signed_in(own_server, own, "Eva") as eva:
        for page in ("objective", "models"):
            assert f'data-to="{compared}/upload"' in eva.get(f"{compared}/{page}").text
        sent = send_results(eva, compared, files)  # a folder for meshes and one for clouds, and nothing around them
        shown = ends(eva, sent.json()["task"])
        assert shown.url.path == f"{compared}/models"
        assert "pm_fb" in shown.text
        sent = send_results(eva, compared, {"a/report.json": REPORT, "a/curve.csv": b"threshold\n1\n"})
        shown = ends(eva, sent.json()["task"])
        assert shown.url.path == f"{compared}/objective"
        assert "the whole study" in shown.text
        assert eva.get("/admin/audit?search=results+attached").text.count("results attached") >= 2
    assert not list((own.data_dir / "uploads").iterdir())


MEASURES = b"dataset,approach,measure,value,better\nball,pm_fb,psnr,31.5,higher\nstatue,pm_fb,psnr,2,higher\n"


def send_table(dashboard: Dashboard, study: str, content: bytes) -> httpx.Response:
    token = {"X-CSRF-Token": dashboard.form_token, "Accept": "application/json"}
    return dashboard.put(f"{study}/upload", content=content, headers=token)


def test_a_table_of_measures_is_uploaded_as_it_is_or_zipped(own_server: str, own: Settings, compared: str) -> None:
    with signed_in(own_server, own, "Eva") as eva:
        shown = ends(eva, send_table(eva, compared, MEASURES).json()["task"])
        assert shown.url.path == f"{compared}/objective"
        assert "31.5" in shown.text
        assert "the study does not compare statue/pm_fb: left out" in shown.text
        zipped_table = {"measures.csv": MEASURES.replace(b"31.5", b"32.25")}
        assert "32.25" in ends(eva, send_results(eva, compared, zipped_table).json()["task"]).text
    assert not list((own.data_dir / "uploads").iterdir())


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (MEASURES.replace(b"31.5", b"good"), "the table: row 1: value is &#39;good&#39;"),
        (b"\x89PNG\r\n\x1a\n\0", "neither a zip file nor a table in CSV"),
        (b"PK no zip", "not a zip file"),
    ],
)
def test_a_table_that_is_none_is_refused_with_a_message_and_an_entry(
    own_server: str, own: Settings, compared: str, content: bytes, complaint: str
) -> None:
    with signed_in(own_server, own, "Eva") as eva:
        answer = send_table(eva, compared, content)
        if answer.status_code == 202:
            answer = ends(eva, answer.json()["task"])
        assert complaint in answer.text
        assert str(own.data_dir) not in answer.text
        assert complaint in eva.get("/admin/audit").text
    assert not list((own.data_dir / "uploads").iterdir())


@pytest.mark.parametrize(
    ("files", "complaint"),
    [
        ({"../report.json": REPORT}, "is not plain"),
        ({"meshes/ball/<script>.ply": b"ply\n"}, "is not plain"),
        ({"report.json": b"0" * 3_000_000}, "far more than such files do"),
        ({"report.json": REPORT, "curve.svg": b"<!doctype html>"}, "is no SVG file"),
        ({"report.json": REPORT, "curve.svg": b"<svg><SCRIPT>alert(1)</SCRIPT></svg>"}, "holds a script"),
        ({"report.json": REPORT, "run.exe": b"MZ"}, "does not belong to reports or models"),
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
            answer = ends(eva, answer.json()["task"])
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


def test_an_upload_that_does_not_say_how_large_it_is_ends_at_the_limit(
    own_server: str, own: Settings, compared: str
) -> None:
    with signed_in(own_server, own, "Eva") as eva:
        token = {"X-CSRF-Token": eva.form_token, "Accept": "application/json"}
        for path in ("/admin/stimuli/upload", "/admin/studies/import", f"{compared}/upload"):
            answer = eva.put(path, content=iter([b"PK", b"0" * 2**20]), headers=token)
            assert (answer.status_code, "more than 1 MB" in answer.text) == (413, True), path


def test_an_upload_that_is_too_large_is_refused_before_it_is_sent(own_server: str, own: Settings) -> None:
    with signed_in(own_server, own, "Eva") as eva:
        cookie, token = eva.cookies["experimenter"], eva.form_token
        head = (
            f"PUT /admin/stimuli/upload HTTP/1.1\r\nHost: localhost\r\nAccept: application/json\r\n"
            f"Cookie: experimenter={cookie}\r\nX-CSRF-Token: {token}\r\nContent-Length: {10 * 2**30}\r\n\r\n"
        )
        host, port = own_server.removeprefix("http://").split(":")
        with socket.create_connection((host, int(port)), timeout=30) as connection:
            connection.sendall(head.encode())
            assert connection.recv(100).startswith(b"HTTP/1.1 413")
        assert "has 10240 MB" in eva.get("/admin/audit?search=upload+refused").text
        assert upload(eva, b"0" * (2**20 + 1), Accept="application/json").status_code == 413
        assert upload(eva, b"no zip", Accept="application/json").status_code == 422


def test_a_client_that_leaves_within_an_upload_is_no_error(
    own_server: str, own: Settings, caplog: pytest.LogCaptureFixture
) -> None:
    address = urlsplit(own_server)
    with signed_in(own_server, own, "Eva") as eva, caplog.at_level(logging.INFO):
        cookies = "; ".join(f"{name}={value}" for name, value in eva.cookies.items())
        head = (
            f"PUT /admin/stimuli/upload HTTP/1.1\r\nHost: {address.netloc}\r\nCookie: {cookies}\r\n"
            f"X-CSRF-Token: {eva.form_token}\r\nContent-Length: 1000\r\n\r\nPK"
        )
        with socket.create_connection((address.hostname, address.port)) as leaving:
            leaving.sendall(head.encode())
            time.sleep(0.3)
        until = time.monotonic() + 30
        while "the client left" not in caplog.text and time.monotonic() < until:
            time.sleep(0.05)
    assert "the client left" in caplog.text
    assert not [record for record in caplog.records if record.levelno >= logging.ERROR]
