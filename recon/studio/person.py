"""A person's shape at rest: parts, clothes, and which bone carries which vertex.

Everything is in the rest frame of `skeleton.JOINTS`: a person 1780 mm tall, arms away from the body, facing +z,
whose left is +x.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from recon.studio.implicit import Part, body_mesh, distance, part_distances, part_table
from recon.studio.skeleton import BONES, REST, vertex_normals

ARM = np.array([0.683, -0.730, 0.03])  # direction of the left arm at rest
BACK_OF_HAND = np.array([0.73, 0.683, 0.0])
BUST_BONES = {"chest", "neck", "head", "upper_arm_l", "upper_arm_r"}
BLEND_MM = 22.0  # width over which a vertex passes from one bone to the next
MOUTH_Y = 1596.0
HEM_Y = 905.0  # where the shirt ends


@dataclass(frozen=True)
class Build:
    """How one person differs from another.

    Parameters
    ----------
    height : mm
    girth : factor on the radii of trunk and limbs
    shoulders, hips : factors on the widths
    long_hair : hair down to the shoulders
    bust : only head, neck, shoulders and upper arms
    """

    height: float = 1780.0
    girth: float = 1.0
    shoulders: float = 1.0
    hips: float = 1.0
    long_hair: bool = False
    bust: bool = False


@dataclass(frozen=True, eq=False)
class RestBody:
    """A triangulated person at rest.

    Parameters
    ----------
    vertices : float64 (N, 3), mm, rest frame
    faces : int32 (M, 3)
    bones : int64 (N, 4), indices into BONES
    weights : float64 (N, 4), rows sum to one
    openness : float32 (N,), share of the sky that a vertex sees, 0 to 1
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    bones: NDArray[np.int64]
    weights: NDArray[np.float64]
    openness: NDArray[np.float32]


def person_parts(build: Build) -> list[Part]:
    """List all parts of a clothed person, from the trunk outwards; the order is that of the smooth union."""
    g, hips, shoulders = build.girth, build.hips, build.shoulders
    trunk = [
        Part("pelvis", (0, 955, -4), None, (150 * g * hips, 120, 108 * g), 60),
        Part("spine", (0, 1085, 2), None, (138 * g, 130, 100 * g), 60),
        Part("chest", (0, 1270, -2), None, (158 * g * shoulders, 190, 112 * g), 60),
        Part("chest", (-120 * shoulders, 1412, -18), (120 * shoulders, 1412, -18), (58, 58), 60),
        Part("neck", (0, 1440, -24), (0, 1565, -4), (55 * g, 51 * g), 30),
    ]
    sided = [
        Part("pelvis", (72 * hips, 915, -55), None, (82 * g, 85, 70 * g), 50),
        Part("chest", (72, 1325, 62), None, (78 * shoulders, 62, 42 * g), 60),
        Part("neck", (105, 1436, -28), (22, 1488, -26), (32, 40), 50),
        *_arm(g),
        *_leg(g, hips),
    ]
    parts = [*trunk, *_both(sided), *head_parts(ears=not build.long_hair), *(_long_hair() if build.long_hair else [])]
    return [part for part in parts if part.bone in BUST_BONES] if build.bust else parts


def head_parts(*, ears: bool) -> list[Part]:
    """List skull and face, and ears where hair does not cover them; the features are 2 to 10 mm deep."""
    middle = [
        Part("head", (0, 1690, -10), None, (76, 90, 96), 20),
        Part("head", (0, 1640, 28), None, (63, 88, 66), 30),
        Part("head", (0, 1592, 36), None, (50, 40, 52), 30),
        Part("head", (0, 1566, 72), None, (24, 15, 17), 22),
        Part("head", (0, 1725, 40), None, (58, 38, 48), 30),
        Part("head", (0, 1674, 88), (0, 1634, 109), (7, 10), 14),
        Part("head", (0, 1630, 110), None, (11, 10, 11), 8),
        Part("head", (0, 1602, 89), None, (25, 7, 11), 7),
        Part("head", (0, 1588.5, 88), None, (21, 7.5, 11), 7),
    ]
    sided = [
        Part("head", (10, 1686, 89), (40, 1689, 76), (8, 7.5), 22),
        Part("head", (40, 1689, 76), (57, 1676, 50), (7.5, 9), 22),
        Part("head", (41, 1640, 62), None, (26, 25, 24), 25),
        Part("head", (32, 1667, 100), None, (21, 12, 15), 16, carve=True),
        Part("head", (32, 1667, 76), None, (13.5, 12.5, 13.5), 4),
        Part("head", (10, 1627, 101), None, (8, 8, 10), 6),
    ]
    ear = [
        Part("head", (77, 1652, -8), None, (8, 31, 19), 7, turn=_ear_turn()),
        Part("head", (84, 1656, -4), None, (6, 18, 9), 5, turn=_ear_turn(), carve=True),
    ]
    return [*middle, *_both(sided), *(_both(ear) if ears else [])]


