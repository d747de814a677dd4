"""Splats made of a mesh's surface, as flat discs in its colours, and their file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import Mesh
from recon.geometry.splats import Splats
from recon.models.splats.raw import constant_harmonics

LEAST = 1e-7  # of scales and of what an opacity lacks, whose logarithms are written


def splats_on(mesh: Mesh, n: int, *, seed: int = 0, overlap: float = 1.1) -> Splats:
    """Scatter flat splats over a mesh's triangles, larger ones where fewer are asked for."""
    rng = np.random.default_rng(seed)
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(crossed, axis=1) / 2
    chosen = rng.choice(len(areas), n, p=areas / areas.sum())
    u, v = np.sort(rng.uniform(size=(2, n)), axis=0)
    shares = np.stack([u, v - u, 1 - v], axis=1)[..., None]
    shades = (mesh.colours[mesh.faces[chosen]] * shares).sum(axis=1) / 255
    radius = overlap * np.sqrt(areas.sum() / n / np.pi)
    return Splats(
        (corners[chosen] * shares).sum(axis=1),
        np.tile([radius, radius, 0], (n, 1)),
        _upright(crossed[chosen] / (2 * areas[chosen, None])),
        np.full(n, 0.95),
        constant_harmonics(shades),
    )


def write_splats(path: Path, splats: Splats) -> Path:
    """Write splats as the original trainer does."""
    n_rest = splats.harmonics.shape[1] - 1
    rest = splats.harmonics[:, 1:].transpose(0, 2, 1).reshape(len(splats), -1)
    with np.errstate(divide="ignore"):
        logits = np.log(splats.opacities / np.maximum(1 - splats.opacities, LEAST))
    columns = {
        "x y z": splats.centres,
        "f_dc_0 f_dc_1 f_dc_2": splats.harmonics[:, 0],
        " ".join(f"f_rest_{number}" for number in range(3 * n_rest)): rest,
        "opacity": logits[:, None],
        "scale_0 scale_1 scale_2": np.log(np.maximum(splats.scales, LEAST)),
        "rot_0 rot_1 rot_2 rot_3": splats.rotations,
    }
    names = [name for line in columns for name in line.split()]
    header = "".join(f"property float {name}\n" for name in names)
    start = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(splats)}\n{header}end_header\n"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(start.encode() + np.hstack(list(columns.values())).astype("<f4").tobytes())
    return path


def _upright(normals: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return quaternions (N, 4) that turn z into unit vectors (N, 3)."""
    w = 1 + normals[:, 2]
    quaternions = np.column_stack([w, -normals[:, 1], normals[:, 0], np.zeros(len(normals))])
    quaternions[w < LEAST] = [0, 1, 0, 0]
    return np.asarray(quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True))
