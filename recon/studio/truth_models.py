"""The true models as an approach, which is filmed as reconstructions are: `capture truth`.

Their colours are those that the studio's cameras saw, without its light: a texture holds the value of the studio's own
function of colour at each texel, and a texel is about a pixel of the sensors.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ground.file_models import SCHEMA_KEY, schema_name
from recon.capture.format import Capture, CaptureError
from recon.capture.recording import chosen_frames
from recon.geometry.mesh import Mesh, Texture
from recon.geometry.mesh_files import read_mesh, write_mesh
from recon.models.scene_file import SCENE_FILE
from recon.runtime.files import new_folder, read_json, write_json
from recon.studio.actors.atlas import lay_out
from recon.studio.synthesis import SynthParameters, restaged
from recon.studio.truth import FACTS, MESH

TRUTH = "truth"  # the approach whose models are true
SAME_MM = 0.1  # vertices of one version of the studio differ by rounding alone


def write_truth_models(capture: Capture, out: Path, frames: range | None = None) -> list[int]:
    """Write the true meshes, textured, as a folder of models; `render` films them on the path of the capture's sensors.

    Parameters
    ----------
    capture : a synthetic one
    out : the folder, which is made; `scene.json` names the capture by its path from there
    frames : those to write; None for all

    Returns
    -------
    numbers of the frames

    Raises
    ------
    CaptureError
        If the capture has no true meshes, or those of another version of the studio, none of the frames is in it, or
        `out` is not an empty folder.
    """
    meshes = {frame: capture.folder / MESH.format(frame=frame) for frame in range(capture.n_frames)}
    missing = [path for path in meshes.values() if not path.is_file()]
    if missing:
        raise CaptureError(f"{missing[0]}: there is no such mesh; only synthetic captures have true meshes")
    chosen = chosen_frames(capture.folder, range(capture.n_frames), frames)
    with new_folder(out) as folder:
        (folder / TRUTH).mkdir()
        for frame, mesh in _textured(capture, {frame: meshes[frame] for frame in chosen}):
            write_mesh(folder / TRUTH / f"{frame:04d}.glb", mesh)
        write_json(folder / SCENE_FILE, _scene(capture, out))
    return chosen


def _textured(capture: Capture, recorded: dict[int, Path]) -> Iterator[tuple[int, Mesh]]:
    """Give the recorded meshes the texture that the studio would show."""
    stage, texel_mm = restaged(_parameters(capture))
    atlas = lay_out(stage.places, stage.faces, stage.owners, texel_mm)
    looks, pixels = np.empty(0), np.empty((0, 0, 3), np.uint8)
    for frame, path in recorded.items():
        staged = stage.at(frame / capture.n_frames)
        mesh = read_mesh(path)
        if mesh.vertices.shape != staged.vertices.shape or np.abs(mesh.vertices - staged.vertices).max() > SAME_MM:
            raise CaptureError(f"{path}: another version of the studio recorded this; record it again")
        if not np.array_equal(looks, staged.looks):  # else nobody has moved an eyelid
            looks, pixels = staged.looks, stage.colours(staged, atlas.places, atlas.owners, texel_mm)
        kept, texture = atlas.kept, Texture(pixels, atlas.uv)
        yield frame, Mesh(mesh.vertices[kept], atlas.faces, mesh.normals[kept], mesh.colours[kept], texture)


def _parameters(capture: Capture) -> SynthParameters:
    values: dict[str, Any] = read_json(capture.folder / FACTS)["parameters"]
    arrays = {name: _tuples(value) for name, value in values.items() if isinstance(value, list)}
    return SynthParameters(**(values | arrays))


def _tuples(value: Any) -> Any:
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


def _scene(capture: Capture, out: Path) -> dict[str, object]:
    """Describe a folder of models that are in the world of a capture."""
    return {
        SCHEMA_KEY: schema_name("scene"),
        "schema_version": 1,
        "dataset": capture.name,
        "fps": capture.fps,
        "units": "m",  # of GLB
        "up": "y",
        "path": {"sensors_of": Path(os.path.relpath(capture.folder.resolve(), out.resolve())).as_posix()},
    }
