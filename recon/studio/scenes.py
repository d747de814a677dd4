"""The scenes that can be recorded: actors, objects, and how they move.

A scene's motion is a function of the phase, 0 to 1, and returns to its start: any number of frames makes a loop.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.geometry.rig import rigid
from recon.studio.actors.anatomy import Build
from recon.studio.actors.skeleton import REST_HEIGHT_MM, Controls, Vector, rotation
from recon.studio.light.looks import BALL, BOX, CUBOID, KNIT, PERSON, PRINT, SPHERE, STRIPES, Look
from recon.studio.rigs import Field

SPHERE_RADIUS_MM = 150.0
CUBOID_SIZE_MM = (220.0, 320.0, 160.0)
BALL_RADIUS_MM = 115.0
BOX_SIZE_MM = (340.0, 250.0, 230.0)
OUTWARDS = {"l": 1.0, "r": -1.0}  # along x
TAU = 2 * np.pi


@dataclass(frozen=True)
class Actor:
    """A person, and where they stand: a place on the floor, mm, and a turn about y, 0 faces +z."""

    build: Build
    look: Look
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn_deg: float = 0.0

    @property
    def scale(self) -> float:
        """Size, compared with the frame of `Controls`."""
        return self.build.height / REST_HEIGHT_MM


@dataclass(frozen=True)
class Prop:
    """A ball (`size` holds its radius) or a box (`size` holds its edges), mm."""

    look: Look
    size: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Moment:
    """Everything that moves, at one instant.

    Parameters
    ----------
    controls : one per actor
    poses : float64 (4, 4) world_from_object, one per prop
    blink : how far eyes are closed, 0 to 1, one per actor
    """

    controls: tuple[Controls, ...] = ()
    poses: tuple[NDArray[np.float64], ...] = ()
    blink: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene of the studio.

    Parameters
    ----------
    kind : "scene", "sphere" or "cuboid"
    moment : phase (0 to 1) -> Moment
    shown : what every camera shows; the capture's bounds end there
    radius_mm, size_mm : of a validation object
    """

    name: str
    kind: str
    shown: Field
    moment: Callable[[float], Moment]
    actors: tuple[Actor, ...] = ()
    props: tuple[Prop, ...] = ()
    radius_mm: float | None = None
    size_mm: tuple[float, float, float] | None = None

    @property
    def object(self) -> dict[str, Any]:
        """The capture's description of the validation object, empty where there is none."""
        if self.radius_mm is not None:
            return {"radius_mm": self.radius_mm}
        return {"size_mm": list(self.size_mm)} if self.size_mm is not None else {}


PLAYER = Actor(
    Build(),
    Look(PERSON, (0.80, 0.60, 0.48), (0.62, 0.16, 0.14), (0.16, 0.18, 0.30), (0.20, 0.27, 0.42), (0.16, 0.10, 0.06)),
)
CARRIER = Actor(
    Build(1690.0, 0.93, 0.90, 1.04, long_hair=True),
    Look(PERSON, (0.76, 0.55, 0.42), (0.82, 0.80, 0.74), (0.16, 0.38, 0.42), (0.16, 0.19, 0.30), (0.30, 0.17, 0.09),
         pattern=STRIPES, sleeve=250.0, long_hair=True, shift=37.0),
)  # fmt: skip
TALKER = Actor(
    Build(1800.0, 1.06, 1.03),
    Look(PERSON, (0.82, 0.63, 0.52), (0.25, 0.42, 0.30), (0.80, 0.78, 0.66), (0.33, 0.30, 0.25), (0.42, 0.30, 0.17),
         pattern=PRINT, sleeve=205.0, shift=11.0),
    (-345.0, 0.0, -20.0), 24.0,
)  # fmt: skip
LISTENER = Actor(
    Build(1700.0, 0.95, 0.92, 1.03, long_hair=True),
    Look(PERSON, (0.60, 0.42, 0.31), (0.70, 0.42, 0.16), (0.36, 0.14, 0.10), (0.17, 0.20, 0.29), (0.09, 0.07, 0.06),
         pattern=KNIT, long_hair=True, shift=59.0),
    (345.0, 0.0, 10.0), -26.0,
)  # fmt: skip
STANDER = Actor(
    Build(1760.0, 1.03, 1.02),
    Look(PERSON, (0.84, 0.66, 0.55), (0.24, 0.32, 0.46), (0.56, 0.60, 0.66), (0.40, 0.36, 0.28), (0.35, 0.24, 0.13),
         pattern=KNIT, shift=23.0),
)  # fmt: skip
SPEAKER = Actor(
    Build(1780.0, 1.0, 1.0, bust=True),
    Look(PERSON, (0.82, 0.61, 0.49), (0.20, 0.36, 0.38), (0.72, 0.64, 0.44), (0.2, 0.2, 0.2), (0.22, 0.14, 0.08),
         shift=71.0),
)  # fmt: skip