def _long_hair() -> list[Part]:
    sides = [
        Part("head", (58, 1690, -26), (68, 1575, -30), (34, 29), 30),
        Part("head", (68, 1575, -30), (60, 1528, -38), (29, 20), 24),
    ]
    return [Part("head", (0, 1610, -58), None, (74, 104, 44), 40), *_both(sides)]


def rest_body(parts: list[Part], *, cell: float, noise: NDArray[np.float32]) -> RestBody:
    """Triangulate a person, lay clothes and hair over it, and bind it to the bones.

    Parameters
    ----------
    cell : mm, edge of the triangles on the trunk; the face's are a third as long
    noise : float32 (S, S, S), periodic, for folds
    """
    table = part_table(parts)
    vertices, faces = body_mesh(table, cell, _wanted_edge(cell))
    normals = vertex_normals(vertices, faces)
    openness = _openness(table, vertices, normals)
    bones, weights = _bind(parts, table, vertices)
    vertices = vertices + cloth_thickness(vertices, noise)[:, None] * normals
    return RestBody(vertices, faces, bones, weights, openness)


def cloth_thickness(points: NDArray[np.float64], noise: NDArray[np.float32]) -> NDArray[np.float64]:
    """Compute how far clothes and hair stand off the body at points (N, 3): float64 (N,), mm."""
    x, y, z = np.abs(points[:, 0]), points[:, 1], points[:, 2]
    along = (x - 180.0) * ARM[0] + (y - 1412.0) * ARM[1]
    hand = _step(along, 500.0, 512.0) * (x > 250)
    collar = np.maximum(1452.0 - 0.5 * z - y, np.hypot(x, z + 18.0) - 84.0)
    shirt = _step(collar, -4.0, 4.0) * (1 - hand) * (y < 1515.0)
    trousers = _step(HEM_Y - y, -4.0, 4.0) * (x < 260)
    shoe = _step(78.0 - y, -4.0, 4.0)
    folds = _folds(points, noise)
    cloth = shirt * (1 - shoe) * (5.0 + 4.5 * folds) - trousers * (1 - shoe) * 6.0 - shoe * 3.0
    return np.asarray(cloth + hair(points) * (11.0 + 4.0 * _sample(noise, points / (9.0, 26.0, 9.0))))


