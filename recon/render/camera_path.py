"""The virtual camera's path around the model, the same for every approach of a dataset."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from recon.geometry.rig import Camera, Rig, bounds_corners, checked_bounds, look_at, transformed

FINE_STEPS = 2000  # of the path's arc length; a step is far below what an eye sees
POLE_DEG = 85.0  # nearer to straight above or below, "world y is up" says nothing about the picture


class NoPathError(ValueError):
    """Sensors that no camera path can follow."""


@dataclass(frozen=True)
class PathParameters:
    """How the camera moves and frames.

    Parameters
    ----------
    margin : share of the picture's half width and half height that the bounds may fill
    widest_deg : widest field of view across the picture's shorter side; where a sensor is nearer than that allows, all
        places move away from the middle of the bounds by the same factor
    ease : share of the path's time at each end in which the camera gathers or loses speed
    swing_deg : how far to either side the camera swings where there is only one sensor
    """

    margin: float = 0.94
    widest_deg: float = 50.0
    ease: float = 0.15
    swing_deg: float = 25.0


@dataclass(frozen=True, eq=False)
class Spherical:
    """Places around the centre of the bounds: azimuth about world y, elevation (radians), distance (mm); each (N,)."""

    azimuth: NDArray[np.float64]
    elevation: NDArray[np.float64]
    distance: NDArray[np.float64]

    @property
    def offsets(self) -> NDArray[np.float64]:
        """Cartesian vectors from the centre of the bounds to the places, float64 (N, 3), mm."""
        level = np.cos(self.elevation) * self.distance
        return np.stack(
            [level * np.sin(self.azimuth), np.sin(self.elevation) * self.distance, level * np.cos(self.azimuth)], axis=1
        )


PathKind = Callable[[Spherical, int, PathParameters], Spherical]


def camera_path(
    rig: Rig,
    bounds: NDArray[np.floating],
    n_frames: int,
    size: tuple[int, int],
    *,
    kind: str = "auto",
    parameters: PathParameters | None = None,
) -> tuple[Camera, ...]:
    """Make the cameras of a fly-through: each looks at the centre of the bounds, world y up, one field of view for all.

    The field of view depends on the bounds, the rig and the picture's shape alone, so that every approach of a
    dataset is framed the same.

    Parameters
    ----------
    rig : sensors in the order in which they are passed
    bounds : float64 (2, 3), mm, lowest and highest corner of what is shown
    n_frames : how many cameras
    size : (width, height), pixels
    kind : a name in `PATHS`, or "auto": along the sensors where there are several, else a swing before the only one
    parameters : how it moves and frames

    Raises
    ------
    NoPathError
        If a sensor stands at the centre of the bounds, or straight above or below it, or all stand in one place.
    ValueError
        If the kind is unknown, there is no frame, or the bounds are empty.
    """
    parameters = parameters or PathParameters()
    if n_frames < 1:
        raise ValueError(f"a path of {n_frames} frames was asked for, expected at least 1")
    bounds = checked_bounds(bounds)
    stations = _stations(rig, bounds.mean(axis=0))
    places = _path_named(kind, rig)(stations, n_frames, parameters).offsets
    places = bounds.mean(axis=0) + _backed_away(places, bounds, parameters)
    K = _framing(places, bounds, size, parameters)
    return tuple(Camera(K=K, size=size, cam_from_world=look_at(place, bounds.mean(axis=0))) for place in places)


def along_sensors(stations: Spherical, n_frames: int, parameters: PathParameters) -> Spherical:
    """Fly from the first sensor to the last, through those between, at constant speed with eased ends.

    Parameters
    ----------
    stations : the sensors
    n_frames : places to return
    parameters : of which the ease is used

    Raises
    ------
    NoPathError
        If all sensors stand in the same place.
    """
    at = np.arange(len(stations.azimuth), dtype=np.float64)
    columns = np.stack([np.unwrap(stations.azimuth), stations.elevation, stations.distance], axis=1)
    if len(at) == 1 or np.allclose(columns, columns[0]):
        raise NoPathError("the sensors all stand in one place: choose the path 'swing' or 'orbit'")
    curve = PchipInterpolator(at, columns)
    fine = np.linspace(0.0, at[-1], FINE_STEPS + 1)
    steps = np.linalg.norm(np.diff(Spherical(*curve(fine).T).offsets, axis=0), axis=1)
    length = np.concatenate([[0.0], np.cumsum(steps)])
    when = np.interp(_eased(n_frames, parameters.ease) * length[-1], length, fine)
    return Spherical(*curve(when).T)


def orbit(stations: Spherical, n_frames: int, parameters: PathParameters) -> Spherical:  # noqa: ARG001
    """Fly once around from the first sensor, at constant speed, so that the last frame leads into the first.

    Parameters
    ----------
    stations : the sensors
    n_frames : places to return
    parameters : not used
    """
    turn = np.arange(n_frames) * (2 * np.pi / n_frames)
    level = np.ones(n_frames)
    return Spherical(
        stations.azimuth[0] + turn, level * stations.elevation.mean(), level * float(stations.distance.mean())
    )


def swing(stations: Spherical, n_frames: int, parameters: PathParameters) -> Spherical:
    """Swing before the first sensor to either side and back, slowest where the camera turns.

    Parameters
    ----------
    stations : the sensors
    n_frames : places to return
    parameters : of which the swing's angle is used
    """
    turn = np.sin(np.linspace(0.0, 2 * np.pi, n_frames)) * np.deg2rad(parameters.swing_deg)
    level = np.ones(n_frames)
    return Spherical(stations.azimuth[0] + turn, level * stations.elevation[0], level * float(stations.distance[0]))


PATHS: dict[str, PathKind] = {"sensors": along_sensors, "orbit": orbit, "swing": swing}


def _path_named(kind: str, rig: Rig) -> PathKind:
    if kind == "auto":
        kind = "sensors" if len(rig.sensors) > 1 else "swing"
    if kind not in PATHS:
        raise ValueError(f"there is no camera path {kind!r}; expected auto or one of {', '.join(PATHS)}")
    return PATHS[kind]


def _stations(rig: Rig, centre: NDArray[np.float64]) -> Spherical:
    """Locate the sensors, each at the middle of its two cameras, from the centre of the bounds."""
    offsets = np.array([(s.left.centre + s.right.centre) / 2 - centre for s in rig.sensors])
    distance = np.linalg.norm(offsets, axis=1)
    elevation = np.arcsin(np.clip(offsets[:, 1] / np.maximum(distance, 1e-9), -1, 1))
    for sensor, far, angle in zip(rig.sensors, distance, np.rad2deg(elevation), strict=True):
        if far < 1e-6:
            raise NoPathError(
                f"sensor {sensor.id} stands at the centre of the bounds; check the bounds and the calibration, or give "
                "the cameras of a file by --path"
            )
        if abs(angle) > POLE_DEG:
            raise NoPathError(
                f"sensor {sensor.id} sees the centre of the bounds from {angle:.0f} degrees above the horizon; with "
                f"world y up a camera path can follow sensors up to {POLE_DEG:.0f} degrees; give the cameras of a file "
                "by --path"
            )
    return Spherical(np.arctan2(offsets[:, 0], offsets[:, 2]), elevation, distance)


def _backed_away(
    offsets: NDArray[np.float64], bounds: NDArray[np.float64], parameters: PathParameters
) -> NDArray[np.float64]:
    """Move offsets away from the centre until the bounds' sphere fits the widest field of view."""
    radius = float(np.linalg.norm(bounds[1] - bounds[0])) / 2
    nearest = radius / np.sin(np.deg2rad(parameters.widest_deg) / 2)
    scale = np.maximum(1.0, nearest / np.linalg.norm(offsets, axis=1))
    return np.asarray(offsets * scale.max())


