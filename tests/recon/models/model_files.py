"""Small models as files, and what is read of them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import Mesh
from recon.models.read import Placement, read_model

EYE = tuple(map(tuple, np.eye(4).tolist()))
IN_MM = Placement("mm", EYE, splat_mm=2.0)
IN_METRES = Placement("m", tuple(map(tuple, np.diag([1000.0, 1000, 1000, 1]).tolist())))
RED, GREEN, BLUE = (200, 10, 10), (10, 200, 10), (10, 10, 200)
SQUARE = "v 0 0 0\nv 10 0 0\nv 10 10 0\nv 0 10 0\n"
PLACES = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
CORNERS = ["0 0 0", "10 0 0", "10 10 0", "0 10 0"]


def text_file(folder: Path, name: str, text: str) -> Path:
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


def picture(path: Path, colour: tuple[int, int, int], size: int = 8) -> None:
    assert cv2.imwrite(str(path), np.full((size, size, 3), colour[::-1], np.uint8))


def mesh_from(path: Path, placement: Placement = IN_MM) -> Mesh:
    model = read_model(path, placement).model
    assert isinstance(model, Mesh)
    return model


def texels(mesh: Mesh) -> NDArray[np.uint8]:
    """The colour of the texture in the middle of each face, (M, 3)."""
    assert mesh.texture is not None
    height, width = mesh.texture.pixels.shape[:2]
    uv = mesh.texture.uv[mesh.faces].mean(axis=1) % 1
    return mesh.texture.pixels[((1 - uv[:, 1]) * height).astype(int), (uv[:, 0] * width).astype(int)]


def textured_obj(folder: Path) -> Path:
    """Two textured squares and one of a plain colour, the first wrapped twice around its texture."""
    picture(folder / "skin of a.png", RED)
    picture(folder / "b.png", GREEN, size=16)
    text_file(
        folder,
        "my materials.mtl",
        "newmtl a\nKd 0 0 0\nmap_Kd -clamp off skin of a.png\nnewmtl b\nmap_Kd b.png\nnewmtl c\nKd 0.04 0.04 0.8\n",
    )
    faces = "usemtl a\nf 1/5 2/6 3/7\nusemtl b\nf 1/1/ 3/3/ 4/4/\nusemtl c\nf 4 3 2 1\n"
    wrapped = "vt 0 0\nvt 2 0\nvt 2 2\n"
    return text_file(folder, "a.obj", "mtllib my materials.mtl\n" + SQUARE + PLACES + wrapped + faces)
