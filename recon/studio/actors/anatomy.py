"""The parts of a clothed person at rest, to be joined by `implicit`.

Everything is in the rest frame of `skeleton.JOINTS`: a person 1780 mm tall, arms away from the body, facing +z,
whose left is +x. Clothes are wider than the limbs inside; what stands off by less is laid over the mesh by `person`.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from recon.studio.actors.implicit import Part
from recon.studio.actors.skeleton import ACROSS, ARM, BACK_OF_HAND, KNUCKLES_MM, REST

BUST_BONES = {"chest", "neck", "head", "upper_arm_l", "upper_arm_r"}
# Place of the knuckle across the hand, and lengths of the three bones, of index to little finger: mm, near the means of
# adults (Buryanov and Kotiuk 2010).
FINGERS = (
    (31.0, (43.0, 25.0, 19.0)),
    (10.5, (47.0, 29.0, 20.0)),
    (-10.5, (44.0, 27.0, 20.0)),
    (-30.5, (35.0, 20.0, 18.0)),
)
FINGER_RADII = (9.0, 8.3, 7.6, 6.4)  # mm, at the knuckle, the two joints and the tip
FINGER_BENDS_DEG = (12.0, 22.0, 32.0)  # of the three bones from the palm's plane
SPREAD_DEG_PER_MM = 0.36  # fingers diverge


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


def person_parts(build: Build) -> list[Part]:
    """List all parts of a clothed person, from the trunk outwards; the order is that of the smooth union."""
    g, hips, shoulders = build.girth, build.hips, build.shoulders
    trunk = [
        Part("pelvis", (0, 962, -4), None, (158 * g * hips, 125, 116 * g), 60),
        Part("spine", (0, 1085, 2), None, (148 * g, 160, 110 * g), 60),
        Part("chest", (0, 1270, -2), None, (160 * g * shoulders, 190, 114 * g), 60),
        Part("chest", (-118 * shoulders, 1412, -18), (118 * shoulders, 1412, -18), (56, 56), 60),
        Part("neck", (0, 1440, -24), (0, 1570, -8), (52 * g, 48 * g), 30),
    ]
    sided = [
        Part("pelvis", (72 * hips, 915, -52), None, (84 * g, 88, 70 * g), 50),
        Part("chest", (72, 1325, 60), None, (78 * shoulders, 62, 42 * g), 60),
        Part("neck", (112, 1434, -28), (24, 1492, -28), (30, 38), 55),
        Part("neck", (14, 1450, 30), (44, 1585, -20), (8, 8), 26),
        Part("neck", (22, 1446, 34), (120, 1456, 0), (8, 9), 26),
        *_arm(g),
        *_leg(g, hips),
    ]
    parts = [*trunk, *_both(sided), *head_parts(ears=not build.long_hair), *(_long_hair() if build.long_hair else [])]
    return [part for part in parts if part.bone in BUST_BONES] if build.bust else parts


def head_parts(*, ears: bool) -> list[Part]:
    """List skull and face, and ears where hair does not cover them; the features are 2 to 10 mm deep."""
    middle = [
        Part("head", (0, 1690, -10), None, (76, 90, 96), 20),
        Part("head", (0, 1642, 27), None, (62, 88, 65), 30),
        Part("head", (0, 1594, 35), None, (47, 40, 52), 32),
        Part("head", (0, 1564, 70), None, (21, 14, 16), 26),
        Part("head", (0, 1723, 38), None, (59, 40, 49), 34),
        Part("head", (0, 1678, 86), (0, 1636, 106), (6.5, 8.5), 16),
        Part("head", (0, 1631, 108), None, (9, 8, 9.5), 9),
        Part("head", (0, 1612, 93), None, (9, 11, 7), 12),
        Part("head", (0, 1577, 82), None, (14, 9, 9), 18),
    ]
    sided = [
        Part("head", (12, 1690, 87), (40, 1693, 75), (6, 6), 24),
        Part("head", (40, 1693, 75), (57, 1680, 52), (6, 8), 24),
        Part("head", (42, 1642, 60), None, (25, 22, 24), 28),
        Part("head", (34, 1614, 62), None, (16, 24, 17), 36),
        Part("head", (1.5, 1601.5, 93), (20, 1598.5, 78), (5.5, 3), 7),
        Part("head", (0, 1588.5, 91), (17, 1592.5, 79), (6.2, 4), 9),
        Part("head", (32, 1667, 101), None, (21, 11, 14), 16, carve=True),
        Part("head", (32, 1667, 75.5), None, (14.5, 13, 13.5), 4),
        Part("head", (9.5, 1627, 98), None, (6, 6, 8.5), 6),
        Part("head", (5.5, 1620.5, 104), None, (3, 3.5, 5), 2.5, carve=True),
    ]
    return [*middle, *_both(sided), *(_both(_ear()) if ears else [])]


def _ear() -> list[Part]:
    """List an ear's shell, bowl, rim and lobe; it leans back and stands off the head."""
    rim = ((71, 1652, 6), (74, 1672, 4), (79, 1681, -8), (83, 1672, -20), (81, 1652, -19), (76, 1636, -9))
    shell = Part("head", (74, 1657, -8), None, (6.5, 25, 15), 9, turn=_ear_turn())
    bowl = Part("head", (80, 1655, -4), None, (6, 13, 8.5), 5, turn=_ear_turn(), carve=True)
    edges = [Part("head", a, b, (3.4, 3.4), 4) for a, b in pairwise(rim)]
    lobe = Part("head", (73.5, 1630, -4), None, (4.2, 8, 6.5), 7)
    tragus = Part("head", (74, 1650, 5), None, (4, 6, 3.5), 4)
    return [shell, bowl, *edges, lobe, tragus]


