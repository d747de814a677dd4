"""Wavefront OBJ with its material, which most programs of this kind read: text, one picture as the texture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

MATERIAL = "textured"
VECTOR = "%.9g %.9g %.9g"  # nine digits bring every float32 back


def obj_text(
    vertices: NDArray[np.float32],
    faces: NDArray[np.int32],
    normals: NDArray[np.float32],
    uv: NDArray[np.float32],
    library: str,
) -> str:
    """Write a textured mesh as OBJ, in the unit of its vertices.

    Parameters
    ----------
    vertices : float32 (N, 3)
    faces : int32 (M, 3)
    normals : float32 (N, 3), unit length
    uv : float32 (N, 2), (0, 0) is the lower left corner of the picture
    library : name of the file with its material, beside it
    """
    corners = np.repeat(faces + 1, 3, axis=1)  # place, texture and normal of a corner have one number
    rows = [f"mtllib {library}"]
    rows += map(f"v {VECTOR}".__mod__, map(tuple, vertices.tolist()))
    rows += map("vt %.9g %.9g".__mod__, map(tuple, uv.tolist()))
    rows += map(f"vn {VECTOR}".__mod__, map(tuple, normals.tolist()))
    rows.append(f"usemtl {MATERIAL}")
    rows += map("f %d/%d/%d %d/%d/%d %d/%d/%d".__mod__, map(tuple, corners.tolist()))
    return "\n".join(rows) + "\n"


def mtl_text(picture: str) -> str:
    """Write the material: a picture beside it, without gloss."""
    return f"newmtl {MATERIAL}\nKa 0 0 0\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {picture}\n"
