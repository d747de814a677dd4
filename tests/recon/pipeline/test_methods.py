"""A methods file: variants of ours and programs of others, from the file to the run."""

from __future__ import annotations

import json
import pickle
import shutil
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from recon.capture.format import Capture, read_capture
from recon.depth import DEFAULTS
from recon.depth.cvf import DrParameters
from recon.depth.disparity_io import read_disparity
from recon.depth.patchmatch import PmParameters
from recon.methods.approaches import parse_approach
from recon.pipeline.job import ReconstructOptions, planned_job
from recon.pipeline.methods import Methods, OurDepth, OurFusion, depth_key, read_methods
from recon.pipeline.reconstruct import match_files, reconstruct
from recon.pipeline.stages import filter_sequence, match_stretch, measure_rows
from recon.runtime.files import read_json
from recon.runtime.programs import ProgramError
from recon.studio import SynthParameters, synthesise
from tests.command_line import Command
from tests.recon.depth.called_program import BOX_FILTER, program
from tests.recon.depth.test_matchers import shifted_pair

PACED = """
import os
import sys
import cv2
import numpy as np
middle = int(sys.argv[5]) + int(sys.argv[4]) // 2
shape = cv2.imread(sys.argv[1], 0).shape
np.save(sys.argv[3], np.full(shape, middle + int(os.path.basename(os.getcwd())) / 4, np.float32))  # by the frame alone
"""


def methods_file(folder: Path, text: str = BOX_FILTER, more: str = "") -> Path:
    called = program(folder, text)
    path = folder / "methods.toml"
    path.write_text(f'[depth.mine]\ncommand = "{called.command}"\noutput = "npy"\n{more}')
    return path


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    folder = tmp_path_factory.mktemp("studio") / "ball"
    return synthesise(folder, SynthParameters(scene="ball", n_sensors=2, n_frames=2, size=(160, 120), noise=0.5))


def made(run: Path, before: int = 0) -> list[str]:
    return [json.loads(line)["made"] for line in (run / "log.jsonl").read_text().splitlines()[before:]]


def test_a_methods_file_adds_variants_and_programs_to_ours(tmp_path: Path) -> None:
    path = methods_file(
        tmp_path,
        more="""timeout_s = 5
[depth.dr8]
method = "dr"
sigma = 8
levels = 1
[depth.pm-fast]
method = "pm"
sweeps = 2
is_seeded = true
seed = {sigma = 9.0}
[depth.pm-random]
method = "pm"
seed = "none"
sweeps = 9
[fusion.fb-fine]
method = "fb"
voxel_mm = 2
""",
    )
    methods = read_methods(path)
    assert methods.depth["dr8"] == OurDepth("dr", DrParameters(sigma=8.0, levels=1))
    assert methods.depth["pm-fast"] == OurDepth("pm", PmParameters(sweeps=2, seed=DrParameters(sigma=9.0)))
    assert methods.depth["pm-random"] == OurDepth("pm", PmParameters(is_seeded=False, sweeps=9))
    assert methods.depth["mine"] == replace(program(tmp_path, BOX_FILTER), timeout_s=5.0)
    assert methods.fusion["fb-fine"] == OurFusion("fb", {"voxel_mm": 2.0})
    assert methods.depth["id"] == Methods().depth["id"] == OurDepth("id", DEFAULTS["id"])
    assert pickle.loads(pickle.dumps(methods)) == methods


