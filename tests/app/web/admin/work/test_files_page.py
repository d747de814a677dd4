"""The server's files on the dashboard: uploads in parts, what is refused, entries looked at and deleted."""

from __future__ import annotations

import errno
import json
import os
import shutil
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn

import httpx
import pytest

from app.intake import part_uploads
from app.operations.studies import create
from app.operations.upkeep.leftovers import remove_leftovers
from app.settings import Settings
from app.store.database.keys import utc_now
from app.web import uploads
from tests.app.web.admin.dashboard_client import Dashboard, ends, signed_in, zipped

pytestmark = pytest.mark.slow

PNG = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010802000000907753de0000000c4944415408d763f8cfc0000003010100"
    "c9fe92ef0000000049454e44ae426082"
)
PLY = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n0\n"
FILM = b"\0\0\0\x20ftypisom"
MEASURES = b"dataset,approach,measure,value,better\nball,pm_fb,psnr,31.5,higher\n"


def camera(image: str) -> dict[str, Any]:
    return {"image": image, "size": [1, 1]}


def capture(n_frames: int = 2, **changes: Any) -> dict[str, bytes]:
    """The files of a capture of one sensor; its pictures have one pixel."""
    sensor = {"id": "S1", **{side: camera(f"S1/{side}/{{frame:04d}}.png") for side in ("left", "right")}}
    content = {"name": "ball", "n_frames": n_frames, "fps": 25, "sensors": [sensor], **changes}
    pictures = {f"S1/{side}/{frame:04d}.png": PNG for side in ("left", "right") for frame in range(n_frames)}
    return {"capture.json": json.dumps(content).encode(), **pictures}


def put(folder: Path, files: dict[str, bytes]) -> Path:
    for place, content in files.items():
        path = folder / place
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return folder


def raise_disk_full(*_: object) -> NoReturn:
    """Stand for `shelve`; it runs in another process."""
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.fixture(autouse=True)
def empty_shelves(own: Settings) -> None:
    shutil.rmtree(own.intake_dir, ignore_errors=True)


def begin(dashboard: Dashboard, kind: str, name: str, content: bytes, **more: Any) -> httpx.Response:
    token = {"X-CSRF-Token": dashboard.form_token, "Accept": "application/json"}
    wanted = {"kind": kind, "name": name, "file": "file.zip", "size": len(content), **more}
    return dashboard.post("/admin/files/upload", json=wanted, headers=token)


def add(dashboard: Dashboard, upload: str, part: bytes, offset: int) -> httpx.Response:
    token = {"X-CSRF-Token": dashboard.form_token, "Accept": "application/json", "Upload-Offset": str(offset)}
    return dashboard.patch(upload, content=part, headers=token)


def send(dashboard: Dashboard, kind: str, name: str, content: bytes) -> httpx.Response:
    """Upload in one part; the page that comes after the check."""
    begun = begin(dashboard, kind, name, content)
    assert begun.status_code == 201, begun.text
    return ends(dashboard, add(dashboard, begun.json()["upload"], content, 0).json()["task"])


def test_an_upload_goes_on_where_it_stopped(own_server: str, own: Settings) -> None:
    content = zipped({f"ball/{place}": data for place, data in capture().items()} | {"__MACOSX/ball/._x": b"x"})
    with signed_in(own_server, own, "Eva") as eva:
        upload = begin(eva, "captures", "ball", content).json()["upload"]
        assert add(eva, upload, content[:100], 0).json()["offset"] == 100
        assert add(eva, upload, content[:100], 0).status_code == 409, "it has these bytes already"
        assert "100 %" not in eva.get("/admin/files").text
        again = begin(eva, "captures", "ball", content)  # the page was closed, the same file is chosen again
        assert (again.json()["upload"], again.json()["offset"]) == (upload, 100)
        assert eva.get(upload).json()["offset"] == 100
        sent = add(eva, upload, content[100:], 100)
        shown = ends(eva, sent.json()["task"])
        assert shown.url.path == "/admin/files/captures/ball"
        assert "1 sensor, 2 frames, 25 a second" in shown.text
        assert eva.get(upload).json()["task"] == sent.json()["task"]
        assert "captures/ball" in eva.get("/admin/audit?search=file+uploaded").text
        assert "already; choose another name" in begin(eva, "captures", "ball", content).text
    assert sorted(path.name for path in (own.intake_dir / "captures").rglob("*.png")) == [
        "0000.png",
        "0000.png",
        "0001.png",
        "0001.png",
    ]
    assert [path.suffix for path in (own.intake_dir / ".uploads").iterdir()] == [".json"]