def hair(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute how full the hair is, float64 (N,), 0 to 1, at points (N, 3); `appearance` colours the same region."""
    x, y, z = np.abs(points[:, 0]), points[:, 1], points[:, 2]
    line = 1731.0 - 0.004 * x * x - 1.15 * np.maximum(0.0, 42.0 - z) - 0.35 * np.maximum(0.0, -10.0 - z)
    around_ears = 1588.0 + 102.0 * (_step(z, -50.0, -28.0) - 0.3 * _step(z, 14.0, 26.0)) * _step(x, 52.0, 62.0)
    return np.asarray(_step(y - np.maximum(line, around_ears), -3.0, 26.0) * (x < 125))


def _arm(g: float) -> list[Part]:
    shoulder, elbow, wrist = REST["upper_arm_l"], REST["forearm_l"], REST["hand_l"]
    across = np.cross(ARM, BACK_OF_HAND)  # towards the thumb
    across = across / np.linalg.norm(across) * (1.0 if across[2] > 0 else -1.0)
    palm = np.stack([ARM, across, BACK_OF_HAND], axis=1)
    knuckle = wrist + 88.0 * ARM
    fingers = [
        Part(
            "hand_l",
            tuple(knuckle + offset * across),
            tuple(_finger_end(knuckle, across, offset, length)),
            (8.6, 7.0),
            12,
        )
        for offset, length in ((27.0, 74.0), (9.0, 84.0), (-9.0, 78.0), (-26.0, 62.0))
    ]
    thumb = wrist + 30.0 * ARM + 30.0 * across
    return [
        Part("upper_arm_l", tuple(shoulder), None, (53 * g, 52 * g, 52 * g), 40),
        Part("upper_arm_l", tuple(shoulder), tuple(elbow), (51 * g, 43 * g), 40),
        Part("forearm_l", tuple(elbow), tuple(wrist), (43 * g, 29 * g), 20),
        Part("forearm_l", tuple(0.72 * elbow + 0.28 * wrist), None, (46 * g, 46 * g, 44 * g), 30),
        Part("hand_l", tuple(wrist + 46.0 * ARM), None, (54, 41, 17), 18, turn=palm),
        *fingers,
        Part("hand_l", tuple(thumb), tuple(thumb + 52.0 * ARM + 26.0 * across), (13, 8.5), 14),
    ]


def _finger_end(
    knuckle: NDArray[np.float64], across: NDArray[np.float64], offset: float, length: float
) -> NDArray[np.float64]:
    return np.asarray(knuckle + length * ARM + 1.45 * offset * across - 0.28 * length * BACK_OF_HAND)


def _leg(g: float, hips: float) -> list[Part]:
    return [
        Part("thigh_l", (94 * hips, 890, -5), (106, 505, 6), (88 * g * hips, 62 * g), 40),
        Part("shin_l", (107, 500, 8), (114, 100, -20), (61 * g, 47 * g), 30),
        Part("shin_l", (110, 390, -22), None, (52 * g, 110, 52 * g), 40),
        Part("foot_l", (114, 46, -48), (126, 38, 118), (43, 36), 12),
        Part("foot_l", (116, 80, -22), (119, 58, 50), (42, 36), 20),
    ]


def _both(parts: list[Part]) -> list[Part]:
    return [side for part in parts for side in (part, part.mirrored())]


def _ear_turn() -> NDArray[np.float64]:
    c, s = np.cos(0.45), np.sin(0.45)
    return np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])


def _wanted_edge(cell: float) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """Return the wanted edges: as they are on the trunk, half at hands and head, a quarter in the face."""

    def wanted(places: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y, z = np.abs(places[:, 0]), places[:, 1], places[:, 2]
        fine = (y > 1500.0) & (x < 130.0) | (x > 535.0)
        finest = (y > 1545.0) & (y < 1715.0) & (z > 55.0) & (x < 70.0) | (x > 600.0)
        return np.select([finest, fine], [0.36 * cell, 0.72 * cell], 2.0 * cell)

    return wanted


def _openness(
    table: NDArray[np.float64], vertices: NDArray[np.float64], normals: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Estimate the ambient light that reaches each vertex from distances along its normal."""
    closed = np.zeros(len(vertices))
    for reach, weight in ((12.0, 0.30), (35.0, 0.40), (90.0, 0.45)):
        closed += weight * np.clip(1.0 - distance(table, vertices + reach * normals) / reach, 0.0, 1.0)
    return np.clip(1.0 - closed, 0.15, 1.0).astype(np.float32)


def _bind(
    parts: list[Part], table: NDArray[np.float64], vertices: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the four strongest bones of each vertex and their weights."""
    to_part = part_distances(table, vertices)
    owner = np.array([BONES.index(part.bone) for part in parts])
    carved = np.array([part.carve for part in parts])
    to_bone = np.full((len(vertices), len(BONES)), np.inf)
    for bone in range(len(BONES)):
        mine = (owner == bone) & ~carved
        if mine.any():
            to_bone[:, bone] = to_part[:, mine].min(axis=1)
    weights = np.exp(-(to_bone - to_bone.min(axis=1, keepdims=True)) / BLEND_MM)
    _open_jaw(vertices, weights)
    bones = np.argsort(-weights, axis=1, kind="stable")[:, :4]
    strongest = np.take_along_axis(weights, bones, axis=1)
    return bones, strongest / strongest.sum(axis=1, keepdims=True)


def _open_jaw(vertices: NDArray[np.float64], weights: NDArray[np.float64]) -> None:
    """Hand the lower face from head to jaw, sharply between the lips and softly in the cheeks."""
    x, y, z = np.abs(vertices[:, 0]), vertices[:, 1], vertices[:, 2]
    softness = 2.0 + 28.0 * np.clip((x - 18.0) / 22.0, 0.0, 1.0)
    lower = np.clip((MOUTH_Y - 0.5 - y) / softness + 0.5, 0.0, 1.0)
    share = lower * np.clip((z + 5.0) / 50.0, 0.0, 1.0) * np.clip((y - 1535.0) / 15.0, 0.0, 1.0)
    head, jaw = BONES.index("head"), BONES.index("jaw")
    weights[:, jaw] = weights[:, head] * share
    weights[:, head] *= 1.0 - share


def _folds(points: NDArray[np.float64], noise: NDArray[np.float32]) -> NDArray[np.float64]:
    """Compute creases of cloth (N,), about -1 to 1: ridged noise, drawn out across the pull of the cloth."""
    warp = 14.0 * np.stack([_sample(noise, points / 60.0 + shift) for shift in (3.1, 17.7, 31.3)], axis=1)
    broad = _sample(noise, (points + warp) / (55.0, 34.0, 55.0))
    fine = 1.0 - 2.0 * np.abs(_sample(noise, (points + warp) / (38.0, 17.0, 38.0) + 9.0))
    return np.asarray(0.6 * broad + 0.4 * fine)


def _sample(noise: NDArray[np.float32], points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(map_coordinates(noise, points.T, order=1, mode="grid-wrap"), dtype=np.float64)


def _step(value: NDArray[np.float64], low: float, high: float) -> NDArray[np.float64]:
    t = np.clip((value - low) / (high - low), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))