OBJECT_FIELD = Field((0.0, 1100.0, 0.0), 1000.0, 1000.0)


def _ball_scene(_position: Vector) -> Scene:
    look = Look(BALL, (0.86, 0.42, 0.12), (0.88, 0.84, 0.74), (0.14, 0.26, 0.50), half_size=(BALL_RADIUS_MM,) * 3)
    shown = Field((0.0, 930.0, 120.0), 1250.0, 2020.0)
    return Scene("ball", "scene", shown, _ball_moment, (PLAYER,), (Prop(look, (BALL_RADIUS_MM,)),))


def _ball_moment(phase: float) -> Moment:
    """Swing the ball from side to side for half a period, then throw it up and catch it."""
    flight = max(0.0, (phase - 0.55) / 0.45)
    thrown = 4 * flight * (1 - flight)
    swing = _wave(phase / 0.55) if phase < 0.55 else 0.0
    dip = -50.0 * np.exp(-(((phase - 0.54) / 0.05) ** 2)) - 40.0 * np.exp(-((((phase + 0.5) % 1.0 - 0.52) / 0.05) ** 2))
    centre = np.array([165.0 * swing, 1160.0 + 50.0 * abs(swing) + dip, 390.0])
    ball = centre + np.array([0.0, 330.0 * thrown, 0.0])
    turn = rotation((0.0, 22.0 * swing, 0.0))
    aside, above = BALL_RADIUS_MM + 22.0 + 41.0 * thrown, min(40.0, 99.0 * thrown) - 25.0
    controls = Controls(
        pelvis=(26.0 * swing, -22.0 - 8.0 * _wave(phase, 2), 0.0),
        pelvis_turn=(2.0, 7.0 * swing, 0.0),
        spine_turn=(7.0 - 4.0 * thrown, 17.0 * swing, -3.0 * swing),
        head_turn=(12.0 - 22.0 * thrown, 6.0 * swing, 0.0),
        hands={side: centre + turn @ (out * aside, above, -70.0) for side, out in OUTWARDS.items()},
        palms=dict.fromkeys(OUTWARDS, ball),
        pointing=dict.fromkeys(OUTWARDS, turn @ (0.0, 0.1, 1.0)),
        curl=dict.fromkeys(OUTWARDS, 13.0 - 24.0 * thrown),
        feet={"l": (35.0, 0.0, 25.0), "r": (-35.0, 0.0, -15.0)},
    )
    spin = rotation((360.0 * flight, 20.0 + 22.0 * swing, 0.0))
    return Moment((controls,), (rigid(spin, ball),), (_blink(phase, 0.31),))


def _box_scene(_position: Vector) -> Scene:
    half = (BOX_SIZE_MM[0] / 2, BOX_SIZE_MM[1] / 2, BOX_SIZE_MM[2] / 2)
    look = Look(BOX, (0.66, 0.50, 0.34), (0.62, 0.10, 0.09), half_size=half)
    shown = Field((0.0, 870.0, 120.0), 1250.0, 1950.0)
    return Scene("box", "scene", shown, _box_moment, (CARRIER,), (Prop(look, BOX_SIZE_MM),))


