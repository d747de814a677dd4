"""Colours of places on a mesh from the photographs that see them: the work behind a texture.

A camera counts for a place by its quality: 0 where something hides the place or the mask leaves it out, else more the
more pixels it has for the place, and the farther the place lies from edges of the mask and of the depth. Coarse shades
are averaged by quality, so that no seam shows where another camera takes over. Fine detail, which an average would
blur, comes almost wholly from the best camera. A camera whose shade most others contradict hardly counts: it sees
something that the mesh lacks, such as a hand before a chest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.capture.format import Capture, SensorStream, read_frame, read_masks
from recon.capture.rectify import undistort
from recon.geometry.mesh import Mesh
from recon.geometry.rig import Camera

COARSE_SIGMA_PX = 2.0  # what a photograph loses by this blur is fine detail
EDGE_PX = 8.0  # a place that far from edges counts fully
LEAST_FACING = 0.1  # cosine to the surface, below which a camera does not count
CONTRADICTED = 40.0  # grey levels from the median of at least three cameras, where a camera counts half
SHARPNESS = 2  # power of the quality by which detail is averaged
FALLBACK = 1e-4  # quality of the mesh's own colours
MARGIN_PX = 16  # around the mesh in a photograph: room for the blur
ROW = 1024  # places a row, as OpenCV maps images only


@dataclass(frozen=True, eq=False)
class Photograph:
    """What a camera saw.

    Parameters
    ----------
    camera : without distortion
    pixels : uint8 (H, W, 3), sRGB
    mask : bool (H, W), where the object is; None where that is not known
    """

    camera: Camera
    pixels: NDArray[np.uint8]
    mask: NDArray[np.bool_] | None


@dataclass(frozen=True, eq=False)
class Drawn:
    """A mesh before a camera.

    Parameters
    ----------
    projected : float64 (N, 3), per vertex column, row (pixels) and depth (mm)
    face : int32 (H, W), the face that each pixel's centre sees, -1 for none
    nearness : float32 (H, W), 1 / depth, 0 where there is nothing
    """

    projected: NDArray[np.float64]
    face: NDArray[np.int32]
    nearness: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class View:
    """A photograph that is ready to colour places.

    Parameters
    ----------
    photograph : cut to the part that shows the mesh
    coarse : uint8 (H, W, 3), its shades without detail
    trust : float32 (H, W), 0 to 1: distance from edges, 0 where the object is not
    nearness : float32 (H, W), 1 / depth of the mesh, 0 where there is nothing
    """

    photograph: Photograph
    coarse: NDArray[np.uint8]
    trust: NDArray[np.float32]
    nearness: NDArray[np.float32]


def read_photographs(capture: Capture, stream: SensorStream, frame: int) -> list[Photograph]:
    """Read what the cameras of a sensor saw.

    Parameters
    ----------
    capture : the recording
    stream : of the sensor
    frame : of the capture
    """
    pictures, masks = read_frame(capture, stream.id, frame), read_masks(capture, stream.id, frame)
    return [
        Photograph(*undistort(side.camera, picture, mask))
        for side, picture, mask in zip(stream.cameras, pictures, masks or [None] * len(pictures), strict=True)
    ]


def draw(mesh: Mesh, camera: Camera) -> Drawn:
    """Find what a camera without distortion sees of a mesh from either side; faces behind it are left out."""
    in_camera = camera.points_in_camera(mesh.vertices)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        projected = np.column_stack([(in_camera @ camera.K.T)[:, :2] / in_camera[:, 2:], in_camera[:, 2]])
    width, height = camera.size
    face, nearness = np.full((height, width), -1, np.int32), np.zeros((height, width), np.float32)
    _draw_faces(projected, mesh.faces, face, nearness)
    return Drawn(projected, face, nearness)


def prepare(mesh: Mesh, photographs: Sequence[Photograph], tolerance_mm: float) -> list[View]:
    """Make photographs ready to colour a mesh; those that show nothing of it are left out.

    Parameters
    ----------
    mesh : to be coloured
    photographs : of it
    tolerance_mm : how far surfaces may lie behind each other and count as one
    """
    views = []
    for photograph in photographs:
        cut = _cut(photograph, mesh)
        if cut is None:
            continue
        nearness = draw(mesh, cut.camera).nearness
        inside = (nearness > 0) if cut.mask is None else (nearness > 0) & cut.mask
        whole = inside & ~_depth_edges(nearness, tolerance_mm)
        distance = cv2.distanceTransform(np.pad(whole, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
        trust = np.where(inside, np.clip(distance / EDGE_PX, 1 / EDGE_PX, 1), 0).astype(np.float32)
        views.append(View(cut, _blurred(cut.pixels, inside), trust, nearness))
    return views


def qualities(
    views: Sequence[View], points: NDArray[np.floating], normals: NDArray[np.floating], tolerance_mm: float
) -> NDArray[np.float32]:
    """Tell how well views see places.

    Parameters
    ----------
    views : V of them
    points : floating (N, 3), mm
    normals : floating (N, 3), unit length
    tolerance_mm : how far a place may lie behind what a view sees

    Returns
    -------
    float32 (V, N), 0 where a view does not see the place
    """
    focals = [float(np.sqrt(view.photograph.camera.K[0, 0] * view.photograph.camera.K[1, 1])) for view in views]
    finest = (
        max((focal * float(view.nearness.max()) for focal, view in zip(focals, views, strict=True)), default=0) or 1
    )
    quality = np.zeros((len(views), len(points)), np.float32)
    points, normals = points.astype(np.float64), normals.astype(np.float64)
    for view, focal, row in zip(views, focals, quality, strict=True):
        camera = view.photograph.camera
        projection = camera.K @ camera.cam_from_world[:3]
        sight = _Sight(projection, camera.centre, view.trust, view.nearness, focal / finest)
        _judge(points, normals, sight, tolerance_mm, row)
    return quality


def colours_at(
    views: Sequence[View], quality: NDArray[np.float32], points: NDArray[np.floating], fallback: NDArray[np.floating]
) -> NDArray[np.uint8]:
    """Colour places by the photographs, and by their own colours where no view sees them.

    Parameters
    ----------
    views : V of them
    quality : float32 (V, N)
    points : floating (N, 3), mm
    fallback : floating (N, 3), sRGB bytes

    Returns
    -------
    uint8 (N, 3), sRGB
    """
    shades, colours = np.zeros((2, len(views), len(points), 3), np.uint8)
    for number, view in enumerate(views):
        seen = np.flatnonzero(quality[number])
        pixels = view.photograph.camera.project(points[seen])
        shades[number, seen] = sampled(view.coarse, pixels)
        colours[number, seen] = sampled(view.photograph.pixels, pixels)
    weights = _uncontradicted(shades, quality)
    coarse, coarse_weight = FALLBACK * fallback, np.full(len(points), FALLBACK)
    best = np.maximum(weights.max(axis=0, initial=0), FALLBACK)
    fine, fine_weight = np.zeros((len(points), 3)), (FALLBACK / best) ** SHARPNESS
    for shade, colour, weight in zip(shades, colours, weights, strict=True):
        share = (weight / best) ** SHARPNESS
        coarse += weight[:, None] * shade
        coarse_weight += weight
        fine += share[:, None] * (colour.astype(np.float64) - shade)
        fine_weight += share
    blended = coarse / coarse_weight[:, None] + fine / fine_weight[:, None]
    return np.asarray(np.rint(np.clip(blended, 0, 255)), np.uint8)


def _cut(photograph: Photograph, mesh: Mesh) -> Photograph | None:
    """Cut a photograph to the part that shows a mesh; None if it shows nothing of it."""
    camera = photograph.camera
    in_front = mesh.vertices[camera.points_in_camera(mesh.vertices)[:, 2] > 0]
    if not len(in_front):
        return None
    pixels = camera.project(in_front)
    low = np.maximum(np.floor(pixels.min(axis=0)) - MARGIN_PX, 0)
    high = np.minimum(np.ceil(pixels.max(axis=0)) + MARGIN_PX + 1, camera.size)
    if (high <= low).any():
        return None
    (left, top), (right, bottom) = low.astype(int), high.astype(int)
    K = camera.K.copy()
    K[:2, 2] -= low
    window = np.s_[top:bottom, left:right]
    mask = None if photograph.mask is None else photograph.mask[window]
    return Photograph(
        Camera(K, (int(right - left), int(bottom - top)), camera.cam_from_world), photograph.pixels[window], mask
    )


def _depth_edges(nearness: NDArray[np.float32], tolerance_mm: float) -> NDArray[np.bool_]:
    """Mark pixels beside which the depth jumps by more than a tolerance."""
    farther, nearer = cv2.erode(nearness, np.ones((3, 3))), cv2.dilate(nearness, np.ones((3, 3)))
    return np.asarray(nearer - farther > 2 * tolerance_mm * nearer * farther)


def _blurred(pixels: NDArray[np.uint8], inside: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Blur a picture inside a region, by the colours in it alone; what lies outside stays as it is."""
    weight = cv2.GaussianBlur(inside.astype(np.float32), (0, 0), COARSE_SIGMA_PX)[..., None]
    total = cv2.GaussianBlur(np.where(inside[..., None], pixels, 0).astype(np.float32), (0, 0), COARSE_SIGMA_PX)
    return np.where(weight > 1e-3, np.rint(total / np.maximum(weight, 1e-3)), pixels).astype(np.uint8)


