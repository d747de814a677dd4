"""Models attached to a study: what is taken, who gets them, and how they are served."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from app.intake.models import read_model, read_models
from app.operations.studies import manage
from app.settings import Settings
from recon.geometry.mesh_files import write_mesh
from tests.app.web.admin import small_models
from tests.app.web.admin.dashboard_client import Dashboard, signed_in

pytestmark = pytest.mark.slow

HEADER = "ply\nformat binary_little_endian 1.0\nelement vertex 3\n{points}element face 1\n{faces}end_header\n"
FLOATS = "property float x\nproperty float y\nproperty float z\n"
LIST = "property list uchar int vertex_indices\n"
TRIANGLE = np.eye(3, dtype="<f4").tobytes()
FACE = b"\x03" + np.array([0, 1, 2], "<i4").tobytes()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_models.write_folder(tmp_path_factory.mktemp("models"))


@pytest.fixture(scope="module")
def shown(settings: Settings, new_study: Callable[[], dict[str, Any]], folder: Path) -> str:
    """The address of the models of a study that has some."""
    study = new_study()
    found = manage.attach_results(settings, [folder], study["slug"])
    assert (found["models"], found["n_values"], found["ignored"]) == (4, 0, [])
    return f"/admin/studies/{study['slug']}/models"


def test_a_model_is_what_its_file_holds(folder: Path) -> None:
    mesh = read_model(folder / "meshes/ball/pm_fb.ply", "mesh")
    cloud = read_model(folder / "clouds/ball/pm_fb.ply", "cloud")
    assert (mesh.dataset, mesh.condition, mesh.n_points, mesh.n_faces) == ("ball", "pm_fb", 4, 4)
    assert mesh.error_limit_mm == 4.0
    assert (cloud.n_points, cloud.n_faces, cloud.error_limit_mm) == (4, 0, None)


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"<!doctype html><script>alert(1)</script>", "no binary little-endian PLY"),
        (b"ply\nformat ascii 1.0\nend_header\n", "no binary little-endian PLY"),
        (b"ply\nformat binary_little_endian 1.0\n" + b"comment x\n" * 2000, "no binary little-endian PLY"),
        (
            HEADER.format(points=FLOATS, faces=LIST).encode() + TRIANGLE,
            "no whole PLY .* bytes, its header promises",
        ),
        (
            HEADER.format(points=FLOATS, faces=LIST).encode() + TRIANGLE + FACE + b"more",
            "goes on after its last element",
        ),
        (HEADER.format(points="", faces=LIST).encode() + FACE, "holds no points with x, y and z"),
        (
            HEADER.format(points=FLOATS, faces="property int colour\n").encode() + TRIANGLE + FACE[1:5],
            "'property int colour'",
        ),
        (HEADER.format(points=FLOATS, faces=LIST).encode() + TRIANGLE[:-4] + b"\0\0\xc0\x7f" + FACE, "not finite"),
        (HEADER.format(points=FLOATS, faces=LIST).encode() + TRIANGLE + b"\x03" + b"\xff" * 12, "no triangles"),
        (
            HEADER.format(points=FLOATS, faces=LIST).encode() + TRIANGLE + b"\x04" + FACE[1:],
            "face 0 has 4 corners, expected 3",
        ),
        (
            HEADER.replace("vertex 3", "vertex 99999999999").format(points=FLOATS, faces=LIST).encode(),
            "its header promises 1200000000180",
        ),
        (
            HEADER.format(points=FLOATS + LIST, faces=LIST).encode() + (TRIANGLE[:12] + FACE) * 3 + FACE,
            "'property list",
        ),
        (HEADER.format(points=FLOATS, faces=LIST.replace("uchar", "uint")).encode(), "'property list uint int vert"),
        (
            HEADER.replace("vertex 3", f"vertex {10**20}").format(points=FLOATS, faces=LIST).encode(),
            "'element vertex 1",
        ),
        (HEADER.format(points=FLOATS, faces="").encode() + TRIANGLE, "holds no faces"),
        (HEADER.replace("face 1", "edge 1").format(points=FLOATS, faces="").encode() + TRIANGLE, "'element edge 1'"),
    ],
)
def test_what_is_no_model_is_refused(tmp_path: Path, content: bytes, complaint: str) -> None:
    path = tmp_path / "meshes" / "ball" / "id_fa.ply"
    path.parent.mkdir(parents=True)
    path.write_bytes(content)
    with pytest.raises(ValueError, match=complaint) as refused:
        read_models(tmp_path)
    assert str(path) in str(refused.value)


def test_a_triangle_by_hand_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "id_fa.ply"
    path.write_bytes(HEADER.format(points=FLOATS, faces=LIST).encode() + TRIANGLE + FACE)
    assert (read_model(path, "mesh").n_points, read_model(path, "mesh").n_faces) == (3, 1)


def test_splats_have_a_folder_and_what_has_no_properties_of_theirs_is_refused(tmp_path: Path) -> None:
    (splats,) = read_models(small_models.write_splats(tmp_path))
    assert (splats.kind, splats.n_points, splats.n_faces) == ("splat", 200, 0)
    splats.path.write_bytes(HEADER.format(points=FLOATS, faces="").replace("face 1", "face 0").encode() + TRIANGLE)
    with pytest.raises(ValueError, match=r"no splats: they lack f_dc_0, .*scale_1"):
        read_models(tmp_path)


def test_what_the_study_does_not_compare_is_named_and_left_out(
    settings: Settings, new_study: Callable[[], dict[str, Any]], tmp_path: Path
) -> None:
    study = new_study()
    with pytest.raises(
        ValueError, match=r"describes statue/id_fa, statue/pm_fb.* compares id_fa, id_fb, pm_fb in ball"
    ):
        manage.attach_results(settings, [small_models.write_folder(tmp_path / "other", "statue")], study["slug"])
    small_models.write_folder(tmp_path / "both")
    small_models.write_plain(tmp_path / "both", "statue")
    found = manage.attach_results(settings, [tmp_path / "both"], study["slug"])
    assert (found["models"], found["ignored"]) == (4, ["statue/id_fa"])
    (tmp_path / "empty" / "meshes").mkdir(parents=True)
    with pytest.raises(ValueError, match=r"holds no meshes/DATASET/CONDITION\.ply"):
        manage.attach_results(settings, [tmp_path / "empty"], study["slug"])


def test_attaching_again_replaces_a_model(
    experimenter: Dashboard, settings: Settings, new_study: Callable[[], dict[str, Any]], tmp_path: Path
) -> None:
    study = new_study()
    page = f"/admin/studies/{study['slug']}/models"
    assert "No models are attached" in experimenter.get(page).text
    manage.attach_results(settings, [small_models.write_plain(tmp_path)], study["slug"])
    before = address(experimenter, page)
    write_mesh(tmp_path / "meshes/ball/id_fa.ply", small_models.tent())
    manage.attach_results(settings, [tmp_path], study["slug"])
    after = address(experimenter, page)
    assert before != after
    assert experimenter.get(before).status_code == 404
    assert "results attached" in experimenter.get("/admin/audit?search=attached").text


def address(dashboard: Dashboard, page: str) -> str:
    """Of the first model on a page."""
    return str(re.findall(r'<a href="([^"]+[.]ply)"', dashboard.get(page).text)[-1])


def test_a_model_is_served_whole_in_part_and_only_when_it_is_not_known(
    experimenter: Dashboard, shown: str, folder: Path
) -> None:
    url = address(experimenter, shown)
    whole = experimenter.get(url)
    assert whole.content == (folder / "clouds/ball/pm_fb.ply").read_bytes()
    assert "immutable" in whole.headers["cache-control"]
    part = experimenter.get(url, headers={"Range": "bytes=4-9"})
    assert (part.status_code, part.content) == (206, whole.content[4:10])
    assert experimenter.get(url, headers={"If-None-Match": whole.headers["etag"]}).status_code == 304


def test_files_that_people_brought_are_shown_in_a_sandbox(
    experimenter: Dashboard, settings: Settings, shown: str, tmp_path: Path
) -> None:
    row = {"dataset": "ball", "approach": "id_fa", "measure": "accuracy_90", "value": 1.5, "unit": "mm"}
    content = {"kind": "mesh", "measures": [{**row, "direction": "less is better"}]}
    (tmp_path / "report.json").write_text(json.dumps(content), encoding="utf-8")
    (tmp_path / "curve.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg"><script>alert(1)</script></svg>')
    study = shown.removesuffix("/models")
    manage.attach_results(settings, [tmp_path], study.rpartition("/")[2])
    figure = re.findall(r'"([^"]+/curve\.svg)', experimenter.get(f"{study}/objective").text)[0]
    for path in (address(experimenter, shown), figure):
        answer = experimenter.get(path)
        assert answer.status_code == 200, path
        assert answer.headers["content-security-policy"].startswith("sandbox "), path


def test_models_are_for_experimenters_of_their_study_only(
    server: str,
    settings: Settings,
    experimenter: Dashboard,
    participant: httpx.Client,
    study: dict[str, Any],
    shown: str,
) -> None:
    url = address(experimenter, shown)
    assert participant.get(url).status_code == participant.get(shown).status_code == 401
    with signed_in(server, settings, "Vito", "viewer") as viewer:
        assert viewer.get(url).status_code == viewer.get(shown).status_code == 403
    elsewhere = url.replace(shown, f"/admin/studies/{study['slug']}/models")
    for wrong in (elsewhere, f"{shown}/{'0' * 64}.ply", f"{shown}/..%2f..%2fstudy.sqlite.ply"):
        assert experimenter.get(wrong).status_code == 404, wrong
