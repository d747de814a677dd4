"""Bones and poses: how an actor's rest shape moves.

A pose gives every bone a rotation and its joint a place; a vertex follows the bones by its weights
(linear blend skinning). At rest all bones have the identity as rotation, so a bone's transform is
`p -> R (p - joint at rest) + joint`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from recon.geometry.normals import area_vectors, vector_sums

Vector = NDArray[np.float64]

REST_HEIGHT_MM = 1780.0
# Joints of a person of this height who stands with the arms 47 degrees away from the body, facing +z.
# Bone lengths over height: arm 0.16, forearm 0.145, thigh 0.24, shin 0.23 (after Drillis and Contini 1966).
JOINTS: dict[str, tuple[float, float, float]] = {
    "pelvis": (0.0, 960.0, 0.0),
    "spine": (0.0, 1050.0, 0.0),
    "chest": (0.0, 1180.0, -5.0),
    "neck": (0.0, 1465.0, -18.0),
    "head": (0.0, 1560.0, -2.0),
    "jaw": (0.0, 1630.0, 8.0),
    "upper_arm_l": (180.0, 1412.0, -15.0),
    "forearm_l": (378.0, 1200.0, -20.0),
    "hand_l": (552.0, 1014.0, -6.0),
    "fingers_l": (615.0, 947.0, -3.0),
    "tips_l": (638.0, 908.0, -2.0),
    "thigh_l": (92.0, 925.0, -5.0),
    "shin_l": (108.0, 500.0, 8.0),
    "foot_l": (114.0, 88.0, -22.0),
    "upper_arm_r": (-180.0, 1412.0, -15.0),
    "forearm_r": (-378.0, 1200.0, -20.0),
    "hand_r": (-552.0, 1014.0, -6.0),
    "fingers_r": (-615.0, 947.0, -3.0),
    "tips_r": (-638.0, 908.0, -2.0),
    "thigh_r": (-92.0, 925.0, -5.0),
    "shin_r": (-108.0, 500.0, 8.0),
    "foot_r": (-114.0, 88.0, -22.0),
}
ARM = np.array([0.683, -0.730, 0.03])  # direction of the left arm at rest
BACK_OF_HAND = np.array([0.73, 0.683, 0.0])
ACROSS = np.array([-0.02, 0.022, 1.0])  # over the left hand, towards the thumb
KNUCKLES_MM = 92.0  # from the wrist, along the arm
BONES = tuple(JOINTS)
REST = {bone: np.array(joint) for bone, joint in JOINTS.items()}
PALM = {"l": np.array([-0.73, -0.68, 0.0]), "r": np.array([0.73, -0.68, 0.0])}  # the palm's outward normal at rest
MAX_TWIST = 1.75  # radians, of a hand about the forearm
FULL_TWIST_SINE = 0.5  # of the angle between forearm and target; nearer to the axis the hand turns less
RELAXED_CURL_DEG = 14.0  # of a hand that does nothing
MAX_WRIST_BEND = 1.1  # radians, of a hand away from its forearm
FULL_REACH = 0.985  # of the limb's length: a knee or elbow never locks


@dataclass(frozen=True)
class Controls:
    """The controls of an animation, in the frame of a person 1780 mm tall who faces +z.

    Parameters
    ----------
    pelvis : mm, displacement from standing
    pelvis_turn, spine_turn, head_turn : degrees about x (nod), y (turn to the left), z (tilt to the right);
        the spine's is shared by two bones, the head's by neck and head
    hands : wrist positions by side "l", "r", mm; a missing one hangs
    palms : a point that the palm faces, by side, mm
    pointing : direction of the straight fingers, by side; a missing one goes on where the forearm points
    feet : displacement of the feet from standing by side, mm
    jaw : degrees that the mouth is open
    curl : degrees that the fingers bend at the knuckles, and as much again at the middle joints, by side
    """

    pelvis: ArrayLike = (0.0, 0.0, 0.0)
    pelvis_turn: ArrayLike = (0.0, 0.0, 0.0)
    spine_turn: ArrayLike = (0.0, 0.0, 0.0)
    head_turn: ArrayLike = (0.0, 0.0, 0.0)
    hands: Mapping[str, ArrayLike] = field(default_factory=dict)
    palms: Mapping[str, ArrayLike] = field(default_factory=dict)
    pointing: Mapping[str, ArrayLike] = field(default_factory=dict)
    feet: Mapping[str, ArrayLike] = field(default_factory=dict)
    jaw: float = 0.0
    curl: Mapping[str, float] = field(default_factory=dict)


def rotation(turn_deg: ArrayLike) -> Vector:
    """Return the rotation, float64 (3, 3), about x, then z, then y by angles (x, y, z) in degrees."""
    x, y, z = np.radians(np.asarray(turn_deg, dtype=np.float64))
    cx, sx, cy, sy, cz, sz = np.cos(x), np.sin(x), np.cos(y), np.sin(y), np.cos(z), np.sin(z)
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return np.asarray(about_y @ about_z @ about_x)


def axis_rotation(axis: ArrayLike, angle: float) -> Vector:
    """Return the rotation, float64 (3, 3), by `angle` radians about `axis` (Rodrigues)."""
    x, y, z = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)


def rotation_between(a: Vector, b: Vector, largest: float = np.pi) -> Vector:
    """Return the smallest rotation, float64 (3, 3), that turns one direction into another.

    Parameters
    ----------
    a, b : float64 (3,), the directions
    largest : radians; it turns no farther on its way to `b`
    """
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    axis = np.cross(a, b)
    sine = np.linalg.norm(axis)
    if sine < 1e-9:
        return np.eye(3)
    return axis_rotation(axis, min(largest, float(np.arctan2(sine, a @ b))))


def pose(controls: Controls) -> NDArray[np.float64]:
    """Compute bone transforms, float64 (B, 3, 4), in the order of BONES: person's frame from rest frame."""
    turns: dict[str, Vector] = {}
    joints: dict[str, Vector] = {}
    _pose_trunk(controls, turns, joints)
    for side in ("l", "r"):
        _pose_arm(controls, side, turns, joints)
        _pose_leg(controls, side, turns, joints)
    return np.stack([_transform(turns[bone], REST[bone], joints[bone]) for bone in BONES])


