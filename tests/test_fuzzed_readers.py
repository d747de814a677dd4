"""Every reader of other people's files answers bad input with a sentence: it does not crash, hang or swell."""

from __future__ import annotations

import io
import json
import resource
import struct
import subprocess
import tempfile
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from imageio_ffmpeg import get_ffmpeg_exe
from PIL import Image

from app.analysis.reading.attributes import read_items
from app.analysis.reading.read_votes import read_votes
from app.ffmpeg import decode
from app.intake.stimuli import read_stimulus_set
from app.operations.studies.create import read_options
from app.study.options.study_file import parse_study_file
from recon.capture.depth_maps import read_depth_values
from recon.capture.format import read_draft
from recon.capture.images import read_image, read_video_frame, video_times
from recon.capture.importing import colmap_model
from recon.depth.disparity_io import read_disparity
from recon.geometry.mesh import Mesh
from recon.geometry.mesh_files import read_cloud, read_mesh
from recon.geometry.packed import packed_bytes
from recon.models.read import Placement, read_model
from recon.models.scene_file import read_scene_file
from recon.render.path_file import read_path

REFUSALS = (ValueError, OSError)  # a sentence for whoever gave the file; anything else is our mistake
LONGEST_S = 20.0
MOST_MEMORY_KB = 600_000  # more than before
BOUNDED = settings(
    max_examples=40, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)

