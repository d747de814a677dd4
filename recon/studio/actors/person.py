"""A person at rest as a mesh: clothes and hair laid over the parts, bones bound, folds that a pose will deepen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.studio.actors.implicit import FineCells, Part, body_mesh, clearances, group_distances, part_table
from recon.studio.actors.skeleton import BONES, vertex_normals
from recon.studio.light.appearance import garment_edges, person_folds, person_relief

BLEND_MM, FINGER_BLEND_MM = 22.0, 5.0  # width over which a vertex passes from one bone to the next
FINGER_BONES = ("fingers_l", "fingers_r", "tips_l", "tips_r")
MOUTH_Y = 1596.0
HANDS_AND_HEAD = FineCells((475.0, 545.0), (1485.0, 1530.0), 930.0, 0.42, 0.5)
CLOTH_MM = 15.0  # edge of triangles that folds of cloth need
EDGE_BAND_MM = 11.0  # around hems, cuffs and collars, where triangles are small
# Joints whose bending folds cloth, as the two bones that meet there, and the bend, radians, that folds it to the full.
FOLDING = (
    ("upper_arm_l", "forearm_l", 1.4),
    ("upper_arm_r", "forearm_r", 1.4),
    ("chest", "upper_arm_l", 0.7),
    ("chest", "upper_arm_r", 0.7),
    ("pelvis", "chest", 0.35),
    ("pelvis", "thigh_l", 0.5),
    ("pelvis", "thigh_r", 0.5),
    ("thigh_l", "shin_l", 0.6),
    ("thigh_r", "shin_r", 0.6),
)
FOLD_SHADE = 0.045  # share of the sky that a millimetre of a fold's depth hides


@dataclass(frozen=True, eq=False)
class RestBody:
    """A triangulated person at rest.

    Parameters
    ----------
    vertices : float64 (N, 3), mm, rest frame
    places : float64 (N, 3), mm, under clothes and hair, where `appearance` finds the colour of a vertex
    faces : int32 (M, 3)
    normals : float64 (N, 3)
    bones : int64 (N, 4), indices into BONES
    weights : float64 (N, 4), rows sum to one
    openness : float32 (N,), share of the sky that a vertex sees, 0 to 1
    folds : float32 (N, len(FOLDING) + 1), mm along the normal, by which bent joints move cloth; the last always does
    """

    vertices: NDArray[np.float64]
    places: NDArray[np.float64]
    faces: NDArray[np.int32]
    normals: NDArray[np.float64]
    bones: NDArray[np.int64]
    weights: NDArray[np.float64]
    openness: NDArray[np.float32]
    folds: NDArray[np.float32]


def rest_body(parts: list[Part], look: NDArray[np.float64], *, cell: float, noise: NDArray[np.float32]) -> RestBody:
    """Triangulate a person, lay clothes and hair over it, and bind it to the bones.

    Parameters
    ----------
    look : float64 (N_LOOK,), says which clothes and hair
    cell : mm, edge of the triangles on the trunk; the face's are a third as long
    noise : float32 (S, S, S), periodic, for locks and folds
    """
    table = part_table(parts)
    places, faces = body_mesh(table, cell, _wanted_edge(cell, look), HANDS_AND_HEAD)
    normals = vertex_normals(places, faces)
    bones, weights = _bind(parts, table, places)
    vertices = places + person_relief(places, look, noise)[:, None] * normals
    return RestBody(
        vertices, places, faces, vertex_normals(vertices, faces), bones, weights,
        _openness(table, places, normals), person_folds(places, look, noise),
    )  # fmt: skip


def fold_depths(body: RestBody, transforms: NDArray[np.float64]) -> NDArray[np.float32]:
    """Compute how far a pose's bent joints move cloth along its normals, float32 (N,), mm.

    Parameters
    ----------
    transforms : float64 (B, 3, 4), see `skeleton.pose`
    """
    turns = transforms[:, :, :3]
    bends = []
    for first, second, full in FOLDING:
        cosine = (np.sum(turns[BONES.index(first)] * turns[BONES.index(second)]) - 1.0) / 2.0
        bends.append(min(1.2, float(np.arccos(np.clip(cosine, -1.0, 1.0))) / full))
    return np.asarray(body.folds @ np.array([*bends, 1.0], np.float32))


def _wanted_edge(cell: float, look: NDArray[np.float64]) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """Return the wanted edges: short in the face and at the edges of clothes, else as they are."""

    def wanted(places: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y, z = np.abs(places[:, 0]), places[:, 1], places[:, 2]
        face = (y > 1545.0) & (y < 1715.0) & (z > 55.0) & (x < 70.0)
        edge = garment_edges(places, look) < EDGE_BAND_MM
        return np.select(
            [face, edge], [0.36 * cell, 0.42 * cell], np.where(y > 890.0, max(1.15 * cell, CLOTH_MM), 2.0 * cell)
        )

    return wanted


def _openness(
    table: NDArray[np.float64], vertices: NDArray[np.float64], normals: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Estimate the ambient light that reaches each vertex from distances along its normal."""
    reaches = (12.0, 35.0, 90.0)
    hidden = np.clip(1.0 - clearances(table, vertices, normals, reaches) / reaches, 0.0, 1.0)
    return np.asarray(np.clip(1.0 - hidden @ (0.30, 0.40, 0.45), 0.15, 1.0), np.float32)


def _bind(
    parts: list[Part], table: NDArray[np.float64], vertices: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the four strongest bones of each vertex and their weights."""
    owner = np.array([-1 if part.carve else BONES.index(part.bone) for part in parts])
    to_bone = group_distances(table, owner, len(BONES), vertices)
    nearest = to_bone.argmin(axis=1)
    blend = np.where(np.isin(nearest, [BONES.index(bone) for bone in FINGER_BONES]), FINGER_BLEND_MM, BLEND_MM)
    weights = np.exp(-(to_bone - to_bone.min(axis=1, keepdims=True)) / blend[:, None])
    _open_jaw(vertices, weights)
    bones = np.argsort(-weights, axis=1, kind="stable")[:, :4]
    strongest = np.take_along_axis(weights, bones, axis=1)
    return bones, strongest / strongest.sum(axis=1, keepdims=True)


def _open_jaw(vertices: NDArray[np.float64], weights: NDArray[np.float64]) -> None:
    """Hand the lower face from head to jaw, sharply between the lips and softly at their corners and in the cheeks."""
    x, y, z = np.abs(vertices[:, 0]), vertices[:, 1], vertices[:, 2]
    softness = 2.0 + 28.0 * np.minimum(x / 34.0, 1.0) ** 2
    lower = np.clip((MOUTH_Y - 0.5 - y) / softness + 0.5, 0.0, 1.0)
    share = lower * np.clip((z + 5.0) / 50.0, 0.0, 1.0) * np.clip((y - 1535.0) / 15.0, 0.0, 1.0)
    head, jaw = BONES.index("head"), BONES.index("jaw")
    weights[:, jaw] = weights[:, head] * share
    weights[:, head] *= 1.0 - share
