"""Reconstruction and rendering on input that is wrong or thin, through the command line."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from recon.capture import format as capture_format
from recon.capture.masks.segment import segment_capture
from recon.depth.disparity_io import read_disparity
from recon.geometry.mesh import Cloud
from recon.geometry.mesh_files import read_mesh, write_cloud, write_no_cloud
from recon.runtime.files import alone_in, read_json, write_json
from recon.studio import SynthParameters, synthesise
from tests.command_line import Command

NO_EGL = {"PYOPENGL_PLATFORM": "egl", "__EGL_VENDOR_LIBRARY_FILENAMES": "/nowhere.json"}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three frames of two sensors with masks."""
    folder = tmp_path_factory.mktemp("recorded") / "ball"
    synthesise(folder, SynthParameters(scene="ball", n_sensors=2, n_frames=3, size=(160, 120), noise=0.5))
    segment_capture(folder)
    return folder


@pytest.fixture
def capture(recorded: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(recorded, tmp_path / "capture"))


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A folder on a disk of its own with room for 200 kB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=200k", "none", str(folder)], capture_output=True)
    if mounted.returncode != 0:
        pytest.skip("mounting a small disk needs root")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def empty_mask(capture: Path, sensor: str, frame: int) -> None:
    path = capture / sensor / f"mask/left/{frame:04d}.png"
    cv2.imwrite(str(path), np.zeros_like(cv2.imread(str(path))))


def flat_cloud(side: int = 40) -> Cloud:
    x, y = np.meshgrid(np.arange(float(side)), np.arange(float(side)))
    points = np.stack([x.ravel(), y.ravel(), np.full(x.size, 7.0)], axis=1)
    return Cloud(points, np.tile([0.0, 0, 1], (x.size, 1)), np.full((x.size, 3), 60, np.uint8))


def half_written(folder: Path) -> list[Path]:
    return list(folder.rglob(".*.part*"))


@pytest.mark.slow
def test_a_sensor_that_sees_nothing_in_a_frame_is_left_out_of_it(command: Command, capture: Path) -> None:
    empty_mask(capture, "S2", 1)
    run = capture.parent / "run"
    expected = ["id: sensor S2 sees nothing in frame 1: its mask is empty"]
    for _ in range(2):  # made, and found finished
        told = command("reconstruct", capture, "-o", run, "--depth", "id", "--fill", "0", "--json")
        assert told.code == 0, told.err
        assert json.loads(told.out)["warnings"] == expected
        assert f"warning: {expected[0]}" in told.err
    assert json.loads((run / "run.json").read_text())["warnings"] == expected
    logged = [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]
    assert [event["warnings"] for event in logged if "warnings" in event] == [expected]
    of_one, fused = (read_mesh(run / f"meshes/id_{fusion}/0001.ply") for fusion in ("fa", "fb"))
    assert np.array_equal(of_one.vertices, fused.vertices)
    told = command("render", run, "-o", run / "set", "--size", "64x48", "--seconds", 0.2, "--renderer", "software")
    assert told.code == 0, told.err


@pytest.mark.slow
def test_a_frame_that_no_sensor_sees_is_named_and_can_be_left_out(command: Command, capture: Path) -> None:
    empty_mask(capture, "S1", 2)
    empty_mask(capture, "S2", 2)
    run = capture.parent / "run"
    told = command("reconstruct", capture, "-o", run, "--depth", "id")
    assert told.code == 1
    assert "no sensor sees anything in frame 2 (depth method id)" in told.err
    assert not (run / "run.json").exists()
    assert not half_written(run)
    told = command("reconstruct", capture, "-o", run, "--depth", "id", "--frames", "0:2")
    assert told.code == 0, told.err


@pytest.mark.slow
def test_the_filter_remembers_nothing_across_a_frame_without_foreground(command: Command, capture: Path) -> None:
    empty_mask(capture, "S2", 1)
    run = capture.parent / "run"
    command("reconstruct", capture, "-o", run, "--depth", "id")
    assert np.isnan(read_disparity(run / "depth/id/S2/0001.tiff")).all()
    matched, filtered = (read_disparity(run / name) for name in ("matched/id/S2/0002.tiff", "depth/id/S2/0002.tiff"))
    assert np.array_equal(matched, filtered, equal_nan=True)


