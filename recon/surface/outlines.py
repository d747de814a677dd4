"""The outlines of a surface, made to follow the masks of all sensors.

The object lies inside every mask that looks at it, whatever hides it there. So points beside a mask are left out, and a
surface that was made a little too wide is smoothed along its rims, drawn in to the masks' edges where it lies up to
`reach` beside them, and cut off there where it lies farther away. One rule protects against a mask that lacks a part:
where two other sensors measured the place, a mask beside it says nothing.

Source
------
Laurentini, The visual hull concept for silhouette-based image understanding, 1994.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.capture.format import Capture, SensorStream, read_masks
from recon.capture.rectify import scaled_camera, undistortion_maps
from recon.geometry.mesh import Cloud, Mesh
from recon.geometry.rig import Camera
from recon.surface import SurfaceParameters
from recon.surface.components import component_labels, whole_components
from recon.surface.rims import cut, smooth_rims

FAR_PX = 1e3  # the distance to a mask that says nothing
UNCERTAIN_PX = 0.25  # of a mask's edge
BLUR_PX = 1.0  # takes the steps of whole pixels off the masks' edges
OVERHANG = 0.7  # wide enough that masks end the surface, not its points
WITNESSES = 2  # other sensors that measured a place inside their masks, against the mask of a single one
WITNESS_REACHES = 1.0  # how near their points are
SUPPORT_REACHES = 1.5  # how near a sensor's points are to a component that it measured
DISBELIEVED = 0.2  # share of the other sensors' points: masks that refuse more are wrong, or their camera is
STEP = 10  # every tenth point tells that share
SNAPPING_ROUNDS = 4
TURNED_AWAY = 0.5  # cosine between the normal and the way out of a mask from which a surface bulges out of it
TOUCHING = 0.05  # of the reach: what was drawn in stops that near to the edge
ROUNDS_AFTER = 40  # after the cut: a surface that is rough in depth is cut into teeth
BESIDE = 0.3  # of the reach: what is smoothed then may lie so far beside a mask
MIN_COMPONENT = 0.002  # of the largest one's faces, seen by two sensors: a hand
MIN_UNSUPPORTED = 0.1  # of the largest one's faces, seen by a single one: a flap is smaller
SUPPORTED = 0.5  # of a component's vertices that a sensor measured


@dataclass(frozen=True, eq=False)
class Silhouette:
    """A mask as distances to its edge.

    Parameters
    ----------
    camera : without distortion, its pixels square
    distance : float32 (H, W), pixels, positive inside the mask, `FAR_PX` where the mask says nothing
    """

    camera: Camera
    distance: NDArray[np.float32]

    def margins(self, points: NDArray[np.floating]) -> NDArray[np.float32]:
        """Measure how far points (N, 3), mm, lie inside the silhouette: float32 (N,), mm at their depth."""
        pixels, mm_per_px = self._seen(points)
        return self._at(pixels) * mm_per_px

    def slopes(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Find the directions (N, 3) across the line of sight in which margins of points (N, 3) grow: mm per mm."""
        pixels, _ = self._seen(points)
        right, down = np.eye(2, dtype=np.float32)
        slope = np.stack([self._at(pixels + step) - self._at(pixels - step) for step in (right, down)], axis=1) / 2
        return np.asarray(slope @ self.camera.rotation[:2])

    def _seen(self, points: NDArray[np.floating]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        in_camera = self.camera.points_in_camera(points)
        z = in_camera[:, 2]
        in_front = np.where(z > 0, z, np.inf)
        pixels = (in_camera @ self.camera.K.T)[:, :2] / in_front[:, None]
        pixels[z <= 0] = -FAR_PX
        pixels = np.clip(pixels, -FAR_PX, max(self.camera.size) + FAR_PX)
        return pixels.astype(np.float32), (np.abs(z) / self.camera.K[0, 0]).astype(np.float32)

    def _at(self, pixels: NDArray[np.float32]) -> NDArray[np.float32]:
        """Interpolate the distance, px, at pixels (N, 2), in rows that OpenCV can address."""
        width = 1024
        padded = np.full((-len(pixels) % width + len(pixels), 2), -FAR_PX, np.float32)
        padded[: len(pixels)] = pixels
        columns, rows = (np.ascontiguousarray(padded[:, axis].reshape(-1, width)) for axis in (0, 1))
        if not columns.size:
            return np.zeros(0, np.float32)
        values = cv2.remap(self.distance, columns, rows, cv2.INTER_LINEAR, borderValue=FAR_PX)
        return np.asarray(values.ravel()[: len(pixels)])


@dataclass(frozen=True, eq=False)
class Sight:
    """What a sensor says about places: its silhouettes, none if it has no say, and the cloud that it measured."""

    sensor_id: str
    silhouettes: tuple[Silhouette, ...]
    cloud: Cloud

    @cached_property
    def tree(self) -> cKDTree:
        """The cloud's points, to find the nearest."""
        return cKDTree(self.cloud.points, balanced_tree=False, compact_nodes=False)  # a third of the time

    def measured(self, points: NDArray[np.floating], reach: float) -> NDArray[np.bool_]:
        """Tell which points (N, 3), mm, have a point of the cloud within `reach` mm: bool (N,)."""
        if not len(self.cloud):
            return np.zeros(len(points), dtype=bool)
        is_near: NDArray[np.bool_] = np.isfinite(self.tree.query(points, distance_upper_bound=reach)[0])
        return is_near

    def margins(self, points: NDArray[np.floating]) -> NDArray[np.float32]:
        """Measure how far points (N, 3), mm, lie inside all silhouettes of the sensor: float32 (N,), mm."""
        least = np.full(len(points), np.inf, np.float32)
        for silhouette in self.silhouettes:
            np.minimum(least, silhouette.margins(points), out=least)
        return least


def widened(surface: SurfaceParameters) -> SurfaceParameters:
    """Let a surface reach past its points and keep small components: `follow_masks` will cut."""
    overhang, share = max(surface.overhang, OVERHANG), min(surface.min_component, MIN_COMPONENT)
    return replace(surface, overhang=overhang, min_component=share)


def silhouette_of(mask: NDArray[np.bool_], camera: Camera) -> Silhouette:
    """Measure the distances to the edge of a mask, bool (H, W), which its camera recorded with distortion.

    The picture's border is no edge: an object may go on beyond it.
    """
    K = camera.K.copy()
    K[0, 1] = 0.0
    width, height = camera.size
    square = width, max(round(height * K[0, 0] / K[1, 1]), 1)  # so that distances are the same in all directions
    flat = scaled_camera(Camera(K, camera.size, camera.cam_from_world), square)
    columns, rows = undistortion_maps(camera, flat)
    inside = cv2.remap(mask.astype(np.uint8), columns, rows, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
    distance = cv2.distanceTransform(inside, cv2.DIST_L2, 5) - cv2.distanceTransform(1 - inside, cv2.DIST_L2, 5)
    blurred = cv2.GaussianBlur(np.clip(distance, -FAR_PX, FAR_PX), (0, 0), BLUR_PX) + np.float32(UNCERTAIN_PX)
    blurred[(columns < 0) | (rows < 0) | (columns > width - 1) | (rows > height - 1)] = FAR_PX
    return Silhouette(flat, blurred)


def read_sights(capture: Capture, streams: Sequence[SensorStream], clouds: Sequence[Cloud], frame: int) -> list[Sight]:
    """Read the masks of sensors at a frame; a sensor without masks, or with an empty one, has no silhouettes.

    Parameters
    ----------
    capture : the recording
    streams, clouds : the sensors, and what each of them measured
    frame : of the capture
    """
    sights = []
    for stream, cloud in zip(streams, clouds, strict=True):
        masks = read_masks(capture, stream.id, frame) or ()
        shown = [
            silhouette_of(mask, side.camera) for mask, side in zip(masks, stream.cameras, strict=False) if mask.any()
        ]
        sights.append(Sight(stream.id, tuple(shown), cloud))
    return sights


def with_outlines(
    sights: Sequence[Sight], reach: float, fuse: Callable[[Sequence[Cloud]], tuple[Mesh, list[str]]]
) -> tuple[Mesh, list[str]]:
    """Fuse what the sensors measured into a mesh whose outlines follow their masks.

    Parameters
    ----------
    sights : of all sensors
    reach : mm, how far beside a mask a place may lie to be drawn in; a voxel
    fuse : makes a wide mesh of the clouds, and sentences on those that it left out

    Returns
    -------
    the mesh, and a sentence for each cloud that was left out and each sensor whose masks are not believed
    """
    sights, reasons = believed(sights, reach)
    mesh, left_out = fuse(drop_outside(sights, reach))
    return follow_masks(mesh, sights, reach), [*left_out, *reasons]


def believed(sights: Sequence[Sight], reach: float) -> tuple[list[Sight], list[str]]:
    """Take the say from sensors whose masks refuse too much of what the others measured; a sentence for each.

    A sensor without masks measures the background, too, so what it measured speaks against no mask.

    Parameters
    ----------
    sights : of all sensors
    reach : mm, beside a mask from which a point is refused
    """
    kept, reasons = [], []
    for sight in sights:
        others = np.concatenate(
            [np.zeros((0, 3), np.float32)]
            + [other.cloud.points[::STEP] for other in sights if other is not sight and other.silhouettes]
        )
        refused = float(np.mean(sight.margins(others) < -reach)) if len(others) and sight.silhouettes else 0.0
        if refused > DISBELIEVED:
            reasons.append(
                f"the masks of sensor {sight.sensor_id} leave out {refused:.0%} of what the other sensors measured "
                f"(up to {DISBELIEVED:.0%} are expected), so they cut nothing off; look at them and at `capture check`"
            )
        kept.append(replace(sight, silhouettes=()) if refused > DISBELIEVED else sight)
    return kept, reasons


def drop_outside(sights: Sequence[Sight], reach: float) -> list[Cloud]:
    """Leave out the points of all clouds that lie more than `reach` mm beside a mask."""
    return [sight.cloud.select(_margins(sight.cloud.points, sights, reach).min(axis=0) >= -reach) for sight in sights]


def follow_masks(mesh: Mesh, sights: Sequence[Sight], reach: float) -> Mesh:
    """Make the outlines of a mesh follow the masks.

    Parameters
    ----------
    mesh : without texture, wider than it should be
    sights : of all sensors
    reach : mm, how far a vertex is moved at most to lie inside all masks; about a voxel
    """
    mesh = smooth_rims(mesh)
    mesh = _drawn_in(mesh, sights, reach)
    least = _margins(mesh.vertices, sights, reach).min(axis=0)
    mesh = drop_flaps(cut(mesh, np.minimum(least + TOUCHING * reach, reach)), sights, reach)
    return smooth_rims(mesh, ROUNDS_AFTER, lambda places: _lie_within(places, sights, reach))


def drop_flaps(mesh: Mesh, sights: Sequence[Sight], reach: float) -> Mesh:
    """Drop components that are too small: those that a single sensor measured soonest, where there are several.

    Parameters
    ----------
    mesh : without texture
    sights : of all sensors
    reach : mm, a voxel
    """
    labels = component_labels(mesh.faces, len(mesh.vertices))
    sizes = np.bincount(labels[mesh.faces[:, 0]], minlength=len(mesh.vertices))
    kept = sizes >= max(MIN_COMPONENT * sizes.max(initial=1), 1)
    if len(sights) > 1:
        small = kept & (sizes < MIN_UNSUPPORTED * sizes.max())
        asked = np.flatnonzero(small[labels])
        n_vertices = np.maximum(np.bincount(labels[asked], minlength=len(sizes)), 1)
        n_sensors = np.zeros(len(sizes), int)
        for sight in sights:
            seen = asked[sight.measured(mesh.vertices[asked], SUPPORT_REACHES * reach)]
            n_sensors += np.bincount(labels[seen], minlength=len(sizes)) >= SUPPORTED * n_vertices
        kept &= ~small | (n_sensors > 1)
    return whole_components(mesh, kept[labels])


def _lie_within(places: NDArray[np.float64], sights: Sequence[Sight], reach: float) -> NDArray[np.bool_]:
    """Tell which places (N, 3), mm, lie inside all masks, or less than a part of `reach` mm beside them."""
    is_outside = np.min([sight.margins(places) for sight in sights], axis=0) < -BESIDE * reach
    is_outside[is_outside] = _margins(places[is_outside], sights, reach).min(axis=0) < -BESIDE * reach
    return np.asarray(~is_outside)


def _margins(points: NDArray[np.floating], sights: Sequence[Sight], reach: float) -> NDArray[np.float32]:
    """Measure how far points (N, 3) lie inside the masks of each sensor, (S, N), mm; inf where it is overruled."""
    margins = np.stack([sight.margins(points) for sight in sights])
    doubtful = np.flatnonzero((margins < 0).any(axis=0))
    asked = margins[:, doubtful]
    measured = np.stack([sight.measured(points[doubtful], WITNESS_REACHES * reach) for sight in sights])
    is_witness = measured & (asked >= 0)
    margins[:, doubtful] = np.where(is_witness.sum(axis=0) - is_witness >= WITNESSES, np.inf, asked)
    return margins


def _drawn_in(mesh: Mesh, sights: Sequence[Sight], reach: float) -> Mesh:
    """Push a surface that bulges up to `reach` mm out of masks back along its normals; the rest stays where it is."""
    least = _margins(mesh.vertices, sights, reach)
    chosen = np.flatnonzero((least.min(axis=0) < 0) & (least.min(axis=0) > -reach))
    is_overruled = np.isinf(least[:, chosen])
    before, normals = mesh.vertices[chosen].astype(np.float64), mesh.normals[chosen].astype(np.float64)
    places = before.copy()
    for _ in range(SNAPPING_ROUNDS):
        for sight, overruled in zip(sights, is_overruled, strict=True):
            for silhouette in sight.silhouettes:
                margins = silhouette.margins(places)
                growth = (silhouette.slopes(places) * normals).sum(axis=1)
                pushed = ~overruled & (margins < 0) & (growth < -TURNED_AWAY)
                places[pushed] -= (margins[pushed] / growth[pushed])[:, None] * normals[pushed]
    vertices = mesh.vertices.copy()
    near = np.linalg.norm(places - before, axis=1) <= reach / TURNED_AWAY
    vertices[chosen[near]] = places[near].astype(np.float32)
    return replace(mesh, vertices=vertices)