def _transform(turn: Vector, rest: Vector, joint: Vector) -> Vector:
    return np.concatenate([turn, (joint - turn @ rest)[:, None]], axis=1)


def _pose_trunk(controls: Controls, turns: dict[str, Vector], joints: dict[str, Vector]) -> None:
    half_spine, half_head = rotation(np.divide(controls.spine_turn, 2)), rotation(np.divide(controls.head_turn, 2))
    turns["pelvis"] = rotation(controls.pelvis_turn)
    joints["pelvis"] = REST["pelvis"] + np.asarray(controls.pelvis)
    for bone, parent, turn in (
        ("spine", "pelvis", half_spine),
        ("chest", "spine", half_spine),
        ("neck", "chest", half_head),
        ("head", "neck", half_head),
        ("jaw", "head", rotation((controls.jaw, 0, 0))),
    ):
        turns[bone] = turns[parent] @ turn
        joints[bone] = joints[parent] + turns[parent] @ (REST[bone] - REST[parent])


def _pose_arm(controls: Controls, side: str, turns: dict[str, Vector], joints: dict[str, Vector]) -> None:
    upper, fore, hand = f"upper_arm_{side}", f"forearm_{side}", f"hand_{side}"
    out = 1.0 if side == "l" else -1.0
    chest = turns["chest"]
    shoulder = joints["chest"] + chest @ (REST[upper] - REST["chest"])
    hanging = shoulder + chest @ np.array([out * 95.0, -505.0, 45.0])
    wrist = np.asarray(controls.hands.get(side, hanging), dtype=np.float64)
    pole = chest @ np.array([out * 0.75, -0.55, -0.6])  # elbows point outwards, down and back
    elbow, wrist = _two_bones(shoulder, wrist, REST[fore] - REST[upper], REST[hand] - REST[fore], pole)
    turns[upper] = rotation_between(chest @ (REST[fore] - REST[upper]), elbow - shoulder) @ chest
    turns[fore] = rotation_between(turns[upper] @ (REST[hand] - REST[fore]), wrist - elbow) @ turns[upper]
    along = wrist - elbow
    flexion = rotation_between(along, np.asarray(controls.pointing.get(side, along)), MAX_WRIST_BEND)
    turns[hand] = flexion @ turns[fore]
    if side in controls.palms:
        twist = _twist(turns[hand] @ PALM[side], np.asarray(controls.palms[side]) - wrist, flexion @ along)
        turns[hand] = axis_rotation(flexion @ along, twist) @ turns[hand]
        turns[fore] = axis_rotation(along, 0.5 * twist) @ turns[fore]
    joints[upper], joints[fore], joints[hand] = shoulder, elbow, wrist
    bend = axis_rotation(ACROSS * (-1.0, -out, -out), np.radians(controls.curl.get(side, RELAXED_CURL_DEG)))
    for bone, parent in ((f"fingers_{side}", hand), (f"tips_{side}", f"fingers_{side}")):
        turns[bone] = turns[parent] @ bend
        joints[bone] = joints[parent] + turns[parent] @ (REST[bone] - REST[parent])