def test_a_voxel_of_more_samples_than_can_be_numbered_is_refused(command: Command, tmp_path: Path) -> None:
    cloud = write_cloud(tmp_path / "flat.ply", flat_cloud(6))
    told = command("fuse", cloud, "-o", tmp_path / "mesh.ply", "--voxel", 1e-9)
    assert told.code == 1
    assert "more samples than can be numbered" in told.err
    assert not (tmp_path / "mesh.ply").exists()


def one_point() -> Cloud:
    return flat_cloud(1)


def one_place() -> Cloud:
    return flat_cloud(6).select(np.zeros(50, int))


@pytest.mark.parametrize("fusion", ["fa", "fb"])
def test_too_little_for_a_surface_is_refused(command: Command, tmp_path: Path, fusion: str) -> None:
    out = ("-o", tmp_path / "mesh.ply", "--fusion", fusion)
    lonely, heap = write_cloud(tmp_path / "1.ply", one_point()), write_cloud(tmp_path / "50.ply", one_place())
    assert "the cloud has 1 points: a surface needs at least 3" in command("fuse", lonely, *out, "--voxel", 1).err
    assert "1 points in one place have no spacing" in command("fuse", lonely, *out).err
    assert "50 points in one place have no spacing" in command("fuse", heap, *out).err
    assert not (tmp_path / "mesh.ply").exists()


@pytest.mark.slow
def test_a_file_that_is_read_is_not_overwritten_by_what_is_made_of_it(command: Command, tmp_path: Path) -> None:
    cloud, mesh = write_cloud(tmp_path / "cloud.ply", flat_cloud()), tmp_path / "mesh.ply"
    assert command("fuse", cloud, "-o", mesh).code == 0
    (tmp_path / "link.ply").symlink_to(cloud)
    before = [path.read_bytes() for path in (cloud, mesh)]
    for out, *arguments in (
        (tmp_path / "link.ply", "fuse", cloud, "-o", tmp_path / "link.ply"),
        (mesh, "export", tmp_path / "mesh.ply", mesh),
        (mesh, "export", cloud, mesh, "--truth", mesh),
    ):
        told = command(*arguments)
        assert (told.code, f"{out}: is one of the files that are read; choose another name" in told.err) == (1, True)
    assert [path.read_bytes() for path in (cloud, mesh)] == before


def test_a_kind_of_file_that_no_surface_is_written_as_is_refused_before_it_is_made(
    command: Command, tmp_path: Path
) -> None:
    cloud = write_cloud(tmp_path / "cloud.ply", flat_cloud())
    told = command("fuse", cloud, "-o", tmp_path / "mesh.stl", "--voxel", 1e-12)
    assert told.code == 1
    assert f"{tmp_path / 'mesh.stl'}: unknown kind of file, expected a name that ends in .ply or .glb" in told.err


def test_a_cloud_without_points_or_with_points_that_are_no_numbers_is_named(command: Command, tmp_path: Path) -> None:
    empty = write_no_cloud(tmp_path / "empty.ply")
    told = command("fuse", empty, "-o", tmp_path / "mesh.ply")
    assert (told.code, f"{empty}: holds no points" in told.err) == (1, True)
    odd = write_cloud(tmp_path / "odd.ply", flat_cloud())
    content = bytearray(odd.read_bytes())
    start = content.index(b"end_header\n") + len(b"end_header\n")
    content[start : start + 4] = np.float32("nan").tobytes()
    odd.write_bytes(content)
    told = command("fuse", odd, "-o", tmp_path / "mesh.ply")
    assert told.code == 1
    assert f"{odd}: points hold values that are not finite numbers: row 0 is" in told.err


def test_a_cloud_that_single_precision_blurs_where_it_stands_is_refused(command: Command, tmp_path: Path) -> None:
    cloud = flat_cloud()
    far = write_cloud(tmp_path / "far.ply", replace(cloud, points=cloud.points + np.float32(5e8)))
    told = command("fuse", far, "-o", tmp_path / "mesh.ply")
    assert told.code == 1
    assert f"{far}: its points, " in told.err
    assert "move them near the origin" in told.err


