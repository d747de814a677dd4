"""Packages of others in a run: installed by pip, from the help to the analysis; and what is said of broken ones."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from recon.capture.format import Capture
from recon.depth import StereoPair
from recon.geometry.mesh import Mesh
from recon.methods.plugins import PluginError
from recon.pipeline.methods import Methods, fuse, match, read_methods
from recon.runtime.files import read_json
from recon.studio import SynthParameters, synthesise
from recon.surface import SurfaceParameters
from tests.command_line import Command
from tests.installed_package import install
from tests.recon.depth.test_matchers import shifted_pair
from tests.recon.fusion.test_orders import three_views

ENTRY_POINTS = """
[reconstudy.depth]
flat = {name}:match
[reconstudy.fusion]
coarse = {name}:fuse
"""
CODE = """
from dataclasses import dataclass, replace
import numpy as np
from recon.fusion import fuse_before
from recon.surface import SurfaceParameters

@dataclass(frozen=True)
class FlatParameters:
    disparity: float = 5.0

def match(pair, parameters=FlatParameters()):
    return np.full((pair.height, pair.width), parameters.disparity, np.float32)

@dataclass(frozen=True)
class CoarseParameters:
    voxel_mm: float | None = None
    times: float = 3.0

def fuse(clouds, parameters=CoarseParameters()):
    return fuse_before(clouds, SurfaceParameters(voxel_mm=parameters.times * parameters.voxel_mm))
"""


@pytest.fixture
def packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of installed packages."""
    folder = tmp_path / "packages"
    folder.mkdir()
    monkeypatch.syspath_prepend(folder)
    return folder


def flat_package(packages: Path, name: str, code: str = CODE, version: str = "1.0") -> None:
    install(packages, name, code, ENTRY_POINTS.format(name=name), version)


def variants(folder: Path, text: str) -> Methods:
    path = folder / "methods.toml"
    path.write_text(text)
    return read_methods(path)


def matched(methods: Methods, name: str, pair: StereoPair, folder: Path) -> Any:
    return match(methods.depth[name], pair, folder)[0]


def test_a_plug_in_matches_with_its_parameters_and_those_of_a_methods_file(packages: Path, tmp_path: Path) -> None:
    flat_package(packages, "others_flat")
    methods = variants(tmp_path, '[depth.flat3]\nmethod = "flat"\ndisparity = 3\n')
    pair = shifted_pair(5)
    mask = np.zeros((40, 80), np.bool_)
    mask[:20] = True
    masked = StereoPair(pair.left, pair.right, 12, left_mask=mask)
    assert (matched(methods, "flat", pair, tmp_path) == 5).all()
    disparity = matched(methods, "flat3", masked, tmp_path)
    assert (disparity[mask] == 3).all()
    assert np.isnan(disparity[~mask]).all()


@pytest.mark.slow
def test_a_plug_in_fuses_with_the_voxel_of_the_run(packages: Path, tmp_path: Path) -> None:
    flat_package(packages, "others_coarse")
    methods = variants(tmp_path, '[fusion.coarser]\nmethod = "coarse"\ntimes = 5\n')
    sizes = []
    for name in ("fb", "coarse", "coarser"):
        run = SurfaceParameters(voxel_mm=2.0)
        mesh, _ = fuse(methods.fusion[name], three_views(), run, views=None, folder=tmp_path)
        assert isinstance(mesh, Mesh)
        sizes.append(len(mesh.faces))
    assert sizes[0] > 5 * sizes[1] > 10 * sizes[2]


def test_normals_of_a_plug_ins_mesh_have_unit_length(packages: Path, tmp_path: Path) -> None:
    code = CODE.replace("def fuse(", "def whole(") + (
        "\ndef fuse(clouds, parameters=CoarseParameters()):\n"
        "    mesh = whole(clouds, parameters)\n"
        "    return replace(mesh, normals=mesh.normals / np.float32(4))\n"
    )
    flat_package(packages, "others_short", code)
    mesh, _ = fuse(
        read_methods(None).fusion["coarse"], three_views(), SurfaceParameters(voxel_mm=2.0), views=None, folder=tmp_path
    )
    assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-5)