VOTES = "participant,dataset,item_a,item_b,choice,first_shown,response_ms\nP1,ball,x,y,a,x,120\nP2,ball,y,x,none,y,80\n"
OPTIONS = 'optional_stages = ["practice", "interview"]\n[[questions]]\nname = "age"\nkind = "number"\ntext = "Age?"\n'
STUDY = 'name = "Models"\nstimuli = "set"\nexposure_s = 15.0\nseed = 4\n[options]\nbreak_every = 10\n'
PLY = "\n".join(
    [
        "ply",
        "format ascii 1.0",
        "element vertex 3",
        *(f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")),
        *(f"property uchar {name}" for name in ("red", "green", "blue")),
        "element face 1",
        "property list uchar int vertex_indices",
        "end_header",
        "0 0 0 0 0 1 9 9 9",
        "1 0 0 0 0 1 9 9 9",
        "0 1 0 0 0 1 9 9 9",
        "3 0 1 2\n",
    ]
)
PFM = b"Pf\n3 2\n-1.0\n" + np.arange(6, dtype="<f4").tobytes()
STIMULUS = {
    "dataset": "ball",
    "approach": "id_fa",
    "levels": {"depth": "id"},
    "video": "v.mp4",
    "sha256": "0" * 64,
    "width": 64,
    "height": 48,
    "fps": 25.0,
    "n_frames": 10,
    "codec": "h264",
    "renderer": "x",
}
MANIFEST = {"schema_version": 1, "name": "tiny", "created": "2026-03-01T12:00:00+00:00", "stimuli": [STIMULUS]}
SENSOR = {
    "id": "1",
    "left": {"image": "l/{:04d}.png", "K": [[50, 0, 31], [0, 50, 23], [0, 0, 1]], "dist": [], "size": [64, 48]},
}
CAMERA = {"camera_to_world": [1, 0, 0, 9, 0, 1, 0, 9, 0, 0, 1, 900, 0, 0, 0, 1], "fov": 40.0, "aspect": 1.5}
CAMERA_PATH = {
    "camera_type": "perspective",
    "units": "mm",
    "render_height": 64,
    "render_width": 96,
    "camera_path": [CAMERA],
}
CAPTURE = {"schema_version": 1, "name": "c", "kind": "scene", "fps": 5, "n_frames": 1, "sensors": [SENSOR]}


OBJ = "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nvt 0 0\nvn 0 0 1\nusemtl a\nf 1/1/1 2/1/1 -1/-1/-1\nf 1 2 3\n"
GLTF = {
    "asset": {"version": "2.0"},
    "scene": 0,
    "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0, "rotation": [0, 0, 0, 1], "scale": [1, 2, 1], "children": []}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0, "mode": 4}]}],
    "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [1, 0.5, 0, 1]}}],
    "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
    "bufferViews": [{"buffer": 0, "byteLength": 36}],
    "buffers": [{"byteLength": 36, "uri": "data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}],
}
SCENE = {
    "schema_version": 1,
    "dataset": "ball",
    "fps": 25,
    "units": "mm",
    "up": "-z",
    "path": {"orbit": {"azimuth_deg": 3}},
    "world_from_model": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
    "levels": {"a": {"depth": "pm"}},
}


def read_placed(path: Path) -> None:
    read_model(path, Placement("mm", tuple(map(tuple, np.eye(4).tolist())), 2.0))


def read_scene(path: Path) -> None:
    _, problems = read_scene_file(path.parent)
    if problems:
        raise ValueError(problems[0])


NPY = (
    b"\x93NUMPY\x01\x00v\x00"
    + b"{'descr': '<f4', 'fortran_order': False, 'shape': (2, 2), }".ljust(117)
    + b"\n"
    + bytes(16)
)
COLMAP_IMAGE = (
    struct.pack("<QI7dI", 1, 1, 1.0, 0, 0, 0, 0, 0, 2.0, 7) + b"1.png\0" + struct.pack("<Qddq", 1, 3.0, 4.0, -1)
)


@cache
def png() -> bytes:
    file = io.BytesIO()
    Image.fromarray(np.zeros((6, 8, 3), np.uint8)).save(file, "png")
    return file.getvalue()


@cache
def film() -> bytes:
    """Ten frames of H.264 in MP4."""
    with tempfile.TemporaryDirectory() as folder:
        options = ["-v", "error", "-f", "lavfi", "-i", "testsrc=size=64x48:rate=25", "-frames:v", "10"]
        subprocess.run([get_ffmpeg_exe(), *options, "-pix_fmt", "yuv420p", f"{folder}/film.mp4"], check=True)
        return (Path(folder) / "film.mp4").read_bytes()


def packed_mesh() -> bytes:
    """A packed triangle."""
    corners = np.eye(3)
    return packed_bytes(Mesh(corners, np.arange(3)[None], corners, np.zeros((3, 3), np.uint8)))


READERS: dict[str, tuple[Callable[[Path], Any], str, Callable[[], bytes]]] = {
    "votes": (read_votes, "votes.csv", VOTES.encode),
    "items": (read_items, "items.csv", lambda: b"item,depth\nx,id\ny,pm\n"),
    "options": (lambda path: read_options(path, {}), "options.toml", OPTIONS.encode),
    "study": (lambda path: parse_study_file(path.read_text(encoding="utf-8")), "study.toml", STUDY.encode),
    "manifest": (read_stimulus_set, "manifest.json", json.dumps(MANIFEST).encode),
    "cloud": (read_cloud, "cloud.ply", PLY.encode),
    "mesh": (read_mesh, "mesh.ply", PLY.encode),
    "packed mesh": (read_mesh, "mesh.parquet", packed_mesh),
    "disparity": (read_disparity, "disparity.pfm", lambda: PFM),
    "disparity array": (read_disparity, "disparity.npy", lambda: NPY),
    "image": (read_image, "image.png", png),
    "depth map": (read_depth_values, "depth.npy", lambda: NPY),
    "model of COLMAP": (lambda path: colmap_with_cameras(path.parent), "images.bin", lambda: COLMAP_IMAGE),
    "capture": (lambda path: read_draft(path.parent), "capture.json", json.dumps(CAPTURE).encode),
    "camera path": (lambda path: read_path(path, 1, (96, 64)), "path.json", json.dumps(CAMERA_PATH).encode),
    "ply model": (read_placed, "model.ply", PLY.encode),
    "obj model": (read_placed, "model.obj", OBJ.encode),
    "gltf model": (read_placed, "model.gltf", json.dumps(GLTF).encode),
    "scene of models": (read_scene, "scene.json", json.dumps(SCENE).encode),
    "stimulus": (decode, "film.mp4", film),
    "recorded video": (lambda path: read_video_frame(path, 9), "film.mp4", film),
    "times of a video": (video_times, "film.mp4", film),
}


def colmap_with_cameras(folder: Path) -> Any:
    """Read the model of a folder whose images are given, with a camera for them."""
    (folder / "cameras.bin").write_bytes(struct.pack("<QIiQQ4d", 1, 7, 1, 96, 64, 80.0, 80.0, 48.0, 32.0))
    return colmap_model.read_model(folder)


SURPRISES = [b"", b"\0", b"\xff\xfe", b"-1", b"99999999999999999999", b"nan", b"1e999", b"[" * 50, b'"', b",", b"\n\n"]


def mutated(original: bytes) -> st.SearchStrategy[bytes]:
    """The original with some places cut, doubled or replaced by something surprising."""
    place = st.integers(0, len(original))
    change = st.tuples(place, st.integers(0, 12), st.sampled_from(SURPRISES) | st.binary(max_size=6))

    def apply(changes: list[tuple[int, int, bytes]]) -> bytes:
        content = original
        for at, length, new in changes:
            content = content[:at] + new + content[at + length :]
        return content

    return st.lists(change, min_size=1, max_size=4).map(apply) | st.binary(max_size=200)


def memory_kb() -> int:
    """The most that this process, or one that it waited for, has ever taken."""
    return max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def refuses_or_reads(read: Callable[[Path], Any], path: Path, content: bytes) -> None:
    path.write_bytes(content)
    started, before = time.monotonic(), memory_kb()
    sentence = "none"
    try:
        read(path)
    except REFUSALS as error:
        sentence = str(error)
    assert sentence
    assert time.monotonic() - started < LONGEST_S
    assert memory_kb() - before < MOST_MEMORY_KB


@pytest.mark.parametrize("name", sorted(READERS.keys() - {"manifest"}))  # whose videos would have to be there
def test_what_is_spoilt_below_is_good_at_first(name: str, tmp_path: Path) -> None:
    read, file, original = READERS[name]
    (tmp_path / file).write_bytes(original())
    read(tmp_path / file)


@pytest.mark.slow
@pytest.mark.parametrize("name", READERS)
def test_bad_files_are_refused_by_a_sentence(name: str, tmp_path: Path) -> None:
    read, file, good = READERS[name]
    original = good()

    @BOUNDED
    @example(b"")
    @example(original[: len(original) // 2])
    @given(mutated(original))
    def law(content: bytes) -> None:
        refuses_or_reads(read, tmp_path / file, content)

    law()


@pytest.mark.parametrize("file", ["cloud.ply", "image.png", "disparity.pfm"])
def test_a_header_that_promises_too_much_costs_no_memory(file: str, tmp_path: Path) -> None:
    huge = {
        "cloud.ply": (read_cloud, PLY.replace("vertex 3", "vertex 2000000000").encode()),
        "disparity.pfm": (read_disparity, b"Pf\n100000 100000\n-1.0\n" + bytes(24)),
        "image.png": (read_image, png()[:16] + (100_000).to_bytes(4, "big") * 2 + png()[24:]),
    }
    read, content = huge[file]
    (tmp_path / file).write_bytes(content)
    before = memory_kb()
    with pytest.raises(REFUSALS):
        read(tmp_path / file)
    assert memory_kb() - before < MOST_MEMORY_KB
