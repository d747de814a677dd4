"""The cameras of a studio, as every stage from capture to video describes them.

Convention: camera frame as OpenCV (x right, y down, z forward), pixel centres at integers with (0, 0) the
centre of the top-left pixel, millimetres, `cam_from_world` 4x4.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

ROTATION_TOLERANCE = 1e-3  # published calibrations carry about four digits
MIN_BASELINE_MM = 1e-3
FARTHEST_MM, SMALLEST_MM = 1e10, 1e-3  # the Earth from pole to equator; values beyond are slips, not places
MOST_PIXELS = 1_000_000  # of a picture's side
MOST_OFF_AXIS = 50.0  # focal lengths: 88.9 degrees
MOST_ANAMORPHIC = 5.0  # of fx to fy or fy to fx; lenses and pixels that are not square reach 2
LONGEST_FOCAL = 1e5  # times the picture's longer side
MOST_DISTORTION = 1e4  # of any one number at the picture's corners, where 1 is as far as they are from the axis
DIST_POWERS = (2, 4, 1, 1, 6, 2, 4, 6, 1, 3, 1, 3, 0, 0)  # of the distance from the axis, by which they grow
UNITS_MM = {"mm": 1.0, "cm": 10.0, "in": 25.4, "m": 1000.0}  # of recordings and clouds from elsewhere
UP = np.array([0.0, 1.0, 0.0])
OPENGL = np.array([1.0, -1.0, -1.0])  # per camera axis: OpenGL's y points up and its z backwards, OpenCV's do not
Y_FROM = {
    "y": np.eye(3),
    "-y": np.diag([1.0, -1.0, -1.0]),
    "z": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "-z": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "x": np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]),
    "-x": np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
}  # rotations that turn an axis of another world to this one's +y, by the axis


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera with OpenCV distortion.

    Parameters
    ----------
    K : float64 (3, 3), pixels
    size : (width, height), pixels
    cam_from_world : float64 (4, 4), mm
    dist : float64 (n,), OpenCV's k1, k2, p1, p2, k3, ...; empty where there is none

    Raises
    ------
    ValueError
        If K is not an upper triangular matrix with positive focal lengths, the size is not positive, the pose is not
        a rigid transform, or a number is one that no camera has.
    """

    K: NDArray[np.float64]
    size: tuple[int, int]
    cam_from_world: NDArray[np.float64]
    dist: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        object.__setattr__(self, "K", _matrix(self.K, (3, 3), "K"))
        object.__setattr__(self, "cam_from_world", _matrix(self.cam_from_world, (4, 4), "cam_from_world"))
        object.__setattr__(self, "dist", np.asarray(self.dist, dtype=np.float64).ravel())
        object.__setattr__(self, "size", (int(self.size[0]), int(self.size[1])))
        _check_intrinsics(self.K, self.size)
        _check_rigid(self.cam_from_world)
        _check_place(self.cam_from_world)
        _check_distortion(self.dist, _off_axis(self.K, self.size))

    @property
    def rotation(self) -> NDArray[np.float64]:
        """float64 (3, 3): camera axes from world axes."""
        return self.cam_from_world[:3, :3]

    @property
    def centre(self) -> NDArray[np.float64]:
        """float64 (3,), mm: the optical centre in the world."""
        return np.asarray(-self.rotation.T @ self.cam_from_world[:3, 3])

    def points_in_camera(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Transform world points (N, 3) into this camera's frame, mm."""
        return transformed(points, self.cam_from_world)

    def project(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Project world points (N, 3) to pixels (N, 2), without distortion."""
        in_camera = self.points_in_camera(points)
        homogeneous = in_camera @ self.K.T
        return np.asarray(homogeneous[:, :2] / homogeneous[:, 2:])


@dataclass(frozen=True, eq=False)
class Sensor:
    """Two cameras of one size, in different places, that record at the same instants; a ValueError if they are not."""

    id: str
    left: Camera
    right: Camera

    def __post_init__(self) -> None:
        if self.left.size != self.right.size:
            raise ValueError(
                f"sensor {self.id}: left is {self.left.size}, right {self.right.size}; sizes must be equal"
            )
        if self.baseline < MIN_BASELINE_MM:
            raise ValueError(f"sensor {self.id}: the baseline is {self.baseline:g} mm; two places are needed for depth")

    @property
    def baseline(self) -> float:
        """Distance between the optical centres, mm."""
        return float(np.linalg.norm(self.right.centre - self.left.centre))

    @property
    def right_from_left(self) -> NDArray[np.float64]:
        """float64 (4, 4), mm: the right camera's frame from the left one's."""
        return np.asarray(self.right.cam_from_world @ np.linalg.inv(self.left.cam_from_world))


@dataclass(frozen=True, eq=False)
class Rig:
    """All sensors of a studio, ordered from the first to the last as the fly-through passes them.

    A ValueError says that there is no sensor, or that two have the same id.
    """

    sensors: tuple[Sensor, ...]

    def __post_init__(self) -> None:
        ids = [sensor.id for sensor in self.sensors]
        if not ids:
            raise ValueError("a rig needs at least one sensor, found none")
        if len(set(ids)) != len(ids):
            raise ValueError(f"sensor ids must differ, found {ids}")


def checked_bounds(bounds: ArrayLike) -> NDArray[np.float64]:
    """Check bounds, mm, and return them as float64 (2, 3).

    A ValueError says that they are not two corners, the lowest one first, of a box that has a volume.
    """
    try:
        box = np.array(bounds, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"bounds is {bounds!r}, expected numbers") from error
    if box.shape != (2, 3) or not np.isfinite(box).all():
        raise ValueError(f"bounds is {box.tolist()}, expected [[x, y, z] lowest, [x, y, z] highest] in mm")
    if not (box[0] < box[1]).all():
        raise ValueError(f"bounds: the lowest corner {box[0].tolist()} is not below the highest {box[1].tolist()}")
    if np.abs(box).max() > FARTHEST_MM or (box[1] - box[0]).min() < SMALLEST_MM:
        raise ValueError(
            f"bounds is {box.tolist()}, beyond {FARTHEST_MM:g} mm or without edges of at least {SMALLEST_MM:g} mm; "
            "they are the box around the object, in mm"
        )
    return box


def bounds_corners(bounds: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the eight corners (8, 3) of bounds (2, 3), the lowest and highest corner, mm."""
    return np.array([[bounds[i, 0], bounds[j, 1], bounds[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])


def rigid(rotation: ArrayLike, translation: ArrayLike) -> NDArray[np.float64]:
    """Return the transform (4, 4) of a rotation (3, 3) and a translation (3,)."""
    transform = np.eye(4)
    transform[:3, :3] = rotation
    transform[:3, 3] = translation
    return transform


def transformed(points: NDArray[np.floating], transform: NDArray[np.floating]) -> NDArray[np.float64]:
    """Apply an affine transform (4, 4) to points (N, 3)."""
    return np.asarray(points @ transform[:3, :3].T + transform[:3, 3])


def direction_of(azimuth: float, elevation: float) -> NDArray[np.float64]:
    """Return the unit vector, float64 (3,), at an azimuth about y, from z to x, and an elevation above, radians."""
    level = np.cos(elevation)
    return np.array([np.sin(azimuth) * level, np.sin(elevation), np.cos(azimuth) * level])


def look_at(centre: ArrayLike, target: ArrayLike) -> NDArray[np.float64]:
    """Return `cam_from_world`, float64 (4, 4), of an upright camera at `centre` (3,) that looks at `target` (3,), mm.

    A ValueError says that the viewing direction is zero or vertical.
    """
    centre = np.asarray(centre, dtype=np.float64)
    forward = np.asarray(target, dtype=np.float64) - centre
    right = np.cross(forward, UP)
    if np.linalg.norm(right) < 1e-9 * max(1.0, float(np.linalg.norm(forward))):
        raise ValueError(f"cannot look from {centre} along {forward}: zero or parallel to up")
    forward, right = forward / np.linalg.norm(forward), right / np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return rigid(rotation, -rotation @ centre)


def _matrix(values: ArrayLike, shape: tuple[int, int], name: str) -> NDArray[np.float64]:
    matrix = np.array(values, dtype=np.float64)
    if matrix.shape != shape:
        raise ValueError(f"{name} has shape {matrix.shape}, expected {shape}")
    if not np.isfinite(matrix).all():
        raise ValueError(f"{name} holds values that are not finite numbers: {matrix.tolist()}")
    return matrix


def _check_intrinsics(K: NDArray[np.float64], size: tuple[int, int]) -> None:
    if K[0, 0] <= 0 or K[1, 1] <= 0 or K[1, 0] != 0 or not np.array_equal(K[2], (0, 0, 1)):
        raise ValueError(f"K = {K.tolist()} is not a camera matrix: expected [[fx, s, cx], [0, fy, cy], [0, 0, 1]]")
    if not 1 <= min(size) <= max(size) <= MOST_PIXELS:
        raise ValueError(f"image size {size} is not positive and at most {MOST_PIXELS}")
    if K[[0, 1], [0, 1]].max() > LONGEST_FOCAL * max(size):
        raise ValueError(
            f"K has a focal length of {K[[0, 1], [0, 1]].max():g} px for pictures of {size[0]}x{size[1]}, expected at "
            f"most {LONGEST_FOCAL:g} times as long; is it in pixels?"
        )
    if not abs(K[0, 1]) < K[0, 0]:
        raise ValueError(f"K has a skew of {K[0, 1]:g} px, expected less than fx, {K[0, 0]:g} px")
    if not _off_axis(K, size) <= MOST_OFF_AXIS:
        raise ValueError(
            f"K = {K.tolist()}: corners of a picture of {size[0]}x{size[1]} lie {_off_axis(K, size):.3g} focal lengths "
            f"beside its axis, expected at most {MOST_OFF_AXIS:g}; are focal lengths and centre in pixels of this size?"
        )
    if K[0, 0] > MOST_ANAMORPHIC * K[1, 1] or K[1, 1] > MOST_ANAMORPHIC * K[0, 0]:
        raise ValueError(f"K has the focal lengths {K[0, 0]:g} and {K[1, 1]:g} px, expected nearly the same")


def _off_axis(K: NDArray[np.float64], size: tuple[int, int]) -> float:
    """Return how far the picture's farthest corner is from the axis, focal lengths."""
    with np.errstate(over="ignore"):
        ways = [max(abs(K[axis, 2]), abs(size[axis] - 1 - K[axis, 2])) / K[axis, axis] for axis in (0, 1)]
        return float(np.hypot(*ways))


def _check_place(transform: NDArray[np.float64]) -> None:
    if (away := float(np.abs(transform[:3, 3]).max())) > FARTHEST_MM:
        raise ValueError(
            f"cam_from_world puts the camera {away:g} mm from the world's origin, expected at most {FARTHEST_MM:g} mm; "
            "check the unit"
        )


def _check_distortion(dist: NDArray[np.float64], off_axis: float) -> None:
    if dist.size not in (0, 4, 5, 8, 12, 14) or not np.isfinite(dist).all():
        raise ValueError(f"dist has {dist.size} values, expected 0, 4, 5, 8, 12 or 14 finite numbers")
    with np.errstate(over="ignore"):
        shares = np.abs(dist) * off_axis ** np.array(DIST_POWERS[: dist.size])
    if (shares > MOST_DISTORTION).any():
        worst = int(shares.argmax())
        raise ValueError(
            f"dist[{worst}] is {dist[worst]:g}, which throws a corner of the picture {shares[worst]:.3g} times as far "
            f"as it is from the axis, expected at most {MOST_DISTORTION:g} times"
        )


def _check_rigid(transform: NDArray[np.float64]) -> None:
    rotation = transform[:3, :3]
    error = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if not error <= ROTATION_TOLERANCE or np.linalg.det(rotation) < 0 or not np.array_equal(transform[3], (0, 0, 0, 1)):
        raise ValueError(
            f"cam_from_world is not a rigid transform: R R^T differs from the identity by {error:.3g}, "
            f"det R = {np.linalg.det(rotation):.3g}, last row {transform[3].tolist()}"
        )
