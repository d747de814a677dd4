"""Stereo sensors on an arc in front of the actors, as in the paper: 2.3 to 2.9 m away, towards one joint spot."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from recon.geometry.rig import Camera, Rig, Sensor, direction_of, look_at, rigid
from recon.studio.actors.skeleton import axis_rotation, rotation

NEAREST_SENSOR_MM, FARTHEST_SENSOR_MM = 2300.0, 2900.0  # section 4.2 of the paper
APART_DEG = 42.0  # between neighbours, so that their views overlap
BASELINES_MM = (205.0, 250.0)
CONVERGENCE = 1.6  # the two axes of a sensor meet this many times as far away as the subject
MISALIGNED_DEG = 0.25  # standard deviation of a mounted camera's direction


@dataclass(frozen=True)
class Field:
    """The place that every camera must show, mm."""

    centre: tuple[float, float, float]
    width: float
    height: float


def arc_rig(field: Field, *, n_sensors: int, size: tuple[int, int], rng: np.random.Generator) -> Rig:
    """Place sensors S1, S2, ... from the actors' right to their left.

    Parameters
    ----------
    field : the place that all cameras show
    n_sensors : how many stereo sensors
    size : (width, height) of the images, pixels
    rng : varies distances, baselines and mounting
    """
    apart = min(APART_DEG, 360.0 / n_sensors)
    azimuths = (np.arange(n_sensors) - (n_sensors - 1) / 2) * apart + rng.uniform(-2.0, 2.0, n_sensors)
    return Rig(tuple(_sensor(f"S{i + 1}", field, float(a), size, rng) for i, a in enumerate(azimuths)))


def disturbed(rig: Rig, error_px: float, rng: np.random.Generator) -> Rig:
    """Disturb a rig as a calibration with errors would describe it.

    Parameters
    ----------
    rig : the true one
    error_px : by about which rotations and principal points are off, pixels
    rng : draws the errors
    """
    return Rig(
        tuple(Sensor(s.id, _disturbed(s.left, error_px, rng), _disturbed(s.right, error_px, rng)) for s in rig.sensors)
    )


def distorted(rig: Rig, k1: float, rng: np.random.Generator) -> Rig:
    """Give a rig's lenses about the same distortion each, as real ones have.

    Parameters
    ----------
    rig : without distortion
    k1 : OpenCV's first coefficient, about; k2 acts against it, and a little is tangential
    rng : draws each lens
    """

    def lens(camera: Camera) -> Camera:
        first = k1 * (1.0 + 0.05 * rng.normal())
        return replace(camera, dist=np.array([first, -0.3 * first, *rng.normal(0.0, 2e-4, 2), 0.0]))

    return Rig(tuple(Sensor(s.id, lens(s.left), lens(s.right)) for s in rig.sensors))


def between(first: Sensor, second: Sensor, field: Field) -> Camera:
    """Place a camera half way between two sensors, for photographs that no sensor uses.

    Parameters
    ----------
    first, second : sensors
    field : the place that the camera shows
    """
    centre = np.asarray(field.centre)
    places = [sensor.left.centre + sensor.right.centre - 2 * centre for sensor in (first, second)]
    direction = sum(place / np.linalg.norm(place) for place in places)
    distance = 0.25 * sum(float(np.linalg.norm(place)) for place in places)
    place = centre + distance * direction / np.linalg.norm(direction)
    return Camera(first.left.K, first.left.size, look_at(place, centre))


def _sensor(name: str, field: Field, azimuth_deg: float, size: tuple[int, int], rng: np.random.Generator) -> Sensor:
    distance = rng.uniform(NEAREST_SENSOR_MM + 100.0, FARTHEST_SENSOR_MM - 150.0)
    target = np.asarray(field.centre)
    centre = target + distance * direction_of(np.radians(azimuth_deg), np.radians(rng.uniform(4.0, 9.0)))
    half = 0.5 * rng.uniform(*BASELINES_MM) * look_at(centre, target)[0, :3]
    focal = distance * min(size[1] / field.height, size[0] / field.width) * rng.uniform(0.98, 1.0)
    left, right = (_camera(centre + offset, centre, target, focal, size, rng) for offset in (-half, half))
    return Sensor(name, left, right)


def _camera(
    place: NDArray[np.float64],
    sensor: NDArray[np.float64],
    target: NDArray[np.float64],
    focal: float,
    size: tuple[int, int],
    rng: np.random.Generator,
) -> Camera:
    aim = sensor + CONVERGENCE * (target - sensor)
    pose = look_at(place, aim)
    turn = rotation(rng.normal(0.0, MISALIGNED_DEG, 3)) @ pose[:3, :3]
    focal = focal * (1.0 + rng.normal(0.0, 0.002))
    centre = (np.asarray(size) - 1) / 2 + rng.normal(0.0, 0.004, 2) * size
    K = np.array([[focal, 0.0, centre[0]], [0.0, focal * (1 + rng.normal(0.0, 0.0003)), centre[1]], [0.0, 0.0, 1.0]])
    return Camera(K, size, rigid(turn, -turn @ place))


def _disturbed(camera: Camera, error_px: float, rng: np.random.Generator) -> Camera:
    axis, angle = rng.normal(size=3), rng.normal() * error_px / camera.K[0, 0]
    turn = axis_rotation(axis, angle) @ camera.rotation
    K = camera.K.copy()
    K[:2, 2] += rng.normal(0.0, 0.5 * error_px, 2)
    return Camera(K, camera.size, rigid(turn, -turn @ camera.centre), camera.dist)