def _long_hair() -> list[Part]:
    sides = [
        Part("head", (56, 1735, 14), (74, 1650, -8), (22, 20), 24),
        Part("head", (74, 1650, -8), (79, 1575, -12), (20, 21), 20),
        Part("head", (79, 1575, -12), (74, 1530, -16), (21, 13), 18),
        Part("head", (58, 1690, -32), (66, 1575, -40), (34, 31), 30),
        Part("head", (66, 1575, -40), (58, 1535, -48), (31, 20), 24),
    ]
    for x, z, y in ((85, 2, 1512), (89, -22, 1520), (80, -48, 1511), (60, -72, 1517), (34, -86, 1510), (11, -88, 1519)):
        sides.append(Part("head", (0.93 * x, 1572, 0.93 * z), (x, y, z), (13, 4.5), 9))
    return [Part("head", (0, 1610, -60), None, (76, 108, 46), 40), *_both(sides)]


def _arm(g: float) -> list[Part]:
    shoulder, elbow, wrist = REST["upper_arm_l"], REST["forearm_l"], REST["hand_l"]
    return [
        Part("upper_arm_l", tuple(shoulder), None, (53 * g, 52 * g, 52 * g), 45),
        Part("upper_arm_l", tuple(shoulder), tuple(elbow), (49 * g, 40 * g), 40),
        Part("forearm_l", tuple(elbow), tuple(wrist), (39 * g, 27 * g), 25),
        Part("forearm_l", tuple(0.66 * elbow + 0.34 * wrist), None, (38 * g, 38 * g, 37 * g), 45),
        *_hand(wrist),
    ]


def _hand(wrist: NDArray[np.float64]) -> list[Part]:
    """List palm, fingers and thumb, slightly bent; `skeleton` bends them further."""

    def at(along: float, across: float, back: float) -> NDArray[np.float64]:
        return np.asarray(wrist + along * ARM + across * ACROSS + back * BACK_OF_HAND)

    parts = [Part("hand_l", tuple(at(2, 0, 0)), tuple(at(30, 0, 0)), (25, 24), 20)]
    for across, _ in FINGERS:
        parts.append(Part("hand_l", tuple(at(22, 0.55 * across, 0)), tuple(at(KNUCKLES_MM, across, 0)), (15, 10.5), 16))
    parts.append(Part("hand_l", tuple(at(42, 26, -11)), None, (30, 17, 15), 16, turn=_palm_axes(38.0)))
    parts.append(Part("hand_l", tuple(at(44, -26, -6)), None, (36, 13, 13), 16, turn=_palm_axes(0.0)))
    for across, lengths in FINGERS:
        joint = at(KNUCKLES_MM - 0.004 * across * across, across, 0)
        for bone, length, bend, radii in zip(
            ("fingers_l", "tips_l", "tips_l"),
            lengths,
            np.radians(FINGER_BENDS_DEG),
            pairwise(FINGER_RADII),
            strict=True,
        ):
            spread = np.radians(SPREAD_DEG_PER_MM * across)
            direction = np.cos(bend) * (np.cos(spread) * ARM + np.sin(spread) * ACROSS) - np.sin(bend) * BACK_OF_HAND
            end = joint + length * direction
            slim = 0.88 if across < -20 else 1.0
            parts.append(Part(bone, tuple(joint), tuple(end), tuple(slim * radius for radius in radii), 3.5))
            joint = end
    thumb = (at(24, 24, -10), at(58, 48, -20), at(86, 60, -25), at(110, 66, -26))
    for (a, b), thick in zip(pairwise(thumb), ((14.5, 11.5), (10.8, 9.6), (9.4, 7.6)), strict=False):
        parts.append(Part("hand_l", tuple(a), tuple(b), thick, 8))
    return parts


def _palm_axes(turn_deg: float) -> NDArray[np.float64]:
    """Return the axes along the arm, towards the thumb and out of the back, turned in the palm's plane."""
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    return np.stack([c * ARM + s * ACROSS, c * ACROSS - s * ARM, BACK_OF_HAND], axis=1)


def _leg(g: float, hips: float) -> list[Part]:
    return [
        Part("thigh_l", (92 * hips, 890, -4), (106, 505, 4), (90 * g * hips, 68 * g), 40),
        Part("shin_l", (107, 500, 4), (113, 90, -18), (67 * g, 60 * g), 30),
        Part("shin_l", (110, 390, -18), None, (58 * g, 110, 58 * g), 40),
        Part("foot_l", (114, 44, -48), (122, 34, 95), (41, 34), 12),
        Part("foot_l", (122, 34, 90), (123, 30, 128), (38, 27), 14),
        Part("foot_l", (114, 80, -22), (119, 56, 50), (42, 36), 20),
    ]


def _both(parts: list[Part]) -> list[Part]:
    return [side for part in parts for side in (part, part.mirrored())]


def _ear_turn() -> NDArray[np.float64]:
    c, s = np.cos(0.40), np.sin(0.40)
    return np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