def sampled(picture: NDArray[np.uint8], pixels: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Interpolate a picture (H, W, 3) at columns and rows (N, 2), uint8 (N, 3)."""
    if not len(pixels):
        return np.zeros((0, 3), np.uint8)
    maps = np.zeros((-(-len(pixels) // ROW) * ROW, 2), np.float32)
    maps[: len(pixels)] = pixels
    values = cv2.remap(picture, maps.reshape(-1, ROW, 2), None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values.reshape(-1, 3)[: len(pixels)])


@njit(cache=True, nogil=True, error_model="numpy")
def _draw_faces(projected, faces, face, nearness):  # type: ignore[no-untyped-def]  # numba
    """Enter each face where it is the nearest so far at a pixel's centre."""
    height, width = face.shape
    for f in range(faces.shape[0]):
        a, b, c = projected[faces[f, 0]], projected[faces[f, 1]], projected[faces[f, 2]]
        if not (a[2] > 0 and b[2] > 0 and c[2] > 0):
            continue
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if area == 0:
            continue
        left, right = max(0, int(np.ceil(min(a[0], b[0], c[0])))), min(width - 1, int(np.floor(max(a[0], b[0], c[0]))))
        top, bottom = max(0, int(np.ceil(min(a[1], b[1], c[1])))), min(height - 1, int(np.floor(max(a[1], b[1], c[1]))))
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                wa = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) / area
                wb = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) / area
                wc = 1 - wa - wb
                if wa >= -1e-9 and wb >= -1e-9 and wc >= -1e-9:
                    near = np.float32(wa / a[2] + wb / b[2] + wc / c[2])
                    if near > nearness[y, x]:
                        nearness[y, x], face[y, x] = near, f


