"""Rectified pairs: both pictures of a sensor as seen by two parallel cameras, so that a point lies in the same row.

The pictures are cut to what the capture's bounds and the cameras have in common, and the principal points are
chosen such that disparity 0 is at the far side of the bounds instead of at infinity.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.geometry.rig import Camera, Sensor, bounds_corners, rigid

MARGIN_PX = 16  # around the bounds: context for the matcher's windows
FAR_DISPARITY = 1.0  # of the bounds' far side: a neighbour below for subpixel fits
MIN_ACROSS = 0.2  # sine of the smallest angle between the baseline and the viewing direction, 11.5 degrees
MIN_SIZE_PX = 8  # below this nothing can be matched
BORDER_STEPS = 64  # points along each edge of a picture when its outline is undistorted
IMAGINED_BASELINE = 0.1  # of the distance to the middle of the bounds, as docs/capture.md recommends for pairs
# At most 40 steps, until 1e-8 is reached: OpenCV's 5 miss by pixels at wide lenses' rims.
EXACT = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-8)
FARTHEST_SLOPE = 20.0  # tangent of the largest angle from the rectified viewing direction, 87 degrees

Maps = tuple[NDArray[np.float32], NDArray[np.float32]]


@dataclass(frozen=True, eq=False)
class Rectification:
    """Two parallel cameras that replace those of a sensor.

    Parameters
    ----------
    left, right : without distortion, same size, same K except for cx, x axis along the baseline
    n_disparities : disparities 0 .. n_disparities - 1 cover the capture's bounds
    left_maps, right_maps : float32 (H, W) each, column and row of the original picture for each rectified pixel
    """

    sensor_id: str
    left: Camera
    right: Camera
    n_disparities: int
    left_maps: Maps = field(repr=False)
    right_maps: Maps = field(repr=False)

    @property
    def focal(self) -> float:
        """Focal length, pixels."""
        return float(self.left.K[0, 0])

    @property
    def baseline(self) -> float:
        """Distance between the optical centres, mm."""
        return float(np.linalg.norm(self.right.centre - self.left.centre))

    @property
    def offset(self) -> float:
        """Disparity of a point at infinity, pixels: z = focal * baseline / (disparity - offset)."""
        return float(self.left.K[0, 2] - self.right.K[0, 2])

    def depth(self, disparity: NDArray[np.floating]) -> NDArray[np.float64]:
        """Convert disparities, float (H, W), to depth along the rectified view, mm; NaN beyond infinity."""
        parallax = np.asarray(disparity, dtype=np.float64) - self.offset
        return self.focal * self.baseline / np.where(parallax > 0, parallax, np.nan)


def rectify(sensor: Sensor, bounds: NDArray[np.floating]) -> Rectification:
    """Choose the rectified cameras of a sensor for a space.

    Convention: the x axis runs from the left to the right optical centre, y = z x x, and z is the mean viewing
    direction made perpendicular to x. Disparity = left column - right column.

    Parameters
    ----------
    sensor : Sensor
    bounds : float64 (2, 3), mm, lowest and highest corner of the space to be seen

    Raises
    ------
    ValueError
        If the baseline is along the viewing direction, or the bounds are not wholly in front of the cameras, out
        of view, or so near that they span more disparities than the picture is wide.
    """
    rotation = _rotation(sensor)
    focal = float(np.mean([np.diag(camera.K)[:2] for camera in (sensor.left, sensor.right)]))
    cameras = [_camera_at(camera, rotation, focal) for camera in (sensor.left, sensor.right)]
    near, far = _depths(sensor.id, cameras[0], bounds)
    offset = FAR_DISPARITY - focal * sensor.baseline / far
    n_disparities = int(np.ceil(focal * sensor.baseline / near + offset)) + 2  # one above for subpixel fits

    originals = (sensor.left, sensor.right)
    views = [_view(original, camera, bounds) for original, camera in zip(originals, cameras, strict=True)]
    views[1] = views[1] - np.array([offset, 0.0])  # the right picture's columns, moved by the offset
    box = _common_box(sensor.id, views[0], views[1])
    _check_disparities(sensor.id, n_disparities, box, near)
    left, right = (_cut(camera, box, shift) for camera, shift in zip(cameras, (0.0, -offset), strict=True))
    return Rectification(
        sensor.id,
        left,
        right,
        n_disparities,
        undistortion_maps(sensor.left, left),
        undistortion_maps(sensor.right, right),
    )


def rectify_depth(sensor: Sensor, depth_size: tuple[int, int], bounds: NDArray[np.floating]) -> Rectification:
    """Imagine the pair of which a camera's depth maps are disparity maps: z = focal * baseline / disparity.

    The left view is the camera itself without its distortion, in the resolution of the depth maps; the right one stands
    a tenth of the distance beside it. So a pixel of disparity means the same as for a good stereo sensor where surfaces
    end and errors of points are estimated. There are no pictures of the right view, its maps are those of the left.

    Parameters
    ----------
    sensor : whose left camera has depth maps
    depth_size : (width, height) of the depth maps, pixels
    bounds : float64 (2, 3), mm, lowest and highest corner of the space to be seen
    """
    left = _straightened(scaled_camera(sensor.left, depth_size))
    distance = float(np.linalg.norm(left.centre - bounds.mean(axis=0)))
    radius = float(np.linalg.norm(bounds[1] - bounds[0])) / 2  # of bounds around the camera, such as a room
    baseline = IMAGINED_BASELINE * max(distance, radius)
    right = replace(left, cam_from_world=rigid(np.eye(3), (-baseline, 0.0, 0.0)) @ left.cam_from_world)
    near = max(float(left.points_in_camera(bounds_corners(bounds))[:, 2].min()), baseline)
    n_disparities = int(np.ceil(left.K[0, 0] * baseline / near)) + 1
    maps = undistortion_maps(sensor.left, left)
    return Rectification(sensor.id, left, right, n_disparities, maps, maps)


def scaled_camera(camera: Camera, size: tuple[int, int]) -> Camera:
    """Return a camera that records the same picture in another size, (width, height) pixels."""
    scale = np.diag([size[0] / camera.size[0], size[1] / camera.size[1], 1.0])
    corner = np.array([[1.0, 0, 0.5], [0, 1.0, 0.5], [0, 0, 1.0]])  # from pixel centres to the picture's corner
    return replace(camera, K=np.linalg.inv(corner) @ scale @ corner @ camera.K, size=size)


def undistortion_maps(original: Camera, rectified: Camera) -> Maps:
    """Compute where a rectified camera's pixels lie in the original picture: columns and rows, float32 (h, w) each.

    Parameters
    ----------
    original : the camera that recorded the picture
    rectified : without distortion, in the same place
    """
    rotation = rectified.rotation @ original.rotation.T
    columns, rows = cv2.initUndistortRectifyMap(
        original.K, original.dist, rotation, rectified.K, rectified.size, cv2.CV_32FC1
    )
    skew = original.K[0, 1] / original.K[1, 1]  # OpenCV knows none
    return columns + np.float32(skew) * (rows - np.float32(original.K[1, 2])), rows


def viewing_directions(camera: Camera, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the point of depth 1 that each pixel (N, 2) shows, float64 (N, 3), in the camera's frame."""
    if len(pixels) == 0:  # OpenCV answers with None
        return np.zeros((0, 3))
    straight = pixels.copy()
    straight[:, 0] -= camera.K[0, 1] * (pixels[:, 1] - camera.K[1, 2]) / camera.K[1, 1]  # OpenCV knows no skew
    slopes = cv2.undistortPoints(straight[:, None], camera.K, camera.dist, criteria=EXACT)[:, 0]
    return np.column_stack([slopes, np.ones(len(slopes))])