def _box_moment(phase: float) -> Moment:
    """Lift the box from the belt to the chest, turn and tilt it, lower it again."""
    lift = 0.5 - 0.5 * float(np.cos(TAU * phase))
    turn = rotation((-10.0 * lift, 24.0 * _wave(phase, 2), 7.0 * _wave(phase)))
    centre = np.array([55.0 * _wave(phase), 1015.0 + 270.0 * lift, 385.0 - 25.0 * lift])
    aside = BOX_SIZE_MM[0] / 2 / CARRIER.scale + 30.0
    wrists = {side: centre + turn @ (out * aside, -30.0, -75.0) for side, out in OUTWARDS.items()}
    tilted = {side: wrists[side] + turn @ (-99.0 * out, 30.0, 0.0) for side, out in OUTWARDS.items()}
    controls = Controls(
        pelvis=(15.0 * _wave(phase), -18.0 - 22.0 * (1 - lift), -25.0),
        pelvis_turn=(4.0, 6.0 * _wave(phase, 2), 0.0),
        spine_turn=(9.0 - 9.0 * lift, 7.0 * _wave(phase, 2), -3.0 * _wave(phase)),
        head_turn=(20.0 - 14.0 * lift, 5.0 * _wave(phase, 2), 3.0 * _wave(phase)),
        hands=wrists,
        palms=tilted,  # thumbs stand off
        pointing=dict.fromkeys(OUTWARDS, turn @ (0.0, 0.1, 1.0)),
        curl=dict.fromkeys(OUTWARDS, -10.0),
        feet={"l": (25.0, 0.0, -10.0), "r": (-25.0, 0.0, 30.0)},
    )
    return Moment((controls,), (rigid(turn, CARRIER.scale * centre),), (_blink(phase, 0.12),))


def _people_scene(_position: Vector) -> Scene:
    shown = Field((0.0, 910.0, 60.0), 1750.0, 2240.0)
    return Scene("people", "scene", shown, _people_moment, (TALKER, LISTENER))


def _people_moment(phase: float) -> Moment:
    """Let one person explain with both hands and the other nod and wave it off."""
    beat = _wave(phase, 2)
    talker = Controls(
        pelvis=(10.0 * _wave(phase), -8.0, 0.0),
        spine_turn=(3.0, 8.0 + 6.0 * _wave(phase, shift=0.1), 2.0 * _wave(phase)),
        head_turn=(2.0 + 4.0 * beat, 22.0 + 5.0 * _wave(phase), -3.0),
        hands={
            "l": (205.0 + 55.0 * beat, 1155.0 + 60.0 * _wave(phase, 2, 0.2), 330.0),
            "r": (-190.0 - 40.0 * _wave(phase, 2, 0.3), 1130.0 + 70.0 * beat, 320.0 + 30.0 * _wave(phase)),
        },
        palms={"l": (0.0, 1350.0, 420.0), "r": (0.0, 1350.0, 420.0)},
        feet={"l": (20.0, 0.0, 20.0), "r": (-20.0, 0.0, 0.0)},
        jaw=2.0 + 2.0 * _wave(phase, 5),
        curl={"l": 10.0 + 8.0 * beat, "r": 12.0 - 6.0 * _wave(phase, 2, 0.3)},
    )
    raised = 0.5 - 0.5 * float(np.cos(TAU * phase))
    listener = Controls(
        pelvis=(-12.0 * _wave(phase, shift=0.2), -10.0, 0.0),
        spine_turn=(2.0, -9.0 + 4.0 * _wave(phase, shift=0.3), -2.0 * _wave(phase)),
        head_turn=(4.0 + 7.0 * _wave(phase, 3), -20.0 + 6.0 * _wave(phase, shift=0.4), 4.0),
        hands={"l": (330.0 + 70.0 * raised * _wave(phase, 3), 960.0 + 470.0 * raised, 60.0 + 230.0 * raised)},
        feet={"l": (10.0, 0.0, -15.0), "r": (-30.0, 0.0, 25.0)},
        curl={"l": 14.0 - 10.0 * raised, "r": 16.0},
    )
    return Moment((talker, listener), (), (_blink(phase, 0.42), _blink(phase, 0.77)))


