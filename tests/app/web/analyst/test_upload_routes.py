"""Films, results and whole studies are sent over REST as on the dashboard."""

from __future__ import annotations

import io
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import httpx
import pytest

from app.main import running_server
from app.operations.studies import create, manage
from app.settings import Settings
from app.store.access.rights import SCOPES
from tests.app.web.admin.dashboard_client import ends, files_of, signed_in, zipped
from tests.app.web.http_checks import is_problem

pytestmark = pytest.mark.slow
MEASURES = b"dataset,approach,measure,value,better\nball,id_fa,psnr_y,31.5,higher\nball,pm_fb,psnr_y,33,higher\n"


@pytest.fixture(scope="module")
def sent(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    return Settings(data_dir=tmp_path_factory.mktemp("sent"), largest_upload_mb=8)


@pytest.fixture(scope="module")
def manager(sent: Settings) -> Iterator[httpx.Client]:
    """A program that may do everything, on a server that begins empty."""
    with running_server(sent) as url:
        token = manage.add_token(sent, "everything", list(SCOPES))["token"]
        headers = {"Authorization": f"Bearer {token}"}
        with httpx.Client(base_url=f"{url}/api/v1/", headers=headers, timeout=120) as client:
            yield client


@pytest.fixture(scope="module")
def uploaded(manager: httpx.Client, stimulus_set: Path) -> str:
    """The name of a set that came over REST."""
    answer = manager.post("sets", content=zipped(files_of(stimulus_set.parent)))
    assert answer.status_code == 200, answer.text
    return str(answer.json()["stimulus_set"])


@pytest.fixture(scope="module")
def study(manager: httpx.Client, uploaded: str) -> str:
    made = manager.post("studies", json={"name": "Sent", "stimulus_set": uploaded, "exposure_s": 0.4})
    return str(made.raise_for_status().json()["slug"])


def test_a_set_is_sent_listed_checked_and_named(manager: httpx.Client, uploaded: str) -> None:
    (row,) = manager.get("sets").json()
    assert (row["name"], row["n_films"], row["is_here"]) == (uploaded, 6, True)
    whole = manager.get(f"sets/{uploaded}").json()
    assert len(whole["stimuli"]) == 6
    assert manager.post(f"sets/{uploaded}/check").json()["stimulus_set"] == uploaded
    levels = {name: {"look": name} for name in row["conditions"]}
    assert manager.patch(f"sets/{uploaded}", json={"name": "By post", "levels": levels}).status_code == 204
    assert manager.get(f"sets/{uploaded}").json().items() >= {"title": "By post", "levels": levels}.items()
    for wrong in ({"name": "Half", "levels": {"nobody": {}}}, {"name": " ", "levels": levels}):
        assert is_problem(manager.patch(f"sets/{uploaded}", json=wrong), 422)
        assert manager.get(f"sets/{uploaded}").json()["title"] == "By post", "nothing was changed"
    assert is_problem(manager.get("sets/no-such"), 404)


def test_a_set_of_a_study_stays_and_another_goes(
    manager: httpx.Client, sent: Settings, uploaded: str, study: str
) -> None:
    assert study
    assert is_problem(manager.delete(f"sets/{uploaded}"), 409)
    shutil.copytree(sent.sets_dir / uploaded, sent.sets_dir / "spare")
    manifest = sent.sets_dir / "spare" / "manifest.json"
    manifest.write_text(manifest.read_text().replace("By post", "Spare").replace('"tiny"', '"Spare"'))
    assert manager.delete("sets/spare").status_code == 204
    assert not (sent.sets_dir / "spare").exists()


def test_a_damaged_set_is_refused_with_its_fault(manager: httpx.Client, sent: Settings, uploaded: str) -> None:
    shutil.copytree(sent.sets_dir / uploaded, sent.sets_dir / "torn")
    film = next((sent.sets_dir / "torn").rglob("*.mp4"))
    film.write_bytes(film.read_bytes()[:-100])
    answer = manager.post("sets/torn/check")
    assert is_problem(answer, 422)
    assert film.name in answer.json()["detail"]
    assert str(sent.sets_dir) not in answer.text
    shutil.rmtree(sent.sets_dir / "torn")


def test_measures_are_attached_over_rest(manager: httpx.Client, study: str) -> None:
    answer = manager.post(f"studies/{study}/results", content=MEASURES, headers={"Content-Type": "text/csv"})
    assert (answer.status_code, answer.json()["study"]) == (200, study)
    assert {row["value"] for row in manager.get(f"studies/{study}/validation").json()} == {31.5, 33.0}
    wrong = manager.post(f"studies/{study}/results", content=b"dataset,approach\n")
    assert is_problem(wrong, 422)
    assert "Nothing was attached" in wrong.json()["detail"]


def test_a_studys_films_are_checked_over_rest(manager: httpx.Client, study: str) -> None:
    assert manager.post(f"studies/{study}/check?wait_s=100").json()["study"] == study
    found = manager.get(f"studies/{study}/check").json()
    assert (found["n_films"] >= 6, found["faults"]) == (True, {})


def test_a_whole_study_goes_out_and_comes_in_again(manager: httpx.Client, study: str) -> None:
    packed = manager.get(f"studies/{study}/export")
    assert packed.headers["content-disposition"] == f'attachment; filename="{study}-whole.zip"'
    with ZipFile(io.BytesIO(packed.content)) as archive:
        assert archive.testzip() is None
    taken = manager.post("studies/import", content=packed.content)
    assert is_problem(taken, 422)
    assert "already a study" in taken.json()["detail"]
    came = manager.post("studies/import?name=Come%20in", content=packed.content)
    assert (came.status_code, came.json()["study"]) == (200, "come-in")
    assert manager.get("studies/come-in").json()["state"] == "paused"
    assert is_problem(manager.post("studies/import", content=b"no zip"), 422)


def test_a_large_body_of_another_kind_is_not_read_into_memory(manager: httpx.Client, study: str) -> None:
    """A file's address takes more than a form does: what is sent there as JSON goes to the disk, and has its limit."""
    large = manager.post("sets", content=b"[" * 9 * 2**20, headers={"Content-Type": "application/json"})
    assert is_problem(large, 413)
    for path in ("votes", "studies/import", f"studies/{study}/results"):
        assert is_problem(manager.post(path, content=iter([b"0" * 2**20] * 9)), 413), path
    assert is_problem(manager.patch(f"studies/{study}", content=b"[" * 9 * 2**20), 413)


def test_a_study_goes_out_and_comes_in_on_the_dashboard(manager: httpx.Client, sent: Settings, study: str) -> None:
    with signed_in(str(manager.base_url).removesuffix("/api/v1/"), sent, "Eva", "experimenter") as eva:
        assert f"/api/v1/studies/{study}/export" in eva.get(f"/admin/studies/{study}").text
        packed = eva.get(f"/api/v1/studies/{study}/export").content
        assert 'data-to="/admin/studies/import"' in eva.get("/admin").text
        headers = {"X-CSRF-Token": eva.form_token}
        taken_in = eva.put("/admin/studies/import?name=By+hand", content=packed, headers=headers)
        assert ends(eva, taken_in.json()["task"]).url.path == "/admin/studies/by-hand"
        assert "study imported" in eva.get("/api/v1/studies/by-hand/audit?format=csv").text


def test_outside_ids_in_a_whole_study_take_the_scope_that_gives_out_codes(
    manager: httpx.Client, sent: Settings, study: str
) -> None:
    assert manager.get(f"studies/{study}/export?outside_ids=true").status_code == 200
    token = manage.add_token(sent, "reader", ["read", "personal"])["token"]
    answer = manager.get(f"studies/{study}/export?outside_ids=true", headers={"Authorization": f"Bearer {token}"})
    assert is_problem(answer, 403)


def test_an_export_without_a_film_says_which_is_missing(
    manager: httpx.Client, sent: Settings, stimulus_set: Path
) -> None:
    made = create.create_study(sent, stimulus_set, "Torn", exposure_s=0.5)
    films = list(sent.media_dir.glob("*.mp4"))
    kept = {film: film.read_bytes() for film in films}
    for film in films:
        film.unlink()
    answer = manager.get(f"studies/{made['slug']}/export")
    assert is_problem(answer, 409)
    assert "is missing" in answer.json()["detail"]
    assert str(sent.data_dir) not in answer.text
    for film, content in kept.items():
        film.write_bytes(content)


def test_a_refused_method_names_those_that_are_allowed(manager: httpx.Client, study: str) -> None:
    answer: Any = manager.put(f"studies/{study}")
    assert is_problem(answer, 405)
    assert answer.headers["allow"] == "GET, HEAD, PATCH, DELETE"
    assert "it takes GET and HEAD and PATCH and DELETE" in answer.json()["detail"]


def test_votes_from_elsewhere_are_refused_by_a_study_which_says_why_and_the_way(
    manager: httpx.Client, study: str
) -> None:
    answer = manager.post(f"studies/{study}/votes", content=b"participant,item_a,item_b,choice\np,x,y,a\n")
    assert answer.status_code == 409
    assert "its own participants only" in answer.json()["detail"]
    assert "analyse both files together" in answer.json()["detail"]


def test_a_file_is_sent_to_a_shelf_in_parts_fetched_attached_and_deleted(manager: httpx.Client, study: str) -> None:
    wanted = {"kind": "measures", "name": "psnr.csv", "file": "psnr.csv", "size": len(MEASURES)}
    begun = manager.post("uploads", json=wanted)
    assert (begun.status_code, begun.json()["offset"]) == (201, 0)
    upload = begun.json()["upload"].removeprefix("/api/v1/")
    part = manager.patch(upload, content=MEASURES[:20], headers={"Upload-Offset": "0"})
    assert (part.status_code, part.json()["offset"]) == (200, 20)
    again = manager.post("uploads", json=wanted)
    assert (again.status_code, again.json()) == (
        200,
        {"upload": f"/api/v1/{upload}", "offset": 20, "size": len(MEASURES)},
    )
    assert is_problem(manager.patch(upload, content=MEASURES, headers={"Upload-Offset": "0"}), 409)
    done = manager.patch(upload, content=MEASURES[20:], headers={"Upload-Offset": "20"})
    assert (done.status_code, done.json()["state"], done.json()["file"]) == (202, "done", "measures/psnr.csv")

    (row,) = manager.get("files").json()
    assert (row["kind"], row["name"], row["size"]) == ("measures", "psnr.csv", len(MEASURES))
    assert manager.get("files/measures/psnr.csv").json()["kind"] == "measures"
    attached = manager.post("files/measures/psnr.csv/attach", json={"study": study})
    assert (attached.status_code, attached.json()["study"]) == (200, study)
    assert {each["value"] for each in manager.get(f"studies/{study}/validation").json()} == {31.5, 33.0}
    assert is_problem(manager.post("files/measures/psnr.csv/attach", json={"study": "no-such"}), 404)
    assert manager.delete("files/measures/psnr.csv").status_code == 204
    assert is_problem(manager.get("files/measures/psnr.csv"), 404)
    assert is_problem(manager.post("uploads", json={**wanted, "kind": "nowhere"}), 422)


def test_what_does_not_belong_to_a_shelf_is_refused_over_rest_and_an_upload_is_discarded(
    manager: httpx.Client,
) -> None:
    films = zipped({"ball/capture.txt": b"no film", "ball/notes/readme.txt": b"hello"})
    wanted = {"kind": "films", "name": "street", "file": "street.zip", "size": len(films)}
    upload = manager.post("uploads", json=wanted).json()["upload"].removeprefix("/api/v1/")
    refused = manager.patch(upload, content=films, headers={"Upload-Offset": "0"})
    assert is_problem(refused, 422)
    assert "There is no film in the upload" in refused.json()["detail"]
    upload = manager.post("uploads", json={**wanted, "size": 5}).json()["upload"].removeprefix("/api/v1/")
    assert manager.delete(upload).status_code == 204
    assert is_problem(manager.get(upload), 404)


def test_a_file_of_an_entry_is_fetched_over_rest(manager: httpx.Client, sent: Settings) -> None:
    place = sent.intake_dir / "runs" / "ball" / "clouds"
    place.mkdir(parents=True)
    (place / "log.txt").write_bytes(b"done")
    assert manager.get("files/runs/ball").json()["files"] == {"clouds/log.txt": 4}
    assert manager.get("files/runs/ball/clouds/log.txt").content == b"done"
    assert is_problem(manager.get("files/runs/ball/clouds/none.txt"), 404)
    assert is_problem(manager.get("files/runs/ball/%2e%2e/%2e%2e/secret"), 404)