def test_what_came_before_the_connection_was_lost_is_kept(
    own_server: str, own: Settings, caplog: pytest.LogCaptureFixture
) -> None:
    def cut_off() -> Iterator[bytes]:
        yield b"123"
        answers = (httpx.get(own_server + upload, cookies=eva.cookies).json()["offset"] for _ in range(500))
        assert 3 in answers, "it is there while the rest is on its way"
        raise ConnectionResetError

    with signed_in(own_server, own, "Eva") as eva:
        upload = begin(eva, "captures", "ball", b"12345").json()["upload"]
        headers = {"X-CSRF-Token": eva.form_token, "Upload-Offset": "0", "Content-Length": "5"}
        with pytest.raises(ConnectionResetError):
            eva.patch(upload, content=cut_off(), headers=headers)
        ended = (add(eva, upload, b"45", 3) for _ in range(500))  # 409 until the server notices
        last = next(answer for answer in ended if answer.status_code == 202)
        assert "expected a zip file" in ends(eva, last.json()["task"]).text
    assert not [record for record in caplog.records if record.levelname == "ERROR"]


ACCEPTED = (
    ("films", "f", zipped({"ball/a.mp4": FILM, "ball/b.mp4": FILM}), "2 films of 1"),
    (
        "films",
        "g",
        zipped({"V/ball/a.mp4": FILM, "V/box/a.mp4": FILM, "V/conditions.csv": b"condition\n"}),
        "2 films of 2",
    ),
    ("clouds", "S1.ply", PLY, "1 cloud"),
    ("measures", "m.csv", MEASURES, "1 row: dataset, approach"),
    ("captures", "raw", zipped({"left/1.png": PNG, "calibration.yml": b"x"}), "recording without capture.json"),
)
CLIMBING = capture(sensors=[{"id": "S", "left": camera("../a.png")}])
REFUSED = (
    ("captures", "c", b"no zip", "expected a zip file of the recording"),
    ("captures", "c", zipped({"../x.png": PNG}), "not plain"),
    ("captures", "c", zipped({"x.exe": b"MZ"}), "does not belong to captures"),
    ("captures", "c", zipped({"x.png": b"<script>"}), "is no PNG file"),
    ("captures", "c", zipped({"notes.txt": b"x"}), "neither capture.json nor a picture"),
    ("captures", "c", zipped(capture(2) | {"capture.json": capture(3)["capture.json"]}), "0002.png, which is not"),
    ("captures", "c", zipped(capture(sensors=[{"id": "../S"}])), "no plain name such as S1"),
    ("captures", "c", zipped(CLIMBING), "a place inside the folder"),
    ("films", "f", zipped({"a.mp4": FILM}), "expected DATASET/CONDITION.mp4"),
    ("models", "m", zipped({"pm/0.ply": PLY}), "There is no scene.json"),
    ("measures", "m.csv", b"a;b\n1;2\n", "The table:"),
)
NEVER_KEPT: tuple[tuple[dict[str, Any], str], ...] = (
    ({"kind": "runs"}, "Nothing can be uploaded to"),
    ({"name": "../x"}, "cannot be used"),
    ({"size": 2**50}, "at most"),
    ({"size": 0}, "is empty"),
)