def _standing_scene(_position: Vector) -> Scene:
    return Scene("standing", "scene", Field((0.0, 910.0, 0.0), 1050.0, 1980.0), _standing_moment, (STANDER,))


def _standing_moment(phase: float) -> Moment:
    """Shift weight from foot to foot, look around, breathe."""
    breath = _wave(phase, 2)
    controls = Controls(
        pelvis=(22.0 * _wave(phase), -6.0, 3.0 * breath),
        pelvis_turn=(0.0, 3.0 * _wave(phase, shift=0.2), 1.5 * _wave(phase)),
        spine_turn=(1.0 - 1.2 * breath, -4.0 * _wave(phase, shift=0.1), -2.5 * _wave(phase)),
        head_turn=(3.0 * _wave(phase, shift=0.3), 14.0 * _wave(phase, shift=0.15), 2.0 * _wave(phase)),
        feet={"l": (22.0, 0.0, 18.0), "r": (-22.0, 0.0, -5.0)},
    )
    return Moment((controls,), (), (_blink(phase, 0.63),))


def _face_scene(_position: Vector) -> Scene:
    return Scene("face", "scene", Field((0.0, 1600.0, 10.0), 640.0, 620.0), _face_moment, (SPEAKER,))


def _face_moment(phase: float) -> Moment:
    """Move head and shoulders, talking and turning."""
    controls = Controls(
        spine_turn=(1.0 - _wave(phase, 2), 5.0 * _wave(phase, shift=0.05), 1.5 * _wave(phase)),
        head_turn=(5.0 * _wave(phase, 2, 0.1), 21.0 * _wave(phase), 4.0 * _wave(phase, shift=0.3)),
        jaw=2.6 + 1.8 * _wave(phase, 5) + 0.8 * _wave(phase, 8, 0.2),
    )
    return Moment((controls,), (), (_blink(phase, 0.36),))


def _sphere_scene(position: Vector) -> Scene:
    look = Look(SPHERE, (0.12, 0.30, 0.62), (0.16, 0.55, 0.28), (0.92, 0.78, 0.22))
    thing = Prop(look, (SPHERE_RADIUS_MM,))
    return Scene("sphere", "sphere", OBJECT_FIELD, _turntable(position), (), (thing,), radius_mm=SPHERE_RADIUS_MM)


def _cuboid_scene(position: Vector) -> Scene:
    look = Look(CUBOID, (0.70, 0.22, 0.16), (0.90, 0.86, 0.76), (0.13, 0.28, 0.45))
    thing = Prop(look, CUBOID_SIZE_MM)
    return Scene("cuboid", "cuboid", OBJECT_FIELD, _turntable(position), (), (thing,), size_mm=CUBOID_SIZE_MM)


def _turntable(position: Vector) -> Callable[[float], Moment]:
    place = np.asarray(OBJECT_FIELD.centre) + position
    return lambda phase: Moment(poses=(rigid(rotation((14.0, 25.0 + 360.0 * phase, 8.0)), place),))


def _wave(phase: float, cycles: int = 1, shift: float = 0.0) -> float:
    return float(np.sin(TAU * (cycles * phase + shift)))


def _blink(phase: float, at: float) -> float:
    """Return how far eyes are closed around the phase `at`."""
    away = abs((phase - at + 0.5) % 1.0 - 0.5)
    return float(np.clip(1.5 - away / 0.02, 0.0, 1.0))


SCENES: dict[str, Callable[[Vector], Scene]] = {
    "ball": _ball_scene,
    "box": _box_scene,
    "people": _people_scene,
    "standing": _standing_scene,
    "face": _face_scene,
    "sphere": _sphere_scene,
    "cuboid": _cuboid_scene,
}