WRONG_FILES = {
    "no TOML": ("[depth", "is not readable as TOML"),
    "too many digits": (f"[depth.a]\nmethod = 'dr'\nsigma = {'9' * 5000}", "is not readable as TOML"),
    "too large": (f"[depth.a]\nmethod = 'dr'\nsigma = {'9' * 400}", "expected a number"),
    "an unknown table": ('[deep.a]\nmethod = "id"', "deep is unknown"),
    "no table": ("depth = 3", "depth is 3, expected a table"),
    "no table of a method": ("[depth]\na = 3", r"\[depth.a\] is 3, expected a table"),
    "neither": (
        "[depth.a]\ncomand = 3",
        r"\[depth.a\] has comand, expected either method, one of this program's, or command",
    ),
    "both": ('[depth.a]\nmethod = "id"\ncommand = "a"', r"\[depth.a\] has method and command, expected either"),
    "an unknown method": ('[depth.a]\nmethod = "xx"', r"\[depth.a\] method is 'xx', expected one of id, dr, pm, sgm"),
    "a method of a method": ('[depth.a]\nmethod = "id"\n[depth.b]\nmethod = "a"', r"\[depth.b\] method is 'a'"),
    "an unknown key": ('[depth.a]\nmethod = "id"\nsweeps = 2', r"\[depth.a\] sweeps is unknown, expected one of sigma"),
    "a text": ('[depth.a]\nmethod = "id"\nsigma = "8"', r"\[depth.a\] sigma is '8', expected a number"),
    "a truth": ('[depth.a]\nmethod = "id"\nlevels = true', r"\[depth.a\] levels is True, expected a whole number"),
    "a fraction": ('[depth.a]\nmethod = "id"\nlevels = 1.5', r"\[depth.a\] levels is 1.5, expected a whole number"),
    "not a number": ('[depth.a]\nmethod = "id"\nsigma = nan', r"\[depth.a\] sigma is nan, expected a number"),
    "a wrong value": ('[depth.a]\nmethod = "id"\nlevels = 9', r"\[depth.a\] levels: levels is 9"),
    "a wrong value below": ('[depth.a]\nmethod = "pm"\nseed.sigma = 0', r"\[depth.a\] seed sigma: sigma is 0"),
    "a name of ours": ('[depth.sgm]\nmethod = "id"', r"\[depth.sgm\]: there is a depth sgm already"),
    "a fusion of ours": ('[fusion.fa]\nmethod = "fb"', r"\[fusion.fa\]: there is a fusion fa already"),
    "a name that is a path": ('[depth."../a"]\nmethod = "id"', r"'../a' is no name of a method"),
    "the name of everything": ('[depth.all]\nmethod = "id"', "'all' is what results call everything together"),
    "a name with an underscore": ('[depth.a_b]\nmethod = "id"', "'a_b' is no name of a method"),
    "no output": ('[depth.a]\ncommand = "a"', r"\[depth.a\]: output is missing"),
    "an unknown output": ('[depth.a]\ncommand = "a"\noutput = "exr"', r"\[depth.a\] command, output: output is 'exr'"),
    "no time": ('[depth.a]\ncommand = "a"\noutput = "npy"\ntimeout_s = 0', "timeout_s is 0.0"),
    "no command": ('[depth.a]\ncommand = " "\noutput = "npy"', "command is empty"),
    "an open quotation": (
        '[depth.a]\ncommand = "a \'"\noutput = "npy"',
        "cannot be filled in: No closing quotation; expected",
    ),
    "an unknown placeholder": (
        '[depth.a]\ncommand = "a {input}"\noutput = "npy"',
        r"in: \{input\} is unknown; expected .* \{left\}",
    ),
    "an unknown key of a command": ('[depth.a]\ncommand = "a"\noutput = "npy"\nfolder = "/"', "folder is unknown"),
    "a wrong filter in time": (
        '[depth.a]\nmethod = "id"\ntemporal.sigma = 0',
        r"\[depth.a\] temporal sigma: sigma is 0.0",
    ),
    "a filter in time of a fusion": ('[fusion.a]\nmethod = "fb"\ntemporal.sigma = 3', "temporal is unknown"),
    "a fusion that writes disparities": (
        '[fusion.a]\ncommand = "a"\noutput = "npy"',
        "output is 'npy', expected one of p",
    ),
    "clouds within an argument": (
        '[fusion.a]\ncommand = "a --in={clouds}"\noutput = "ply"',
        r"\{clouds\} must be an argument of its own",
    ),
    "a parameter of another fusion": (
        '[fusion.a]\nmethod = "poisson"\nradius = 3',
        "radius is unknown, expected one of voxel_mm",
    ),
    "an unknown fusion": (
        '[fusion.a]\nmethod = "fc"',
        r"\[fusion.a\] method is 'fc', expected one of fa, fb, poisson, tsdf",
    ),
    "a wrong voxel": ('[fusion.a]\nmethod = "fb"\nvoxel_mm = -1', r"\[fusion.a\] voxel_mm: voxel_mm is -1.0"),
}