def test_points_in_a_plane_are_a_surface(command: Command, tmp_path: Path) -> None:
    told = command("fuse", write_cloud(tmp_path / "flat.ply", flat_cloud()), "-o", tmp_path / "mesh.ply", "--json")
    assert told.code == 0, told.err
    assert json.loads(told.out)["faces"] > 100
    assert np.ptp(read_mesh(tmp_path / "mesh.ply").vertices[:, 2]) < 1e-3


@pytest.mark.slow
def test_a_full_disk_is_named_and_nothing_is_half_written(command: Command, capture: Path, small_disk: Path) -> None:
    run = small_disk / "run"
    for _ in range(2):
        told = command("reconstruct", capture, "-o", run, "--depth", "id")
        assert told.code == 1
        assert "the disk is full" in told.err
        assert str(run) in told.err
        assert not half_written(run)
        assert not (run / "run.json").exists()
        for path in run.rglob("*.json"):
            json.loads(path.read_text())
        for line in (run / "log.jsonl").read_text().splitlines():
            json.loads(line)


@pytest.mark.slow
def test_a_capture_without_masks_is_pointed_out_before_the_work(
    command: Command, capture: Path, tmp_path: Path
) -> None:
    where = ("--depth", "id", "--fusion", "fb", "--frames", "0:1")
    assert "has no masks" not in command("reconstruct", capture, "-o", tmp_path / "run", *where).err
    described = json.loads((capture / "capture.json").read_text())
    for sensor in described["sensors"]:
        del sensor["mask"]
    (capture / "capture.json").write_text(json.dumps(described))
    told = command("reconstruct", capture, "-o", tmp_path / "other", *where)
    assert told.code == 0, told.err
    assert "has no masks: all that stands in its bounds" in told.err.splitlines()[0]