class _Sight(NamedTuple):
    """What a view sees: its projection (3, 4), centre (3,), and maps; `scale` is its focal length by the finest's."""

    projection: NDArray[np.float64]
    centre: NDArray[np.float64]
    trust: NDArray[np.float32]
    nearness: NDArray[np.float32]
    scale: float


@njit(cache=True, nogil=True, error_model="numpy")
def _judge(points, normals, sight, tolerance, quality):  # type: ignore[no-untyped-def]  # numba
    """Write how well a view sees each point (N, 3), 0 where it does not."""
    projection, centre, trust, nearness, scale = sight
    height, width = trust.shape
    for i in range(points.shape[0]):
        px, py, pz = points[i]
        column = projection[0, 0] * px + projection[0, 1] * py + projection[0, 2] * pz + projection[0, 3]
        row = projection[1, 0] * px + projection[1, 1] * py + projection[1, 2] * pz + projection[1, 3]
        depth = projection[2, 0] * px + projection[2, 1] * py + projection[2, 2] * pz + projection[2, 3]
        if depth <= 0:
            continue
        column, row = column / depth, row / depth
        if not (0 <= column <= width - 1 and 0 <= row <= height - 1):
            continue
        rx, ry, rz = centre[0] - px, centre[1] - py, centre[2] - pz
        facing = (rx * normals[i, 0] + ry * normals[i, 1] + rz * normals[i, 2]) / np.sqrt(rx * rx + ry * ry + rz * rz)
        if facing <= LEAST_FACING:
            continue
        x, y = int(column), int(row)
        after, below = min(x + 1, width - 1), min(y + 1, height - 1)
        farthest = 0.0  # depth of what the four pixels around the place see
        for near in (nearness[y, x], nearness[y, after], nearness[below, x], nearness[below, after]):
            if near > 0:
                farthest = max(farthest, 1 / near)
        if depth > farthest + tolerance:
            continue
        s, t = column - x, row - y
        upper, lower = trust[y, x] * (1 - s) + trust[y, after] * s, trust[below, x] * (1 - s) + trust[below, after] * s
        resolution = facing * scale / depth
        quality[i] = (upper * (1 - t) + lower * t) * resolution * resolution


@njit(cache=True, nogil=True)
def _uncontradicted(shades: NDArray[np.uint8], quality: NDArray[np.float32]) -> NDArray[np.float32]:
    """Lower the quality (V, N) of views whose shades (V, N, 3) lie far from the median of all that see a place."""
    n_views, n_places = quality.shape
    weights, seen, middle = quality.copy(), np.empty(n_views), np.empty(3)
    for i in range(n_places):
        n_seen = 0
        for channel in range(3):
            n_seen = 0
            for view in range(n_views):
                if quality[view, i] > 0:
                    shade = float(shades[view, i, channel])
                    place = n_seen
                    while place > 0 and seen[place - 1] > shade:  # sorted as they come: there are few
                        seen[place] = seen[place - 1]
                        place -= 1
                    seen[place] = shade
                    n_seen += 1
            if n_seen < 3:
                break
            middle[channel] = (seen[(n_seen - 1) // 2] + seen[n_seen // 2]) / 2
        if n_seen < 3:
            continue
        for view in range(n_views):
            distance = 0.0
            for channel in range(3):
                distance = max(distance, abs(shades[view, i, channel] - middle[channel]))
            weights[view, i] /= 1 + (distance / CONTRADICTED) ** 4
    return weights