@pytest.mark.parametrize(("content", "sentence"), WRONG_FILES.values(), ids=WRONG_FILES.keys())
def test_a_wrong_methods_file_is_named_with_its_place(tmp_path: Path, content: str, sentence: str) -> None:
    path = tmp_path / "methods.toml"
    path.write_text(content)
    with pytest.raises(ValueError, match=sentence) as raised:
        read_methods(path)
    assert str(raised.value).startswith(f"{path}: ")


def test_a_missing_methods_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"no\.toml: there is no such file"):
        read_methods(tmp_path / "no.toml")


@pytest.mark.slow
def test_programs_and_variants_go_the_whole_way_in_worker_processes(
    command: Command, capture: Capture, tmp_path: Path
) -> None:
    more = '[depth.dr8]\nmethod = "dr"\nsigma = 8\n[fusion.fb-coarse]\nmethod = "fb"\nvoxel_mm = 90\n'
    arguments = ("reconstruct", capture.folder, "--methods", methods_file(tmp_path, more=more))
    chosen = ("--depth", "mine,dr8", "--fusion", "fb,fb-coarse", "--colour", "vertices", "--frames", "0:1")
    told = command(*arguments, *chosen, "-o", tmp_path / "run", "--workers", 2)
    assert told.code == 0, told.err
    content = read_json(tmp_path / "run/run.json")
    assert content["approaches"] == ["mine_fb", "mine_fb-coarse", "dr8_fb", "dr8_fb-coarse"]
    recorded = content["options"]["methods"]
    assert recorded["depth"]["mine"]["command"] == program(tmp_path, BOX_FILTER).command
    assert recorded["depth"]["dr8"]["parameters"]["sigma"] == 8.0
    assert recorded["fusion"]["fb-coarse"]["parameters"]["voxel_mm"] == 90.0
    sizes = [(tmp_path / f"run/meshes/mine_{fusion}/0000.ply").stat().st_size for fusion in ("fb", "fb-coarse")]
    assert sizes[0] > sizes[1]
    assert "matched" in (tmp_path / "run/programs/mine/S1/0000/log.txt").read_text()
    told = command("validate", "views", tmp_path / "run", "-o", tmp_path / "views", "--frames", "0:1")
    assert told.code == 0, told.err
    assert "mine_fb-coarse" in (tmp_path / "views/measures.csv").read_text()
    told = command("models", tmp_path / "run", "-o", tmp_path / "models")
    assert told.code == 0, told.err
    told = command("render", tmp_path / "run", "-o", tmp_path / "set", "--size", "64x48", "--seconds", 0.2)
    assert told.code == 0, told.err
    factors = {"depth": ["dr8", "mine"], "fusion": ["fb", "fb-coarse"]}
    assert read_json(tmp_path / "set/manifest.json")["factors"] == factors


@pytest.mark.slow
def test_a_failure_names_its_frame_and_the_run_is_resumed(capture: Capture, tmp_path: Path) -> None:
    busy = tmp_path / "busy"
    busy.touch()
    is_busy = f"os.path.exists({str(busy)!r}) and '0001' in os.getcwd() and 'S2' in os.getcwd()"
    fails_once = f"import os, sys\nif {is_busy}: raise SystemExit('out of memory')\n"
    path, run = methods_file(tmp_path, fails_once + BOX_FILTER), tmp_path / "run"
    options = ReconstructOptions(depths=("mine",), fusions=("fb",), methods=read_methods(path))
    with pytest.raises(
        ProgramError, match=r"^mine: sensor S2, frame 1: the program ended with exit status 1 and said: out of memory; "
    ) as error:
        reconstruct(capture.folder, run, options)
    assert "out of memory" in Path(str(error.value).split("its log is ")[1]).read_text()
    assert not (run / "run.json").exists()
    rows = [f"rows/{sensor}.json" for sensor in ("S1", "S2")]
    assert made(run) == [*rows, *(f"matched/mine/{view}.tiff" for view in ("S1/0000", "S2/0000", "S1/0001"))]
    busy.unlink()
    reconstruct(capture.folder, run, replace(options, methods=read_methods(path)))
    assert [name for name in made(run) if name.startswith("matched")].count("matched/mine/S1/0000.tiff") == 1
    assert np.isfinite(read_disparity(run / "matched/mine/S2/0001.tiff")).any()