TEXTURED = """
from dataclasses import replace
import numpy as np
from recon.fusion import fuse_before
from recon.geometry.mesh import Texture

def fuse(clouds):
    mesh = fuse_before(clouds)
    return replace(mesh, {change})
"""


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ("faces=mesh.faces[:0]", "returned a Mesh without faces, expected a recon"),
        ("texture=Texture(np.zeros((2, 2, 3), np.uint8), mesh.vertices[:, :2])", "returned a Mesh with a texture"),
        ("vertices=mesh.vertices / 1000", "returned a mesh in another place: it reaches from .* expected the clouds'"),
    ],
)
def test_a_mesh_of_a_plug_in_that_cannot_be_used_is_named(
    packages: Path, tmp_path: Path, change: str, sentence: str
) -> None:
    name = f"others_mesh_{len(change)}"
    flat_package(packages, name, TEXTURED.replace("{change}", change))
    coarse = read_methods(None).fusion["coarse"]
    with pytest.raises(PluginError, match=f"plug-in coarse of {name} 1.0 {sentence}"):
        fuse(coarse, three_views(), SurfaceParameters(voxel_mm=4.0), views=None, folder=tmp_path)


def test_what_a_plug_in_masks_is_unmatched(packages: Path, tmp_path: Path) -> None:
    code = "import numpy as np\ndef match(pair): return np.ma.array(np.full((40, 80), 5.0), mask=np.eye(40, 80) > 0)\n"
    flat_package(packages, "others_masked", code)
    disparity = matched(read_methods(None), "flat", shifted_pair(5), tmp_path)
    assert np.array_equal(np.isnan(disparity), np.eye(40, 80) > 0)


BROKEN = {
    "returns a list": ("def match(pair): return [1]\n", "returned a list, expected float32 (40, 80)"),
    "returns another size": (
        "import numpy as np\ndef match(pair): return np.zeros((80, 40))\n",
        "returned float64 (80, 40), expected float32 (40, 80)",
    ),
    "ends the program": (
        "import sys\ndef match(pair): sys.exit(0)\n",
        "plug-in flat of {name} 1.0 failed: SystemExit(0)",
    ),
    "ends the program at import": ("import sys\nsys.exit(0)\n", "cannot be imported ({name}:match): SystemExit(0)"),
    "has the other sign": (
        "import numpy as np\ndef match(pair): return np.full((40, 80), -5.0)\n",
        "all disparities found, -5 to -5, lie outside the range",
    ),
    "raises": ("def match(pair): return pair.no_such_name\n", "plug-in flat of {name} 1.0 failed: AttributeError("),
    "is no function": ("match = 3\n", "is no method: it is a int, expected a function"),
    "has parameters without a default": (
        "def match(pair, parameters): return pair\n",
        "is no method: the default of parameters is no object of a dataclass",
    ),
    "cannot be imported": ("import no_such_module\n", "cannot be imported ({name}:match): ModuleNotFoundError("),
}


@pytest.mark.parametrize(("code", "sentence"), BROKEN.values(), ids=BROKEN.keys())
def test_a_broken_plug_in_is_named_when_it_is_used(packages: Path, tmp_path: Path, code: str, sentence: str) -> None:
    name = f"others_broken_{list(BROKEN.values()).index((code, sentence))}"
    flat_package(packages, name, code)
    methods = read_methods(None)
    with pytest.raises(PluginError) as raised:
        matched(methods, "flat", shifted_pair(5), tmp_path)
    assert sentence.format(name=name) in str(raised.value)
    assert str(raised.value).startswith(f"plug-in flat of {name} 1.0")
    assert "\n" not in str(raised.value)
    assert matched(methods, "sgm", shifted_pair(5), tmp_path).shape == (40, 80)


