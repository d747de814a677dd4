"""Programs of others as fusions: how they are called, how they fail, and that a run with one is resumed."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from recon.capture.format import Capture
from recon.fusion import fuse_before
from recon.fusion.program import FusionProgram, fuse_by_program
from recon.geometry.mesh import Cloud
from recon.geometry.mesh_files import read_mesh, write_cloud
from recon.geometry.normals import surface_normals
from recon.pipeline.job import ReconstructOptions
from recon.pipeline.methods import read_methods
from recon.pipeline.reconstruct import reconstruct
from recon.runtime.files import read_json
from recon.runtime.programs import LOG, ProgramError
from recon.studio import SynthParameters, synthesise
from tests.command_line import Command
from tests.recon.fusion.test_orders import three_views

pytestmark = pytest.mark.slow

JOIN = """
import sys
import numpy as np
import trimesh
clouds = [trimesh.load(path, process=False).vertices for path in sys.argv[3:]]
points = np.concatenate(clouds)[:60]
print(len(clouds), "clouds, voxel", sys.argv[2])
{change}
names = ["x", "y", "z"] + {names}
with open(sys.argv[1], "w") as file:
    print("ply\\nformat ascii 1.0\\nelement vertex", len(points), file=file)
    for name in names:
        print("property", "uchar" if name in ("red", "green", "blue") else "float", name, file=file)
    print("element face", len(faces), "\\nproperty list uchar int vertex_indices\\nend_header", file=file)
    for point in points:
        print(*point, *{values}, file=file)
    for face in faces:
        print(3, *face, file=file)