@pytest.mark.slow
def test_pictures_that_change_are_filtered_in_time_again_though_they_match_as_before(
    capture: Capture, tmp_path: Path
) -> None:
    recording = read_capture(Path(shutil.copytree(capture.folder, tmp_path / "ball")))
    methods = read_methods(methods_file(tmp_path, PACED))

    def filtered(run: str) -> NDArray[np.float32]:
        job = planned_job(recording, tmp_path / run, ReconstructOptions(("mine",), ("fb",), methods=methods))
        sequence = job.sequences[0]
        measure_rows(job, sequence[0].sensor_id)
        for view in sequence:
            match_stretch(job, [view])
        filter_sequence(job, sequence)
        return read_disparity(job.artefacts.path(sequence[1].depth))

    before = filtered("run")
    for side in ("left", "right"):
        assert cv2.imwrite(str(recording.folder / f"S1/{side}/0001.png"), np.zeros((120, 160, 3), np.uint8))
    after = filtered("run")
    assert not np.array_equal(after, before, equal_nan=True)
    assert np.array_equal(after, filtered("again"), equal_nan=True)


@pytest.mark.slow
def test_a_changed_method_alone_is_run_again(capture: Capture, tmp_path: Path) -> None:
    run = tmp_path / "run"

    def reconstructed(more: str, extra: str = "", text: str = BOX_FILTER) -> set[str]:
        path = methods_file(tmp_path, text, more=more)
        path.write_text(path.read_text().replace("{min_disparity}", "{min_disparity}" + extra))
        before = len(made(run)) if (run / "log.jsonl").exists() else 0
        options = ReconstructOptions(depths=("mine", "id8"), fusions=("fb",), methods=read_methods(path))
        reconstruct(capture.folder, run, options)
        return {name.split("/")[1] for name in made(run, before) if name.startswith("matched")}

    variant = '[depth.id8]\nmethod = "id"\nsigma = {}\n'
    assert reconstructed(variant.format(8)) == {"mine", "id8"}
    assert reconstructed("timeout_s = 7\n" + variant.format("8.0")) == set()
    assert reconstructed(variant.format(9)) == {"id8"}
    assert reconstructed(variant.format(9), " --version=2") == {"mine"}
    assert reconstructed(variant.format(9), " --version=2", BOX_FILTER.replace("(7, 7)", "(5, 5)")) == {"mine"}


def test_a_methods_file_that_is_moved_with_its_programs_means_the_same(tmp_path: Path) -> None:
    keys = []
    for name in ("here", "there"):
        (tmp_path / name).mkdir()
        keys.append(depth_key(read_methods(methods_file(tmp_path / name)).depth["mine"]))
    assert keys[0] == keys[1]
    assert set(keys[0]["files"]) == {sys.executable, "match.py"}


@pytest.mark.slow
def test_match_takes_a_method_of_a_methods_file(command: Command, tmp_path: Path) -> None:
    pair = shifted_pair(5)
    for side, image in (("left", pair.left), ("right", pair.right)):
        cv2.imwrite(str(tmp_path / f"{side}.png"), image[..., ::-1])
    pictures = (tmp_path / "left.png", tmp_path / "right.png", "--disparities", 12)
    methods, out = methods_file(tmp_path), tmp_path / "out.npy"
    told = command("match", *pictures, "-o", out, "--methods", methods, "--method", "mine", "--json")
    assert told.code == 0, told.err
    assert json.loads(told.out)["parameters"]["command"] == program(tmp_path, BOX_FILTER).command
    assert np.median(read_disparity(out)) == 5
    methods_file(tmp_path, "raise SystemExit(4)")
    told = command("match", *pictures, "-o", out, "--methods", methods, "--method", "mine")
    assert told.code == 1
    assert "mine: the program ended with exit status 4; its log is " in told.err
    told = command("match", *pictures, "-o", out, "--method", "mine")
    assert told.code == 1
    assert "unknown depth method 'mine', expected one of id, dr, pm, sgm" in told.err
    assert "or one of a methods file (--methods)" in told.err