def undistort(
    camera: Camera, picture: NDArray[np.uint8], mask: NDArray[np.bool_] | None
) -> tuple[Camera, NDArray[np.uint8], NDArray[np.bool_] | None]:
    """Return a camera without its distortion, and its picture and mask as it would have recorded them.

    Parameters
    ----------
    camera : that recorded the picture
    picture : uint8 (H, W, 3), as recorded
    mask : bool (H, W), as recorded; None where there is none
    """
    if is_straight(camera):
        return camera, picture, mask
    straight = _straightened(camera)
    maps = undistortion_maps(camera, straight)
    return straight, _remap(picture, maps), None if mask is None else _remap_mask(mask, maps)


def is_straight(camera: Camera) -> bool:
    """Tell whether a camera has neither distortion nor skew."""
    return not camera.dist.any() and not camera.K[0, 1]


def rectify_left(rectification: Rectification, left: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Warp the left picture to the rectified camera, uint8 (h, w, 3), black where the original saw nothing.

    Parameters
    ----------
    rectification : of the sensor
    left : uint8 (H, W, 3), as recorded
    """
    return _remap(left, rectification.left_maps)


def rectify_left_mask(rectification: Rectification, left_mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Warp the left mask to the rectified camera, bool (h, w), False where the original saw nothing.

    Parameters
    ----------
    rectification : of the sensor
    left_mask : bool (H, W), as recorded
    """
    return _remap_mask(left_mask, rectification.left_maps)


def rectify_images(
    rectification: Rectification, left: NDArray[np.uint8], right: NDArray[np.uint8]
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Warp both pictures to the rectified cameras, uint8 (h, w, 3) or (h, w), black where the original saw nothing.

    Parameters
    ----------
    rectification : of the sensor
    left, right : uint8 (H, W, 3) or (H, W), as recorded
    """
    return _remap(left, rectification.left_maps), _remap(right, rectification.right_maps)


def rectify_masks(
    rectification: Rectification, left_mask: NDArray[np.bool_], right_mask: NDArray[np.bool_]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Warp both masks to the rectified cameras, bool (h, w), False where the original saw nothing.

    Parameters
    ----------
    rectification : of the sensor
    left_mask, right_mask : bool (H, W), as recorded
    """
    return _remap_mask(left_mask, rectification.left_maps), _remap_mask(right_mask, rectification.right_maps)


def _straightened(camera: Camera) -> Camera:
    """Return a camera without its distortion and skew."""
    K = camera.K.copy()
    K[0, 1] = 0.0
    return Camera(K, camera.size, camera.cam_from_world)


def _rotation(sensor: Sensor) -> NDArray[np.float64]:
    x = (sensor.right.centre - sensor.left.centre) / sensor.baseline
    forward = sensor.left.rotation[2] + sensor.right.rotation[2]
    across = forward - (forward @ x) * x
    if np.linalg.norm(across) < MIN_ACROSS * max(1.0, float(np.linalg.norm(forward))):
        raise ValueError(
            f"sensor {sensor.id}: the mean viewing direction {np.round(forward / 2, 3).tolist()} is nearly along the "
            f"baseline {np.round(x, 3).tolist()}; such a pair cannot be rectified"
        )
    z = across / np.linalg.norm(across)
    return np.stack([x, np.cross(z, x), z])


def _camera_at(camera: Camera, rotation: NDArray[np.float64], focal: float) -> Camera:
    K = np.diag([focal, focal, 1.0])
    return Camera(K, camera.size, rigid(rotation, -rotation @ camera.centre))


def _depths(sensor_id: str, camera: Camera, bounds: NDArray[np.floating]) -> tuple[float, float]:
    z = camera.points_in_camera(bounds_corners(bounds))[:, 2]
    if z.min() <= 0:
        raise ValueError(
            f"sensor {sensor_id}: the bounds {np.asarray(bounds).tolist()} lie {z.min():.0f} to {z.max():.0f} mm in "
            "front of the cameras, expected all of them in front; check the bounds and the poses"
        )
    return float(z.min()), float(z.max())


def _view(original: Camera, camera: Camera, bounds: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the part of the bounds that the original shows: (2, 2), lowest and highest (column, row) in `camera`."""
    outline = camera.project(bounds_corners(bounds))
    shown = _outline(original, camera)
    low = np.maximum(outline.min(axis=0) - MARGIN_PX, shown.min(axis=0))
    high = np.minimum(outline.max(axis=0) + MARGIN_PX, shown.max(axis=0))
    return np.stack([low, high])


def _outline(original: Camera, camera: Camera) -> NDArray[np.float64]:
    """Return the border of the original picture as the rectified camera sees it, (N, 2) pixels."""
    width, height = original.size
    along = np.linspace(0.0, 1.0, BORDER_STEPS)
    zeros, ones = np.zeros(BORDER_STEPS), np.ones(BORDER_STEPS)
    border = np.concatenate(
        [np.stack(edge, axis=1) for edge in ((along, zeros), (along, ones), (zeros, along), (ones, along))]
    )
    pixels = border * (width - 1, height - 1)
    rays = viewing_directions(original, pixels) @ (camera.rotation @ original.rotation.T).T
    depth = np.maximum(rays[:, 2:], np.linalg.norm(rays, axis=1, keepdims=True) / FARTHEST_SLOPE)
    return np.asarray(rays[:, :2] / depth * camera.K[0, 0])


def _common_box(sensor_id: str, left: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rows that both pictures show and columns that either shows: (2, 2) whole pixels, last ones included."""
    low = np.array([min(left[0, 0], right[0, 0]), max(left[0, 1], right[0, 1])])
    high = np.array([max(left[1, 0], right[1, 0]), min(left[1, 1], right[1, 1])])
    box = np.stack([np.ceil(low), np.floor(high)])
    seen = min((left[1] - left[0]).min(), (right[1] - right[0]).min(), (box[1] - box[0]).min() + 1)
    if seen < MIN_SIZE_PX:
        raise ValueError(
            f"sensor {sensor_id}: its two pictures have fewer than {MIN_SIZE_PX} rows or columns of the bounds in "
            "common; check the bounds and the poses"
        )
    return box


def _check_disparities(sensor_id: str, n_disparities: int, box: NDArray[np.float64], near: float) -> None:
    width = int(box[1, 0] - box[0, 0]) + 1
    if n_disparities >= width:
        raise ValueError(
            f"sensor {sensor_id}: the bounds begin {near:.0f} mm in front of the cameras and span {n_disparities} "
            f"disparities, more than the {width} columns that show them; take tighter bounds"
        )


def _cut(camera: Camera, box: NDArray[np.float64], shift: float) -> Camera:
    K = camera.K.copy()
    K[:2, 2] = (shift - box[0, 0], -box[0, 1])
    width, height = (box[1] - box[0]).astype(int) + 1
    return Camera(K, (width, height), camera.cam_from_world)


def _remap(image: NDArray[np.uint8], maps: Maps) -> NDArray[np.uint8]:
    return np.asarray(cv2.remap(image, *maps, cv2.INTER_CUBIC, borderMode=cv2.BORDER_CONSTANT, borderValue=0))


def _remap_mask(mask: NDArray[np.bool_], maps: Maps) -> NDArray[np.bool_]:
    nearest = cv2.remap(mask.astype(np.uint8), *maps, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
    return np.asarray(nearest > 0)