@pytest.mark.slow
def test_a_capture_is_read_once_for_a_run(
    command: Command, capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[Path] = []
    monkeypatch.setattr(capture_format, "read_json", lambda path: read.append(path) or read_json(path))
    where = ("--depth", "id", "--fusion", "fb", "--frames", "0:1")
    assert command("reconstruct", capture, "-o", tmp_path / "run", *where).code == 0
    assert read == [capture / "capture.json"]


TRIANGLE = """import sys
import numpy as np
import trimesh
points = np.concatenate([trimesh.load(path, process=False).vertices for path in sys.argv[2:]])
low, size = points.min(axis=0), np.ptp(points, axis=0) / 3
corners = [" ".join(map(str, low - size * offset)) for offset in ((0, 0, 0), (1, 0, 0), (0, 1, 0))]
head = ["ply", "format ascii 1.0", "element vertex 3", *(f"property float {axis}" for axis in "xyz")]
faces = ["element face 1", "property list uchar int vertex_indices", "end_header"]
open(sys.argv[1], "w").write("\\n".join([*head, *faces, *corners, "3 0 1 2", ""]))
"""


@pytest.mark.slow
def test_a_programs_mesh_outside_all_masks_is_named(command: Command, capture: Path, tmp_path: Path) -> None:
    (tmp_path / "fuse.py").write_text(TRIANGLE)
    methods = tmp_path / "methods.toml"
    methods.write_text(f"[fusion.mine]\ncommand = \"'{sys.executable}' fuse.py {{out}} {{clouds}}\"\noutput = 'ply'\n")
    arguments = ("--depth", "id", "--fusion", "mine", "--methods", methods, "--frames", "0:1")
    told = command("reconstruct", capture, "-o", tmp_path / "run", *arguments)
    assert told.code == 1
    assert "id_mine: frame 0 has no model: nothing of its surface lies inside the sensors' masks" in told.err


@pytest.mark.slow
def test_a_second_start_into_the_same_folder_is_refused_while_the_first_goes_on(
    command: Command, capture: Path, tmp_path: Path
) -> None:
    run, films = tmp_path / "run", tmp_path / "set"
    made = ("reconstruct", capture, "-o", run, "--depth", "id", "--fusion", "fb", "--frames", "0:1")
    filmed = ("render", run, "-o", films, "--size", "64x48", "--seconds", 0.1)
    with alone_in(run):
        told = command(*made)
    assert (told.code, run.exists()) == (1, False)
    assert f"{run}: another start is writing into it" in told.err
    assert command(*made).code == 0
    with alone_in(films):
        told = command(*filmed)
    assert (told.code, films.exists()) == (1, False)
    assert f"{films}: another start is writing into it" in told.err
    assert command(*filmed).code == 0


@pytest.mark.slow
def test_a_sensor_above_the_object_is_reconstructed_without_a_picture_of_it(command: Command, capture: Path) -> None:
    content = read_json(capture / "capture.json")
    bounds = np.array(content["bounds"])
    centre, reach = bounds.mean(axis=0), np.ptp(bounds, axis=0).max() / 2
    sensor = content["sensors"][0]
    towards = np.linalg.inv(sensor["left"]["cam_from_world"])[:3, 3] - centre
    old_from_new = np.eye(4)
    old_from_new[:3, :3] = Rotation.align_vectors([towards], [[0, 1, 0]])[0].as_matrix()
    old_from_new[:3, 3] = centre - old_from_new[:3, :3] @ centre
    for side in ("left", "right"):
        sensor[side]["cam_from_world"] = (np.array(sensor[side]["cam_from_world"]) @ old_from_new).tolist()
    content |= {"sensors": [sensor], "bounds": [(centre - reach).tolist(), (centre + reach).tolist()]}
    write_json(capture / "capture.json", content)
    run = capture.parent / "run"
    told = command("reconstruct", capture, "-o", run, "--depth", "id", "--fusion", "fb", "--frames", "0:1")
    assert (told.code, "warning: no preview was drawn: sensor S1 sees the centre of the bounds from" in told.err) == (
        0,
        True,
    ), told.err
    assert read_json(run / "run.json")["warnings"][-1].endswith("give the cameras of a file by --path")
    assert not (run / "previews").exists()


def test_a_run_into_its_own_capture_is_refused(command: Command, capture: Path) -> None:
    before = sorted(capture.rglob("*"))
    told = command("reconstruct", capture, "-o", capture, "--depth", "id", "--fusion", "fb", "--frames", "0:1")
    assert told.code == 1
    assert f"{capture}: is the capture itself; choose another folder for the run" in told.err
    assert sorted(capture.rglob("*")) == before


def test_films_into_the_folder_that_they_are_made_of_are_refused(command: Command, tmp_path: Path) -> None:
    (tmp_path / "scene.json").write_text("{}")
    told = command("render", tmp_path, "-o", tmp_path)
    assert told.code == 1
    assert f"{tmp_path}: is one of the folders that are filmed; choose another one for the stimulus set" in told.err
    assert [path.name for path in tmp_path.iterdir()] == ["scene.json"]


@pytest.mark.slow
def test_a_disk_that_fills_up_while_rendering_is_named(command: Command, capture: Path, small_disk: Path) -> None:
    run = capture.parent / "run"
    assert command("reconstruct", capture, "-o", run, "--depth", "id", "--fusion", "fb", "--frames", "0:1").code == 0
    told = command(
        "render", run, "-o", small_disk / "set", "--size", "320x240", "--seconds", 1, "--renderer", "software"
    )
    assert told.code == 1
    assert "the disk is full" in told.err
    assert not half_written(small_disk)
    assert not list(small_disk.rglob("*.mp4"))


@pytest.mark.slow
def test_a_missing_egl_names_the_package_to_install(command: Command, capture: Path) -> None:
    run = capture.parent / "run"
    assert command("reconstruct", capture, "-o", run, "--depth", "id", "--fusion", "fb", "--frames", "0:1").code == 0
    arguments = ["render", str(run), "-o", str(run / "set"), "--size", "64x48", "--seconds", "0.2"]
    done = subprocess.run(
        [sys.executable, "-c", "from app.cli import main; main()", *arguments, "--renderer", "pyrender"],
        env=os.environ | NO_EGL,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1
    assert "apt-get install libegl1" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (run / "set/manifest.json").exists()