def _framing(
    places: NDArray[np.float64], bounds: NDArray[np.float64], size: tuple[int, int], parameters: PathParameters
) -> NDArray[np.float64]:
    """Choose the camera matrix (3, 3) with which the bounds stay inside the margin from every place."""
    corners = bounds_corners(bounds)
    unit = [look_at(place, bounds.mean(axis=0)) for place in places]
    in_cameras = np.array([transformed(corners, pose) for pose in unit])  # (frames, 8, 3)
    extent = np.abs(in_cameras[..., :2] / in_cameras[..., 2:]).max(axis=(0, 1))  # tangents, horizontal and vertical
    focal = float((np.array(size) / 2 * parameters.margin / extent).min())
    return np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1]])


def _eased(n_frames: int, ease: float) -> NDArray[np.float64]:
    """Place each frame along the path, 0 to 1: speed rises and falls as a cosine and is constant between."""
    time = np.linspace(0.0, 1.0, n_frames)
    if ease <= 0:
        return time
    rise = (time - ease / np.pi * np.sin(np.pi * np.minimum(time, ease) / ease)) / 2
    rise = np.where(time < ease, rise, time - ease / 2)
    fall_time = np.maximum(time - (1 - ease), 0.0)
    fall = (fall_time - ease / np.pi * np.sin(np.pi * fall_time / ease)) / 2
    return np.asarray((rise - fall) / (1 - ease))