def test_what_a_plug_in_prints_is_no_result(packages: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    chatty = "print('loaded')\n" + CODE.replace("    return np.full", "    print('matching')\n    return np.full")
    flat_package(packages, "others_chatty", chatty)
    matched(read_methods(None), "flat", shifted_pair(5), tmp_path)
    assert capsys.readouterr() == ("", "loaded\nmatching\n")


def test_a_wrong_parameter_of_a_plug_in_is_named_with_its_place(packages: Path, tmp_path: Path) -> None:
    flat_package(packages, "others_strict")
    for text, sentence in (
        ("depth = 3", r"\[depth.b\] depth is unknown, expected one of disparity"),
        ('disparity = "a"', r"\[depth.b\] disparity is 'a', expected a number"),
    ):
        methods = variants(tmp_path, f'[depth.b]\nmethod = "flat"\n{text}\n')
        methods.check(("flat",), ())
        with pytest.raises(ValueError, match=sentence):
            methods.check(("b",), ())


STRICT = """
from dataclasses import dataclass

@dataclass(frozen=True)
class Parameters:
    side: int
    other: int = 3

    def __post_init__(self):
        assert self.other < 10, "too much"

def match(pair, parameters=Parameters(7)):
    return pair.left[..., 0] * 0 + parameters.side - parameters.other
"""


def test_a_variant_changes_the_default_of_a_plug_in_that_its_class_does_not_have(
    packages: Path, tmp_path: Path
) -> None:
    flat_package(packages, "others_side", STRICT)
    methods = variants(tmp_path, '[depth.b]\nmethod = "flat"\nother = 2\n')
    assert (matched(methods, "b", shifted_pair(5), tmp_path) == 5).all()


@pytest.mark.parametrize(
    ("code", "reason"),
    [(STRICT, "AssertionError('too much')"), (STRICT.replace("int =", "'Unknown' ="), "name 'Unknown' is not defined")],
)
def test_a_plug_in_that_does_not_bear_its_parameters_is_named(
    packages: Path, tmp_path: Path, code: str, reason: str
) -> None:
    name = f"others_unlike_{len(code)}"
    flat_package(packages, name, code)
    methods = variants(tmp_path, '[depth.b]\nmethod = "flat"\nother = 12\n')
    with pytest.raises(PluginError, match=re.escape(reason)) as raised:
        methods.check(("b",), ())
    assert f"plug-in flat of {name} 1.0 " in str(raised.value)
    assert "[depth.b]" in str(raised.value)


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    folder = tmp_path_factory.mktemp("studio") / "ball"
    return synthesise(folder, SynthParameters(scene="ball", n_sensors=2, n_frames=1, size=(160, 120), noise=0.5))


PYPROJECT = """
[build-system]
requires = ["setuptools"]
build-backend = "setuptools.build_meta"

[project]
name = "boxmatch"
version = "{version}"

[project.entry-points."reconstudy.depth"]
box = "boxmatch:match"

[tool.setuptools]
py-modules = ["boxmatch"]
"""
BOX = """
from dataclasses import dataclass

import cv2
import numpy as np


@dataclass(frozen=True)
class BoxParameters:
    side: int = 7


def match(pair, parameters=BoxParameters()):
    left, right = (cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32) for image in (pair.left, pair.right))
    shifts = range(pair.min_disparity, pair.min_disparity + pair.n_disparities)
    side = (parameters.side, parameters.side)
    costs = [cv2.blur(np.abs(left - np.roll(right, shift, axis=1)), side) for shift in shifts]
    disparity = np.float32(pair.min_disparity) + np.argmin(costs, axis=0).astype(np.float32)
    if pair.left_mask is not None:
        disparity[~pair.left_mask] = np.nan
    return disparity
"""


def pip_install(folder: Path, target: Path, version: str) -> None:
    folder.mkdir(exist_ok=True)
    (folder / "pyproject.toml").write_text(PYPROJECT.format(version=version))
    (folder / "boxmatch.py").write_text(BOX)
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "--quiet", "--no-index", "--no-build-isolation", "--no-deps",
         "--disable-pip-version-check", "--upgrade", "--target", str(target), str(folder)],
        check=True, capture_output=True,
    )  # fmt: skip