def test_each_kind_takes_its_own_files(own_server: str, own: Settings) -> None:
    with signed_in(own_server, own, "Eva") as eva:
        for kind, name, content, summary in ACCEPTED:
            shown = send(eva, kind, name, content)
            assert shown.url.path == f"/admin/files/{kind}/{name}"
            assert summary in shown.text


def test_a_name_may_be_of_any_script(own_server: str, own: Settings) -> None:
    name = "Süd 录制 العربية"
    with signed_in(own_server, own, "Eva") as eva:
        shown = send(eva, "captures", name, zipped(capture()))
        assert shown.url.path == f"/admin/files/captures/{name}"
        assert name in eva.get("/admin/files").text
        assert eva.get(f"/admin/files/captures/{name}/pictures/S1/left/1.jpg").status_code == 200
        downloaded = eva.get(f"/admin/files/captures/{name}/file/S1/left/0000.png")
        assert downloaded.content == PNG
        job = eva.act("/admin/work/new/check", capture=name)
        assert name in job.text
        eva.act(f"{job.url.path}/cancel")
        assert eva.act(f"/admin/files/captures/{name}/delete", again=name).url.path == "/admin/files"
    assert not list((own.intake_dir / "captures").iterdir())


def test_what_does_not_fit_is_refused_and_leaves_nothing(own_server: str, own: Settings) -> None:
    with signed_in(own_server, own, "Eva") as eva:
        for kind, name, content, complaint in REFUSED:
            refused = send(eva, kind, name, content).text.replace("&#39;", "'")
            assert complaint in refused
            assert str(own.data_dir) not in refused
        audit = eva.get("/admin/audit?search=work+failed").text
        assert all(complaint in audit for *_, complaint in REFUSED)
    assert {path.suffix for path in own.intake_dir.rglob("*") if path.is_file()} == {".json"}


def test_an_upload_that_could_not_be_kept_is_refused_before_it_begins(own_server: str, own: Settings) -> None:
    with signed_in(own_server, own, "Eva") as eva:
        for changes, complaint in NEVER_KEPT:
            answer = begin(eva, **({"kind": "captures", "name": "x", "content": b"x"} | changes))
            assert answer.status_code in (413, 422)
            assert complaint in answer.json()["detail"]
        upload = begin(eva, "captures", "x", b"12").json()["upload"]
        assert "More bytes came" in add(eva, upload, b"123", 0).json()["detail"]


def test_an_upload_for_which_there_was_room_goes_on(
    own_server: str, own: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    def leave(free: int) -> None:
        monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=free))

    content = b"x" * 1000
    with signed_in(own_server, own, "Eva") as eva:
        leave(2000)
        upload = begin(eva, "captures", "ball", content).json()["upload"]
        add(eva, upload, content[:500], 0)
        leave(1500)
        again = begin(eva, "captures", "ball", content)
        assert (again.status_code, again.json()["offset"]) == (200, 500)
        assert begin(eva, "captures", "other", content).status_code == 413, "nothing of it is there yet"
        leave(1499)
        assert "MB free" in begin(eva, "captures", "ball", content).json()["detail"]


def test_an_upload_whose_check_runs_needs_no_more_room(
    own_server: str, own: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = b"x" * 1000
    with signed_in(own_server, own, "Eva") as eva:
        upload = begin(eva, "captures", "ball", content).json()["upload"]
        known = part_uploads.standing(own.intake_dir, upload[-32:]).upload
        part_uploads.work_folder(own.intake_dir, known.id).with_suffix(".part").write_bytes(content)
        part_uploads.note_task(own.intake_dir, known, "1")
        monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=0))
        assert begin(eva, "captures", "ball", content).status_code == 413, "it would be unpacked now"
        with part_uploads.checking(own.intake_dir, known.id):
            again = begin(eva, "captures", "ball", content)
        assert (again.status_code, again.json()["task"]) == (200, "/admin/tasks/1")