def _pose_leg(controls: Controls, side: str, turns: dict[str, Vector], joints: dict[str, Vector]) -> None:
    thigh, shin, foot = f"thigh_{side}", f"shin_{side}", f"foot_{side}"
    pelvis = turns["pelvis"]
    hip = joints["pelvis"] + pelvis @ (REST[thigh] - REST["pelvis"])
    ankle = REST[foot] + np.asarray(controls.feet.get(side, (0.0, 0.0, 0.0)))
    knee, ankle = _two_bones(hip, ankle, REST[shin] - REST[thigh], REST[foot] - REST[shin], np.array([0.0, 0.0, 1.0]))
    turns[thigh] = rotation_between(REST[shin] - REST[thigh], knee - hip)
    turns[shin] = rotation_between(REST[foot] - REST[shin], ankle - knee)
    turns[foot] = np.eye(3)
    joints[thigh], joints[shin], joints[foot] = hip, knee, ankle


def _two_bones(start: Vector, end: Vector, first: Vector, second: Vector, pole: Vector) -> tuple[Vector, Vector]:
    """Place middle and end joint of a limb that reaches for `end`, bent towards `pole` (law of cosines)."""
    a, b = float(np.linalg.norm(first)), float(np.linalg.norm(second))
    reach = end - start
    length = float(np.clip(np.linalg.norm(reach), abs(a - b) + 1.0, FULL_REACH * (a + b)))
    direction = reach / np.linalg.norm(reach)
    along = (a * a - b * b + length * length) / (2 * length)
    aside = np.sqrt(max(a * a - along * along, 0.0))
    sideways = pole - (pole @ direction) * direction
    middle = start + along * direction + aside * sideways / np.linalg.norm(sideways)
    return middle, start + length * direction


def _twist(palm: Vector, towards: Vector, axis: Vector) -> float:
    """Return the angle about `axis` that brings `palm` to `towards`, radians; relaxed where no forearm turns so far.

    It is continuous everywhere: it fades out where the target lies along the axis, and beyond MAX_TWIST it returns to
    zero at half a turn.
    """
    axis, towards = axis / np.linalg.norm(axis), towards / np.linalg.norm(towards)
    a, b = palm - (palm @ axis) * axis, towards - (towards @ axis) * axis
    angle = float(np.arctan2(axis @ np.cross(a, b), a @ b))
    share = min(1.0, float(np.linalg.norm(b)) / FULL_TWIST_SINE)
    if abs(angle) > MAX_TWIST:
        angle = np.sign(angle) * MAX_TWIST * (np.pi - abs(angle)) / (np.pi - MAX_TWIST)
    return share * angle


@numba.njit(cache=True, nogil=True)
def skin(
    vertices: NDArray[np.float64],
    bones: NDArray[np.int64],
    weights: NDArray[np.float64],
    transforms: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Move rest vertices with their bones (linear blend skinning): float64 (N, 3), mm, in the person's frame.

    Parameters
    ----------
    vertices : float64 (N, 3), mm, rest frame
    bones : int64 (N, 4), indices into BONES
    weights : float64 (N, 4), rows sum to one
    transforms : float64 (B, 3, 4), see `pose`
    """
    moved = np.empty((len(vertices), 3))
    for i in range(len(vertices)):
        x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        for r in range(3):
            value = 0.0
            for j in range(4):
                m = transforms[bones[i, j]]
                value += weights[i, j] * (m[r, 0] * x + m[r, 1] * y + m[r, 2] * z + m[r, 3])
            moved[i, r] = value
    return moved


def vertex_normals(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> NDArray[np.float64]:
    """Compute area-weighted unit normals, float64 (N, 3), of vertices (N, 3) with counter-clockwise faces (M, 3)."""
    normals = vector_sums(np.repeat(area_vectors(vertices, faces), 3, axis=0), faces.ravel(), len(vertices))
    lengths = np.sqrt((normals * normals).sum(axis=1, keepdims=True))
    return np.asarray(normals / np.where(lengths > 0, lengths, 1.0))