@pytest.mark.slow
def test_a_package_that_pip_installed_goes_from_the_help_to_the_analysis(
    command: Command, capture: Capture, tmp_path: Path
) -> None:
    target = tmp_path / "packages"
    pip_install(tmp_path / "boxmatch", target, "1.0")
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(target), *sys.path]),
        "RECONSTUDY_DATA_DIR": str(tmp_path / "study"),
    }

    def told(*arguments: object) -> str:
        done = subprocess.run(
            [sys.executable, "-c", "from app.cli import main; main()", *map(str, arguments)],
            env=environment, capture_output=True, text=True, check=False, cwd=tmp_path,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert " box, " in " ".join(told("reconstruct", "--help").replace("│", " ").split())
    path, run = tmp_path / "methods.toml", tmp_path / "run"
    path.write_text('[depth.box3]\nmethod = "box"\nside = 3\n')
    reconstruct = (
        "reconstruct",
        capture.folder,
        "-o",
        run,
        "--methods",
        path,
        "--depth",
        "box,box3,sgm",
        "--colour",
        "vertices",
    )
    told(*reconstruct, "--fusion", "fb")
    recorded = read_json(run / "run.json")["options"]["methods"]["depth"]
    assert recorded["box"] | {"code": "", "temporal": None} == {
        "plugin": "box", "package": "boxmatch", "version": "1.0", "code": "", "parameters": {"side": 7},
        "temporal": None,
    }  # fmt: skip
    assert recorded["box3"]["parameters"] == {"side": 3}

    before = len((run / "log.jsonl").read_text().splitlines())
    pip_install(tmp_path / "boxmatch", target, "1.1")
    told(*reconstruct, "--fusion", "fb", "--workers", 2)
    lines = (run / "log.jsonl").read_text().splitlines()[before:]
    again = [json.loads(line)["made"] for line in lines]
    assert {name.split("/")[1] for name in again if name.startswith("matched")} == {"box", "box3"}

    assert command("render", run, "-o", tmp_path / "set", "--size", "64x48", "--seconds", 0.2).code == 0
    manifest = read_json(tmp_path / "set/manifest.json")
    assert sorted(manifest["factors"]["depth"]) == ["box", "box3", "sgm"]
    votes = tmp_path / "votes.csv"
    pairs = [("box_fb", "sgm_fb", "b"), ("box_fb", "box3_fb", "a"), ("box3_fb", "sgm_fb", "a")]
    rows = [f"p{number},ball,{a},{b},{choice}" for number in range(3) for a, b, choice in pairs]
    votes.write_text("participant,dataset,item_a,item_b,choice\n" + "\n".join(rows) + "\n")
    items = [f"{stimulus['approach']},{stimulus['levels']['depth']}" for stimulus in manifest["stimuli"]]
    (tmp_path / "items.csv").write_text("\n".join(["item,depth", *items]) + "\n")
    grouped = ("--items", tmp_path / "items.csv", "--factor", "depth")
    assert command("analyse", votes, *grouped, "-o", tmp_path / "analysis").code == 0
    scores = read_json(tmp_path / "analysis/analysis.json")["scores"]
    assert {score["item"] for score in scores if score["comparison"] == "depth"} == {"box", "box3", "sgm"}


def test_a_plug_in_that_is_left_out_is_told_and_disturbs_nothing(
    command: Command, packages: Path, tmp_path: Path
) -> None:
    install(packages, "others_id", "", "[reconstudy.depth]\nid = others_id:match\n")
    install(packages, "others_broken", "1 / 0", "[reconstudy.depth]\nbroken = others_broken:match\n")
    told = command("match", "--help")
    assert told.code == 0
    assert "broken," in told.out
    told = command("match", tmp_path / "no.png", tmp_path / "no.png", "--disparities", 9, "-o", tmp_path / "out.npy",
                   "--method", "broken")  # fmt: skip
    assert told.code == 1
    assert "warning: plug-in id of others_id 1.0 is left out: id is a method of this program" in told.err
    assert "plug-in broken of others_broken 1.0 cannot be imported (others_broken:match): ZeroDivisionError" in told.err
    assert "others_id:match" not in told.err