def test_a_complete_upload_is_kept_when_its_check_fails_for_the_servers_reasons(
    own_server: str, own: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = zipped(capture())
    with signed_in(own_server, own, "Eva") as eva:
        with monkeypatch.context() as patched:
            patched.setattr(uploads, "shelve", raise_disk_full)
            failed = send(eva, "captures", "ball", content).text
        assert "No space left on device" in failed
        assert "choose the same file again" in failed
        assert 'href="/admin/files#upload"' in failed, "the way back to choose it"
        assert "100 % of" in eva.get("/admin/files").text
        again = begin(eva, "captures", "ball", content)
        told = again.json()
        assert (again.status_code, told["offset"], told["task"]) == (200, len(content), None)
        shown = ends(eva, add(eva, told["upload"], b"", len(content)).json()["task"])
        assert shown.url.path == "/admin/files/captures/ball"
    assert [path.suffix for path in (own.intake_dir / ".uploads").iterdir()] == [".json"]


def test_an_upload_that_nobody_goes_on_with_is_removed_after_a_day(own_server: str, own: Settings) -> None:
    with signed_in(own_server, own, "Eva") as eva:
        upload = begin(eva, "captures", "ball", b"12345").json()["upload"]
        add(eva, upload, b"123", 0)
        remove_leftovers(own, utc_now() + timedelta(hours=23))
        assert "60 % of" in eva.get("/admin/files").text
        old = (utc_now() - timedelta(hours=30)).timestamp()
        os.utime(part_uploads.work_folder(own.intake_dir, upload[-32:]).with_suffix(".json"), (old, old))
        remove_leftovers(own, utc_now())
        assert eva.get(upload).status_code == 200, "a part came within the day"
        remove_leftovers(own, utc_now() + timedelta(hours=25))
        assert eva.get(upload).status_code == 404
        upload = begin(eva, "captures", "ball", b"12345").json()["upload"]
        assert "Unfinished" not in eva.act(f"{upload}/discard").text
    assert not list((own.intake_dir / ".uploads").iterdir())


def test_a_folder_that_was_copied_by_hand_is_shown_with_thumbnails(
    own_server: str, own: Settings, tmp_path: Path
) -> None:
    folder = put(own.intake_dir / "captures" / "by hand", capture())
    (folder / "S1" / "right").rename(tmp_path / "elsewhere")
    (folder / "S1" / "right").symlink_to(tmp_path / "elsewhere")
    (folder / "S1" / "left" / "0000.png").write_bytes(PNG[:40])
    with signed_in(own_server, own, "Vera", "viewer") as vera:
        assert 'href="/admin/files/captures/by%20hand"' in vera.get("/admin/files").text
        shown = vera.get("/admin/files/captures/by%20hand").text
        assert shown.count("?small=true") == 4
        assert "Delete" not in shown
        thumbnail = vera.get("/admin/files/captures/by%20hand/pictures/S1/left/1.jpg?small=true")
        assert thumbnail.content.startswith(b"\xff\xd8\xff")
        for wrong in ("S1/left/2", "S2/left/0", "S1/top/0", "S1/left/-1", "S1/right/1"):
            assert vera.get(f"/admin/files/captures/by%20hand/pictures/{wrong}.jpg").status_code == 404
        damaged = vera.get("/admin/files/captures/by%20hand/pictures/S1/left/0.jpg")
        assert damaged.status_code == 422
        assert "S1/left/0000.png cannot be shown" in damaged.text
        assert begin(vera, "captures", "x", b"x").status_code == 403
        assert vera.act("/admin/files/captures/by%20hand/delete", again="by hand").status_code == 403
    assert (own.intake_dir / "captures" / "by hand").is_dir()


def test_a_description_far_too_long_is_named_and_not_shown(own_server: str, own: Settings) -> None:
    long = "x" * 3_000_000
    put(own.intake_dir / "captures" / "c", capture(name=long))
    put(own.intake_dir / "captures" / "d", capture(fps=long[:1_000_000]))
    put(own.intake_dir / "models" / "m", {"scene.json": json.dumps({"dataset": long[:1_000_000]}).encode()})
    with signed_in(own_server, own, "Vera", "viewer") as vera:
        shown = vera.get("/admin/files").text
        assert len(shown) < 100_000
        assert "capture.json has 2.9 MB, expected 2 MB at most" in shown
        assert len(vera.get("/admin/files/captures/d").text) < 100_000


def test_what_a_job_made_is_shown_and_cannot_run_scripts(own_server: str, own: Settings, tmp_path: Path) -> None:
    files = {
        "report.html": b"<script>alert(1)</script>",
        "ball/pm_fa.mp4": FILM,
        "ball/pm_fa.mask.mp4": FILM,
        "meshes/pm_fa/0000.ply": PLY,
        "measures.csv": MEASURES,
        "curve.svg": b"<svg/>",
    }
    put(own.intake_dir / "runs" / "r", files)
    (own.intake_dir / "runs" / "r" / "link.csv").symlink_to(put(tmp_path, {"secret": b"s"}) / "secret")
    with signed_in(own_server, own, "Vera", "viewer") as vera:
        shown = vera.get("/admin/files/runs/r").text
        assert '<iframe class="report" src="/admin/files/runs/r/file/report.html"' in shown
        assert '"condition": "pm_fa", "dataset": "0000"' in shown
        assert 'src="/admin/files/runs/r/file/ball/pm_fa.mp4"' in shown
        assert 'src="/admin/files/runs/r/file/ball/pm_fa.mask.mp4"' not in shown
        for place in ("report.html", "curve.svg"):
            policy = vera.get(f"/admin/files/runs/r/file/{place}").headers["content-security-policy"]
            assert "sandbox" in policy
            assert "allow-scripts" not in policy
        assert "attachment" in vera.get("/admin/files/runs/r/file/measures.csv").headers["content-disposition"]
        ranged = vera.get("/admin/files/runs/r/file/ball/pm_fa.mp4", headers={"Range": "bytes=4-7"})
        assert ranged.content == b"ftyp"
        for place in ("link.csv", "../../../study.sqlite", "..%2f..%2f..%2fstudy.sqlite", ".hidden", "nothing"):
            assert vera.get(f"/admin/files/runs/r/file/{place}").status_code in (404, 303, 200), place
            assert b"SQLite" not in vera.get(f"/admin/files/runs/r/file/{place}").content


def test_an_entry_is_deleted_when_its_name_is_typed(own_server: str, own: Settings) -> None:
    put(own.intake_dir / "runs" / "r", {"run.json": b"{}"})
    with signed_in(own_server, own, "Eva") as eva:
        job = eva.act("/admin/work/new/render", sources="runs/r", name="films").url.path
        assert f'href="{job}"' in eva.get("/admin/files/runs/r").text
        assert "A job works on r now: Render films" in eva.act("/admin/files/runs/r/delete", again="r").text
        eva.act(f"{job}/cancel")
        assert "type r to delete" in eva.act("/admin/files/runs/r/delete", again="x").text
        assert (own.intake_dir / "runs" / "r").is_dir()
        assert eva.act("/admin/files/runs/r/delete", again="r").url.path == "/admin/files"
        assert eva.get("/admin/files/runs/r").status_code == 404
        assert "runs/r" in eva.get("/admin/audit?search=file+deleted").text
    assert not [path for path in own.intake_dir.rglob("*") if path.is_file()]


def test_an_entry_that_the_server_may_not_read_spoils_no_page(
    own_server: str, own: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    def may(path: Any, *mode: Any, **more: Any) -> bool:
        return Path(path).name != "closed" and whole(path, *mode, **more)

    whole = os.access
    for name in ("closed", "ball"):
        put(own.intake_dir / "captures" / name, capture())
    with signed_in(own_server, own, "Eva") as eva:
        monkeypatch.setattr(os, "access", may)
        shown = eva.get("/admin/files")
        assert shown.status_code == 200
        assert "captures/closed" in shown.text
        assert "cannot be read" in shown.text
        form = eva.get("/admin/work/new/check")
        assert form.status_code == 200
        assert "ball</option>" in form.text
        assert "closed" not in form.text
        for answer in (
            eva.get("/admin/files/captures/closed"),
            eva.act("/admin/files/captures/closed/delete", again="closed"),
        ):
            assert answer.status_code == 403
            assert "cannot be read" in answer.text


def test_a_file_or_a_whole_shelf_that_the_server_may_not_read_is_named(
    own_server: str, own: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    def may(path: Any, *mode: Any, **more: Any) -> bool:
        return Path(path).name not in {"calibration", "left"} and whole(path, *mode, **more)

    whole = os.access
    put(own.intake_dir / "captures" / "ball", capture())
    put(own.intake_dir / "calibration" / "board", {"left.png": PNG})
    with signed_in(own_server, own, "Eva") as eva:
        monkeypatch.setattr(os, "access", may)
        shown = eva.get("/admin/files")
        assert shown.status_code == 200
        assert "captures/ball" in shown.text
        assert "folder calibration cannot be read: give the server&#39;s user access to it." in shown.text
        assert eva.get("/admin/work/new/calibrate").status_code == 200
        for place in (
            "captures/ball/file/S1/left/0000.png",
            "captures/ball/pictures/S1/left/0.jpg",
            "calibration/board",
            "calibration/board/file/left.png",
        ):
            answer = eva.get(f"/admin/files/{place}")
            assert answer.status_code == 403
            assert "cannot be read: give the server&#39;s user access to it." in answer.text
        assert "cannot be read" in begin(eva, "calibration", "other", PNG).json()["detail"]
        assert eva.get("/admin/files/captures/ball/file/S1/right/0000.png").status_code == 200
        assert eva.get(f"/admin/files/captures/ball/file/{'x' * 300}").status_code == 404


def test_strokes_are_kept_picture_by_picture(own_server: str, own: Settings) -> None:
    folder = put(own.intake_dir / "captures" / "c", capture())
    line = {"label": "foreground", "points": [[0, 0.2]], "width": 3}
    base = "/admin/files/captures/c/strokes"
    with signed_in(own_server, own, "Eva") as eva:
        token = {"X-CSRF-Token": eva.form_token, "Accept": "application/json"}
        for place in ("S1/left/1", "S1/right/0"):
            assert eva.put(f"{base}/{place}", json={"strokes": [line]}, headers=token).status_code == 204
        assert '"side": "right"' in eva.get(base).text
        eva.put(f"{base}/S1/right/0", json={"strokes": []}, headers=token)
        outside = {**line, "points": [[0, 1]]}
        for place, lines, status in (("S1/left/0", [outside], 422), ("S1/left/2", [], 404), ("S2/left/0", [], 404)):
            assert eva.put(f"{base}/{place}", json={"strokes": lines}, headers=token).status_code == status
        kept = json.loads((folder / "strokes.json").read_text())["strokes"]
        assert kept == [{**line, "points": [[0, 0.2]], "sensor": "S1", "side": "left", "frame": 1}]
        (folder / "strokes.json").write_text('{"strokes": [{}]}')
        assert "Correct the file or delete it" in eva.get(base).text


def test_a_table_of_measures_is_attached_to_a_study(own_server: str, own: Settings, stimulus_set: Path) -> None:
    slug = create.create_study(own, stimulus_set, "With measures")["slug"]
    put(own.intake_dir / "measures", {"m.csv": MEASURES, "foreign.csv": MEASURES.replace(b"ball", b"nowhere")})
    with signed_in(own_server, own, "Eva") as eva:
        assert f'<option value="{slug}">' in eva.get("/admin/files/measures/m.csv").text
        shown = ends(eva, eva.act("/admin/files/measures/m.csv/attach", study=slug).url.path)
        assert shown.url.path == f"/admin/studies/{slug}/objective"
        assert "31.5" in shown.text
        refused = ends(eva, eva.act("/admin/files/measures/foreign.csv/attach", study=slug).url.path).text
        assert "foreign.csv" in refused
        assert str(own.intake_dir) not in refused