"""
FACES = "faces = np.arange(60).reshape(20, 3)"


def joining(folder: Path, change: str = FACES, names: str = "[]", values: str = "[]") -> str:
    """Write a program that makes triangles of the first points; returns its command."""
    (folder / "join.py").write_text(JOIN.format(change=change, names=names, values=values))
    return f"{sys.executable} '{{folder}}/join.py' {{out}} {{voxel_mm}} {{clouds}}"


def program(folder: Path, command: str, timeout_s: float = 60.0) -> FusionProgram:
    return FusionProgram(command, "ply", timeout_s, str(folder))


def coloured_views() -> list[Cloud]:
    clouds = three_views()
    return [
        Cloud(cloud.points, cloud.normals, np.clip(128 + cloud.points, 0, 255).astype(np.uint8)) for cloud in clouds
    ]


def test_a_program_fuses_with_normals_of_its_faces_and_colours_of_the_nearest_points(tmp_path: Path) -> None:
    clouds = coloured_views()
    nothing = clouds[0].select(np.zeros(len(clouds[0]), np.bool_))
    called = program(tmp_path, joining(tmp_path))
    mesh = fuse_by_program([clouds[0], nothing, clouds[1]], called, 2.5, tmp_path / "a b")
    assert np.array_equal(mesh.vertices, clouds[0].points[:60])
    assert np.array_equal(mesh.colours, clouds[0].colours[:60])
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    assert ((np.cross(b - a, c - a) * mesh.normals[mesh.faces[:, 0]]).sum(axis=1) > 0).all()
    assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-5)
    assert [path.name for path in (tmp_path / "a b").iterdir()] == [LOG]
    assert "2 clouds, voxel 2.5" in (tmp_path / "a b" / LOG).read_text()


def test_normals_and_colours_of_a_program_are_kept(tmp_path: Path) -> None:
    names = '["nx", "ny", "nz", "red", "green", "blue"]'
    called = program(tmp_path, joining(tmp_path, names=names, values="[0, 1, 0, 9, 8, 7]"))
    mesh = fuse_by_program(three_views(), called, 3, tmp_path / "work")
    assert (mesh.normals == [0, 1, 0]).all()
    assert (mesh.colours == [9, 8, 7]).all()


def test_normals_of_a_program_that_are_too_long_or_have_no_direction_are_mended(tmp_path: Path) -> None:
    change = f"{FACES}\nturn = iter([(0, 3, 0)] + [(0, 0, 0)] * 59)"
    called = program(tmp_path, joining(tmp_path, change, names='["nx", "ny", "nz"]', values="next(turn)"))
    mesh = fuse_by_program(three_views(), called, 3, tmp_path / "work")
    assert mesh.normals[0].tolist() == [0, 1, 0]
    assert np.allclose(mesh.normals[1:], surface_normals(mesh.vertices, mesh.faces)[1:])


FAILURES = {
    "fails": ("raise SystemExit(3)", "ended with exit status 3"),
    "writes nothing": ("raise SystemExit(0)", "wrote no out.ply"),
    "writes garbage": ("open(sys.argv[1], 'w').write('garbage'); sys.exit()", "is not a whole PLY file"),
    "writes no point": ("points, faces = points[:0], []", "holds no points"),
    "writes points alone": ("faces = []", "holds no faces"),
    "writes NaN": (f"points[7, 1] = np.nan; {FACES}", "not finite numbers: row 7"),
    "writes metres": (f"points = points / 1000; {FACES}", r"reaches from .* expected the clouds' coordinates, in mm"),
    "writes another place": (f"points = points + 999; {FACES}", "expected the clouds' coordinates, in mm"),
    "names vertices that are not there": ("faces = [(0, 1, 60)]", "name vertices 0 to 60, but there are 60"),
}


@pytest.mark.parametrize(("change", "sentence"), FAILURES.values(), ids=FAILURES.keys())
def test_how_a_program_failed_is_said_with_its_log(tmp_path: Path, change: str, sentence: str) -> None:
    with pytest.raises(ProgramError, match=sentence) as raised:
        fuse_by_program(three_views(), program(tmp_path, joining(tmp_path, change)), 3, tmp_path / "work")
    assert str(raised.value).endswith(f"its log is {tmp_path / 'work' / LOG}")
    assert "\n" not in str(raised.value)
    assert (tmp_path / "work" / "cloud-3.ply").exists()


def test_a_program_that_hangs_is_stopped(tmp_path: Path) -> None:
    called = program(tmp_path, joining(tmp_path, "import time; time.sleep(600)"), timeout_s=1.5)
    with pytest.raises(ProgramError, match=r"was stopped after 1\.5 s"):
        fuse_by_program(three_views(), called, 3, tmp_path / "work")


def methods_file(folder: Path, change: str = FACES) -> Path:
    path = folder / "methods.toml"
    path.write_text(f'[fusion.mine]\ncommand = "{joining(folder, change)}"\noutput = "ply"\n')
    return path


def test_fuse_takes_a_program_and_a_baseline(command: Command, tmp_path: Path) -> None:
    clouds = [write_cloud(tmp_path / f"{number}.ply", cloud) for number, cloud in enumerate(three_views())]
    out = tmp_path / "mesh.ply"
    told = command("fuse", *clouds, "-o", out, "--fusion", "mine", "--methods", methods_file(tmp_path))
    assert told.code == 0, told.err
    assert len(read_mesh(out).faces) == 20
    told = command("fuse", *clouds, "-o", out, "--fusion", "poisson", "--voxel", 3, "--json")
    assert told.code == 0, told.err
    assert abs(np.linalg.norm(read_mesh(out).vertices, axis=1) - 60).mean() < 1
    told = command("fuse", *clouds, "-o", tmp_path / "no.ply", "--fusion", "tsdf")
    assert told.code == 1
    assert "needs depth maps with their cameras, not clouds alone: use `reconstruct`" in told.err
    told = command("fuse", *clouds, "-o", out, "--fusion", "fc")
    assert "unknown fusion method 'fc', expected one of fa, fb, poisson, tsdf" in told.err
    assert not (tmp_path / "no.ply").exists()


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    folder = tmp_path_factory.mktemp("studio") / "ball"
    return synthesise(folder, SynthParameters(scene="ball", n_sensors=2, n_frames=2, size=(160, 120), noise=0.5))


@pytest.mark.slow
def test_a_run_with_a_program_that_failed_is_resumed(capture: Capture, tmp_path: Path) -> None:
    busy = tmp_path / "busy"
    busy.touch()
    is_busy = f"os.path.exists({str(busy)!r}) and '0001' in os.getcwd()"
    fails_once = f"import os\nif {is_busy}: raise SystemExit('out of memory')\n{FACES}"
    path, run = methods_file(tmp_path, fails_once), tmp_path / "run"
    options = ReconstructOptions(depths=("id",), fusions=("mine",), methods=read_methods(path))
    with pytest.raises(
        ProgramError, match=r"^id_mine: frame 1: the program ended with exit status 1 and said: out of memory; "
    ) as error:
        reconstruct(capture.folder, run, options)
    assert "out of memory" in Path(str(error.value).split("its log is ")[1]).read_text()
    assert not (run / "run.json").exists()
    busy.unlink()
    content = reconstruct(capture.folder, run, options)
    made = [json.loads(line)["made"] for line in (run / "log.jsonl").read_text().splitlines()]
    assert made.count("meshes/id_mine/0000.ply") == made.count("meshes/id_mine/0001.ply") == 1
    recorded = content["options"]["methods"]["fusion"]["mine"]
    assert recorded["command"] == joining(tmp_path)
    assert recorded["voxel_mm"] == content["options"]["surface"]["voxel_mm"]
    assert "2 clouds" in (run / "programs/id_mine/0001" / LOG).read_text()


@pytest.mark.slow
def test_baselines_of_a_run_are_the_same_for_any_number_of_workers(
    command: Command, capture: Capture, tmp_path: Path
) -> None:
    digests = []
    for workers in (1, 2):
        run = tmp_path / f"run{workers}"
        told = command("reconstruct", capture.folder, "-o", run, "--depth", "sgm", "--fusion", "poisson,tsdf,fb",
                       "--frames", "0:1", "--workers", workers)  # fmt: skip
        assert told.code == 0, told.err
        assert "Warning" not in told.err
        digests.append(read_json(run / "run.json")["meshes"])
    assert digests[0] == digests[1]
    recorded = read_json(tmp_path / "run1/run.json")["options"]["methods"]["fusion"]
    voxel = read_json(tmp_path / "run1/run.json")["options"]["surface"]["voxel_mm"]
    for name in ("poisson", "tsdf"):
        assert recorded[name]["parameters"]["voxel_mm"] == voxel


def test_a_mesh_that_has_all_is_the_same_through_a_program(tmp_path: Path) -> None:
    clouds = three_views()
    ours = fuse_before(clouds)
    (tmp_path / "fuse.py").write_text(
        "import sys\nfrom pathlib import Path\n"
        "from recon.fusion import fuse_before\nfrom recon.geometry.mesh_files import read_cloud, write_mesh\n"
        "write_mesh(Path(sys.argv[1]), fuse_before([read_cloud(Path(path)) for path in sys.argv[2:]]))\n"
    )
    called = program(tmp_path, f"{sys.executable} {{folder}}/fuse.py {{out}} {{clouds}}")
    theirs = fuse_by_program(clouds, called, 3, tmp_path / "work")
    assert np.array_equal(theirs.vertices, ours.vertices)
    assert np.array_equal(theirs.normals, ours.normals)
    assert np.array_equal(theirs.colours, ours.colours)
