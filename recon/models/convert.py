"""Models of any format written anew: meshes, clouds, and splats, each as what it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from recon.geometry.glb import GltfScene, png_of
from recon.geometry.mesh import Discs, Mesh, Model
from recon.geometry.mesh_files import write_cloud, write_mesh
from recon.models.folder import frames_in
from recon.models.read import GLTF_SUFFIXES, MODEL_SUFFIXES, Placement, ReadModel, read_model
from recon.models.shape import GLTF_MM
from recon.models.splats.ply import write_splat_ply
from recon.runtime.files import new_folder, write_bytes, write_json
from recon.runtime.workers import Progress

SEQUENCE, TIMES = "sequence.gltf", "times.bin"
DEFAULT_FPS = 25.0  # of models that no recording tells of
ANY_RADIUS_MM = 1.0  # of points, which are written as points


def read_as_it_stands(path: Path) -> ReadModel:
    """Read a model in its own axes and unit, glTF in mm; a ValueError as of `read_model`."""
    scale = GLTF_MM if path.suffix.lower() in GLTF_SUFFIXES else 1.0
    matrix = np.diag([scale, scale, scale, 1.0])
    return read_model(path, Placement("mm", tuple(map(tuple, matrix.tolist())), ANY_RADIUS_MM))


def write_model(path: Path, model: Model) -> Path:
    """Write a mesh as PLY, GLB or OBJ, a cloud as PLY, and splats as the PLY of their trainer.

    A ValueError says that the format cannot hold the model.
    """
    if isinstance(model, Mesh):
        return write_mesh(path, model)
    if isinstance(model, Discs):
        if path.suffix.lower() != ".ply":
            raise ValueError(f"{path}: the model is points without faces, which are written as .ply")
        return write_cloud(path, model.cloud)
    return write_splat_ply(path, model)


def write_sequence(out: Path, folder: Path, fps: float, progress: Progress) -> tuple[int, list[str]]:
    """Write the meshes of a folder as one glTF that shows them in turn, in a new folder.

    Returns how many, and what was found in them: a sentence once, with the first file it is true of.

    `sequence.gltf` names a buffer and a picture for each frame, `0000.bin` and `0000.png`, so that one mesh at a time
    is in memory.

    Parameters
    ----------
    out : folder, absent or empty
    folder : of numbered models
    fps : frames a second
    progress : told after each frame

    Raises
    ------
    ValueError
        If there is no mesh, a model has no faces, numbers are missing, or `out` has the name of a model.
    """
    if out.suffix.lower() in MODEL_SUFFIXES:
        raise ValueError(f"{out}: expected the name of a folder, which gets a {SEQUENCE} with files for each frame")
    problems: list[str] = []
    paths = frames_in(folder, problems)
    if problems or not paths:
        raise ValueError("; ".join(problems) or f"{folder}: holds no models with numbers, such as 0000.ply")
    scene, warnings = GltfScene(), dict[str, Path]()
    with new_folder(out) as made:
        for number, path in enumerate(paths):
            read = read_as_it_stands(path)
            mesh = read.model
            warnings |= {warning: path for warning in read.warnings if warning not in warnings}
            if not isinstance(mesh, Mesh):
                raise ValueError(f"{path}: holds no faces; a sequence is one of meshes")
            picture = f"{number:04d}.png"
            if mesh.texture is not None:
                write_bytes(made / picture, png_of(mesh.texture))
            scene.add(mesh, uri=picture)
            write_bytes(made / f"{number:04d}.bin", scene.next_buffer())
            progress("frames", number + 1, len(paths))
        scene.show_in_turn(fps)
        write_bytes(made / TIMES, scene.next_buffer())
        uris = [*(f"{number:04d}.bin" for number in range(len(paths))), TIMES]
        write_json(made / SEQUENCE, scene.document(uris))
    return len(paths), [f"{path}: {warning}" for warning, path in warnings.items()]


def size_of(model: Model) -> tuple[int, int]:
    """Return the numbers of vertices, points or splats, and of faces."""
    if isinstance(model, Mesh):
        return len(model.vertices), len(model.faces)
    return (len(model.cloud) if isinstance(model, Discs) else len(model.centres)), 0
