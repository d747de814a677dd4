"""The check of a sensor's depth maps: files, sizes and units, and how much of the object they cover."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.depth_maps import depth_maps_of, depth_size, rays, read_depth_map
from recon.capture.format import CaptureError, SensorStream, depth_path, mask_pictures, read_mask
from recon.capture.rectify import rectify_depth, rectify_left_mask, scaled_camera
from recon.geometry.rig import Camera, bounds_corners

MIN_INSIDE = 0.05  # of the depths lie within the bounds; the rest is background
WRONG_UNITS = (0.001, 0.01, 0.1, 10.0, 100.0, 1000.0)  # times the depths: metres for millimetres, and the like
MIN_COVERAGE = 0.05  # of what the bounds show, background and all
SAMPLES = 200_000  # depths of all frames together that are compared with the bounds


@dataclass(frozen=True)
class DepthCheck:
    """The result of a check of depth maps.

    Parameters
    ----------
    problems, warnings : sentences
    coverage : share of what the bounds (or the masks) show that has a depth, mean over the sound frames; None without
    median_mm : median depth of the sound frames; None without
    """

    problems: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    coverage: float | None = None
    median_mm: float | None = None


def check_depth_maps(folder: Path, stream: SensorStream, n_frames: int, bounds: NDArray[np.float64]) -> DepthCheck:
    """Read all depth maps of a sensor and say what is wrong with them.

    Parameters
    ----------
    folder : the capture's
    stream : a sensor with depth maps
    n_frames : of the capture
    bounds : float64 (2, 3), mm, of the capture
    """
    depth = depth_maps_of(stream)
    problems: list[str] = []
    medians: list[float] = []
    coverages: list[float] = []
    samples: list[NDArray[np.float64]] = []
    in_camera = rays(scaled_camera(stream.left.camera, depth_size(stream))).reshape(-1, 3)
    for frame in range(n_frames):
        try:
            z = read_depth_map(folder, stream, frame)
            area = _object_area(folder, stream, frame, bounds)
        except CaptureError as error:
            problems.append(str(error))
            continue
        valid = np.isfinite(z)
        if not valid.any():
            problems.append(f"{depth_path(folder, depth, frame)}: holds no depth at all, only 0 or NaN")
            continue
        chosen = np.flatnonzero(valid)
        chosen = chosen[:: len(chosen) * n_frames // SAMPLES + 1]
        samples.append(in_camera[chosen] * z.ravel()[chosen, None])
        medians.append(float(np.median(z[valid])))
        coverages.append(float(valid[area].mean()) if area.any() else 0.0)
    if not samples:
        return DepthCheck(tuple(problems))
    unit = _unit_problem(stream, np.concatenate(samples), bounds)
    coverage = float(np.mean(coverages))
    warnings: list[str] = []
    if unit is None and coverage < MIN_COVERAGE:
        warnings.append(f"sensor {stream.id}: only {coverage:.0%} of what the bounds or masks show has a given depth")
    problems += [unit] if unit else []
    return DepthCheck(tuple(problems), tuple(warnings), coverage, float(np.median(medians)))


def bounds_area(camera: Camera, bounds: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mark where a point of the bounds can lie in a picture, bool (H, W).

    Parameters
    ----------
    camera : without distortion
    bounds : float64 (2, 3), mm, in front of the camera
    """
    outline = cv2.convexHull(np.round(camera.project(bounds_corners(bounds))).astype(np.int32))
    area = np.zeros((camera.size[1], camera.size[0]), dtype=np.uint8)
    return np.asarray(cv2.fillConvexPoly(area, outline, 1) > 0)


def _object_area(folder: Path, stream: SensorStream, frame: int, bounds: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mark where the object may be in a depth map, bool (H, W); lens distortion is left out of account."""
    view = rectify_depth(stream.sensor, depth_size(stream), bounds)
    masks = mask_pictures(folder, stream, frame)
    if masks:
        return rectify_left_mask(view, read_mask(masks[0]))
    if view.left.points_in_camera(bounds_corners(bounds))[:, 2].min() <= 0:  # the camera stands among what it shows
        return np.ones(view.left.size[::-1], dtype=np.bool_)
    return bounds_area(view.left, bounds)


def _unit_problem(stream: SensorStream, points: NDArray[np.float64], bounds: NDArray[np.float64]) -> str | None:
    """Say that the depths (N, 3), mm in the camera, miss the bounds, and in which unit they would not."""
    if _share_inside(stream.left.camera, points, bounds) >= MIN_INSIDE:
        return None
    shares = {factor: _share_inside(stream.left.camera, points * factor, bounds) for factor in WRONG_UNITS}
    factor = max(shares, key=shares.__getitem__)
    z = points[:, 2]
    place = f"sensor {stream.id}: the depths are {z.min():.4g} to {z.max():.4g} mm"
    if shares[factor] < MIN_INSIDE:
        return f"{place}, and hardly any lies within the bounds; check the bounds, the pose and the depths' scale_mm"
    scale = depth_maps_of(stream).scale_mm
    wrong = f"{1 / factor:g} times too large" if factor < 1 else f"{factor:g} times too small"
    return f"{place}, about {wrong} for the bounds; set scale_mm to {scale * factor:g} instead of {scale:g}"


def _share_inside(camera: Camera, points: NDArray[np.float64], bounds: NDArray[np.float64]) -> float:
    in_world = (points - camera.cam_from_world[:3, 3]) @ camera.rotation
    return float(((in_world >= bounds[0]) & (in_world <= bounds[1])).all(axis=1).mean())
