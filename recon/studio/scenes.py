"""The scenes that can be recorded: who acts, with what, and how they move.

A scene's motion is a function of the phase, 0 to 1, and returns to its start: any number of frames makes a loop.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.rig import rigid
from recon.studio.appearance import BALL, CUBOID, PERSON, PLAID, SPHERE, Look
from recon.studio.person import Build
from recon.studio.rigs import Field
from recon.studio.skeleton import Controls, rotation

SPHERE_RADIUS_MM = 150.0
CUBOID_SIZE_MM = (220.0, 320.0, 160.0)
BALL_RADIUS_MM = 115.0
TAU = 2 * np.pi


@dataclass(frozen=True)
class Actor:
    """A person, and where they stand.

    Parameters
    ----------
    place : mm, on the floor; turn_deg : about y, 0 faces +z
    """

    build: Build
    look: Look
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn_deg: float = 0.0


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
    shown : what every camera shows
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


def _wave(phase: float, cycles: int = 1, shift: float = 0.0) -> float:
    return float(np.sin(TAU * (cycles * phase + shift)))


def _blink(phase: float, at: float) -> float:
    """Closed for a moment around `at`."""
    away = abs((phase - at + 0.5) % 1.0 - 0.5)
    return float(np.clip(1.5 - away / 0.02, 0.0, 1.0))


PLAYER = Actor(
    Build(),
    Look(
        PERSON,
        (0.80, 0.60, 0.48),
        (0.62, 0.16, 0.14),
        (0.16, 0.18, 0.30),
        (0.20, 0.27, 0.42),
        (0.16, 0.10, 0.06),
        PLAID,
    ),
)


def _ball_moment(phase: float) -> Moment:
    """Half a period the ball swings from side to side, the other half it is thrown up and caught."""
    height, thrown = 0.0, 0.0
    if phase > 0.55:
        t = (phase - 0.55) / 0.45
        thrown = 4 * t * (1 - t)
        height = 330.0 * thrown
    swing = _wave(min(phase / 0.55, 1.0)) if phase < 0.55 else 0.0
    dip = -60.0 * max(0.0, _wave(phase, shift=-0.05)) * (phase > 0.3)
    centre = np.array([190.0 * swing, 1160.0 + 50.0 * abs(swing) + dip, 390.0])
    ball = centre + np.array([0.0, height, 0.0])
    apart = BALL_RADIUS_MM + 8.0 + 45.0 * thrown
    hold = centre + np.array([0.0, min(40.0, 0.3 * height) - 25.0, -75.0])
    aside = np.array([apart, 0.0, 0.0])
    controls = Controls(
        pelvis=(26.0 * swing, -22.0 - 8.0 * _wave(phase, 2), 0.0),
        pelvis_turn=(2.0, 7.0 * swing, 0.0),
        spine_turn=(7.0 - 4.0 * thrown, 17.0 * swing, -3.0 * swing),
        head_turn=(12.0 - 22.0 * thrown, 6.0 * swing, 0.0),
        hands={"l": hold + aside, "r": hold - aside},
        palms={"l": ball, "r": ball},
        feet={"l": (35.0, 0.0, 25.0), "r": (-35.0, 0.0, -15.0)},
    )
    spin = rotation((360.0 * phase, 20.0, 40.0 * swing))
    return Moment((controls,), (rigid(spin, ball),), (_blink(phase, 0.31),))


def _turntable(position: NDArray[np.float64]) -> Callable[[float], Moment]:
    return lambda phase: Moment(poses=(rigid(rotation((14.0, 25.0 + 360.0 * phase, 8.0)), position),))


def _actors_scene(
    name: str, field_of_view: Field, moment: Callable[[float], Moment], actors: tuple[Actor, ...], *props: Prop
) -> Scene:
    return Scene(name, "scene", field_of_view, moment, actors, props)


def _ball_scene(_position: NDArray[np.float64]) -> Scene:
    look = Look(BALL, (0.86, 0.42, 0.12), (0.88, 0.84, 0.74), (0.14, 0.26, 0.50), half_size=(BALL_RADIUS_MM,) * 3)
    return _actors_scene(
        "ball", Field((0.0, 930.0, 120.0), 1250.0, 2020.0), _ball_moment, (PLAYER,), Prop(look, (BALL_RADIUS_MM,))
    )


OBJECT_FIELD = Field((0.0, 1100.0, 0.0), 1000.0, 1000.0)


def _sphere_scene(position: NDArray[np.float64]) -> Scene:
    look = Look(SPHERE, (0.12, 0.30, 0.62), (0.16, 0.55, 0.28), (0.92, 0.78, 0.22))
    return Scene(
        "sphere", "sphere", OBJECT_FIELD, _turntable(np.asarray(OBJECT_FIELD.centre) + position),
        props=(Prop(look, (SPHERE_RADIUS_MM,)),), radius_mm=SPHERE_RADIUS_MM,
    )  # fmt: skip


def _cuboid_scene(position: NDArray[np.float64]) -> Scene:
    look = Look(CUBOID, (0.70, 0.22, 0.16), (0.90, 0.86, 0.76), (0.13, 0.28, 0.45))
    return Scene(
        "cuboid", "cuboid", OBJECT_FIELD, _turntable(np.asarray(OBJECT_FIELD.centre) + position),
        props=(Prop(look, CUBOID_SIZE_MM),), size_mm=CUBOID_SIZE_MM,
    )  # fmt: skip


SCENES: dict[str, Callable[[NDArray[np.float64]], Scene]] = {
    "ball": _ball_scene,
    "sphere": _sphere_scene,
    "cuboid": _cuboid_scene,
}