def test_match_does_not_overwrite_a_picture_nor_search_for_a_format_that_is_not(
    command: Command, tmp_path: Path
) -> None:
    pair = shifted_pair(5)
    pictures = [tmp_path / f"{side}.png" for side in ("left", "right")]
    for path, image in zip(pictures, (pair.left, pair.right), strict=True):
        cv2.imwrite(str(path), image)
    (tmp_path / "link.png").symlink_to(pictures[1])
    before = [path.read_bytes() for path in pictures]
    for out, sentence in (
        ("left.png", "is one of the files that are read"),
        ("link.png", "is one of the files that are read"),
        ("out.PFM", "unknown format '.PFM'"),
    ):
        told = command("match", *pictures, "--disparities", 12, "-o", tmp_path / out, "--methods",
                       methods_file(tmp_path, "raise SystemExit('begun')"), "--method", "mine")  # fmt: skip
        assert told.code == 1
        assert f"{tmp_path / out}: {sentence}" in told.err
    assert [path.read_bytes() for path in pictures] == before


@pytest.mark.slow
def test_every_parameter_of_table_2_is_set_by_a_methods_file_and_recorded_in_the_run(
    capture: Capture, tmp_path: Path
) -> None:
    path, run = tmp_path / "methods.toml", tmp_path / "run"
    path.write_text("""
[depth.table2]
method = "id"
window = 3                  # cost computation: census, window size
sigma = 8                   # cost aggregation: permeability filter, permeability
levels = 1                  # hierarchical matching: levels
consistency_threshold = 1   # post-processing: L/R consistency, threshold
temporal.sigma = 6          # temporal filtering: permeability filter, permeability
temporal.sigma_disparity = 0.5  # temporal filtering: temporal consistency
""")
    options = ReconstructOptions(depths=("id", "table2"), fusions=("fb",), methods=read_methods(path))
    recorded = reconstruct(capture.folder, run, options)["options"]["methods"]["depth"]
    ours = {"sigma": 12.0, "levels": 2, "consistency_threshold": 0, "window": 5}
    assert recorded["id"]["parameters"] == ours
    assert recorded["table2"]["parameters"] == {
        "sigma": 8.0, "levels": 1, "consistency_threshold": 1, "window": 3
    }  # fmt: skip
    assert recorded["id"]["temporal"] == {"sigma": 12.0, "sigma_disparity": 1.0, "memory": 8.0}
    assert recorded["table2"]["temporal"] == {"sigma": 6.0, "sigma_disparity": 0.5, "memory": 8.0}


@pytest.mark.slow
# the levels change the search alone, which finds the same in pictures as small as these
@pytest.mark.parametrize("change", ["window = 3", "sigma = 3", "consistency_threshold = 1", "temporal.sigma = 1",
                                    "temporal.sigma_disparity = 0.1"])  # fmt: skip
def test_a_parameter_of_table_2_changes_the_depth(capture: Capture, tmp_path: Path, change: str) -> None:
    path, run = tmp_path / "methods.toml", tmp_path / "run"
    path.write_text(f'[depth.changed]\nmethod = "dr"\n{change}\n')
    options = ReconstructOptions(depths=("dr", "changed"), fusions=("fb",), methods=read_methods(path))
    reconstruct(capture.folder, run, options)
    depths = [read_disparity(run / f"depth/{method}/S1/0001.tiff") for method in ("dr", "changed")]
    assert not np.array_equal(*depths, equal_nan=True)


def test_a_match_that_is_interrupted_leaves_no_folder_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_given: object) -> None:
        raise KeyboardInterrupt

    image = tmp_path / "image.png"
    assert cv2.imwrite(str(image), np.zeros((20, 30, 3), np.uint8))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(sys.modules[match_files.__module__], "match", interrupt)
    with pytest.raises(KeyboardInterrupt):
        match_files(image, image, tmp_path / "out.npy", method="id", n_disparities=8)
    assert list(tmp_path.iterdir()) == [image]


def test_further_approaches_stand_beside_all_combinations_once() -> None:
    further = tuple(map(parse_approach, ("sgm_fb", "id_fb", "pm_fa_photographs")))
    options = ReconstructOptions(depths=("id",), fusions=("fb",), further=further)
    assert [str(approach) for approach in options.models] == ["id_fb", "sgm_fb", "pm_fa_photographs"]
    assert [str(approach) for approach in options.surfaces] == ["id_fb", "sgm_fb", "pm_fa"]
    assert (options.depth_methods, options.fusion_methods) == (("id", "sgm", "pm"), ("fb", "fa"))
