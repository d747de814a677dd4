"""The search for a cuboid of known size in a cloud.

Planes are found one after the other. Those at right angles are the faces, each measured by itself; the box is then
refined on all of them together.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from recon.validation.clouds import FitError, checked_points, hint_at_unit
from recon.validation.cuboid.model import CuboidFit, Face, band_of
from recon.validation.cuboid.planes import Plane, plane_sequence
from recon.validation.cuboid.refinement import measured_edges, refined
from recon.validation.sampling import subsample, thinned

Size = tuple[float, float, float]

MOST_POINTS = 200_000  # on which faces and ends are measured
SEARCH_POINTS = 30_000
CELL_SHARE = 1 / 25  # of the shortest edge: one point a cell in the search for planes
REACH_SHARE = 1 / 2  # of the shortest edge, between the points of a trial
MOST_PLANES = 8
LEAST_SHARE = 0.04  # of the points, on a plane
RIGHT_ANGLE_TOLERANCE = float(np.sin(np.deg2rad(12.0)))  # between planes that may be faces of the same box
MAX_LENGTH_ERROR = 0.1  # share of an edge; with more it is another box
MIN_FILLED = 0.35  # share of a face's rectangle that has points
MIN_ON_BOX = 0.3  # share of the points around the box that lie on it
AROUND = 1.5  # times half the size; points within lie around the box
FILL_CELLS = 12  # along each side of a face
ROUNDS = 4


def fit_cuboid(points: NDArray[np.floating], size: Size, seed: int = 1) -> CuboidFit:
    """Find the one cuboid of a known size in a cloud.

    Parameters
    ----------
    points : floating (N, 3), mm
    size : mm; the result's axes are in the same order
    seed : of samples and trials

    Raises
    ------
    ValueError
        If a length is not positive, there are too few points, or a coordinate is not a number.
    FitError
        If no such cuboid is there. The message says what was found instead.
    """
    check_size(size)
    checked = checked_points(points, min(size), "shortest edge")
    try:
        return _fit(checked, size, seed)
    except FitError as error:
        if np.ptp(checked, axis=0).max() > min(size):  # large enough already
            raise
        raise FitError(f"{error}{hint_at_unit(checked, lambda scaled: _fit(scaled, size, seed))}") from error


def check_size(size: Size) -> None:
    """Raise a ValueError if a size is not three positive lengths."""
    if np.shape(size) != (3,) or not all(np.isfinite(length) and length > 0 for length in size):
        raise ValueError(f"the size is {size}, expected three positive lengths in mm")


def _fit(points: NDArray[np.float32], size: Size, seed: int) -> CuboidFit:
    sample = subsample(points, seed, MOST_POINTS).astype(np.float64)
    even = thinned(subsample(points, seed, SEARCH_POINTS), CELL_SHARE * min(size)).astype(np.float64)
    planes = plane_sequence(
        even,
        band=band_of(size),
        reach=REACH_SHARE * min(size),
        least=max(12, int(LEAST_SHARE * len(even))),
        most=MOST_PLANES,
        rng=np.random.default_rng(seed),
    )
    reasons = [] if planes else ["there is no plane in it"]
    for first in range(len(planes)):
        try:
            return _from_planes(sample, even, _at_right_angles(planes[first:]), size)
        except FitError as error:
            reasons.append(str(error))
    wanted = " x ".join(f"{length:g}" for length in size)
    extent = " x ".join(f"{length:.3g}" for length in np.ptp(sample, axis=0))
    raise FitError(f"no cuboid of {wanted} mm in a cloud of {extent} mm; the best candidate: {reasons[0]}")


def _at_right_angles(planes: Sequence[Plane]) -> list[Plane]:
    """Return the first plane, and those that are parallel or at right angles to all before them."""
    chosen = list(planes[:1])
    for plane in planes[1:]:
        cosines = np.array([abs(float(plane.normal @ other.normal)) for other in chosen])
        across = cosines < RIGHT_ANGLE_TOLERANCE
        along = cosines > np.sqrt(1 - RIGHT_ANGLE_TOLERANCE**2)
        if (across | along).all() and np.count_nonzero(along) < 2:
            chosen.append(plane)
    return chosen


def _from_planes(
    points: NDArray[np.float64], even: NDArray[np.float64], planes: Sequence[Plane], size: Size
) -> CuboidFit:
    fit = _first_box(even, planes, size)
    for _ in range(ROUNDS):
        fit = refined(points, fit)
    fit = replace(fit, edges=measured_edges(points, fit))
    _check(points, fit)
    return fit


def _first_box(even: NDArray[np.float64], planes: Sequence[Plane], size: Size) -> CuboidFit:
    """Make a box from planes at right angles: decide which edge lies along which axis, and where the faces are."""
    axes = _frame(planes)
    lying = [np.abs(plane.errors(even)) < band_of(size) for plane in planes]
    axis_of = [int(np.argmax(np.abs(axes @ plane.normal))) for plane in planes]
    extents = np.array([_extent(even @ axes[k], lying, axis_of, k) for k in range(3)])  # (3, 2)
    lengths = extents[:, 1] - extents[:, 0]
    order = list(
        min(
            itertools.permutations(range(3)),
            key=lambda chosen: float(np.abs(np.log(lengths[list(chosen)] / size)).sum()),
        )
    )
    signs = _signs(axes[order])
    axes, extents = axes[order] * signs[:, None], np.sort(extents[order] * signs[:, None], axis=1)
    faces = []
    for plane, axis_before in zip(planes, axis_of, strict=True):
        axis = order.index(axis_before)
        normal = plane.normal * np.sign(plane.normal @ axes[axis])
        offset = plane.offset * float(np.sign(plane.normal @ axes[axis]))
        side = 1.0 if offset > extents[axis].mean() else -1.0
        faces.append(Face(axis, side, Plane(side * normal, side * offset, plane.scale)))
    return CuboidFit(size, axes, _centre(axes, extents, faces, size), tuple(faces))


def _frame(planes: Sequence[Plane]) -> NDArray[np.float64]:
    """Return orthonormal rows near the planes' normals."""
    first = planes[0].normal
    across = [plane.normal for plane in planes if abs(plane.normal @ first) < 0.5]
    if not across:
        raise FitError("only parallel planes were seen: turn the cuboid so that two or three faces show")
    second = across[0] - (across[0] @ first) * first
    second /= np.linalg.norm(second)
    return np.stack([first, second, np.cross(first, second)])


def _signs(axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return signs (3,) that make the rows a right-handed frame, the first two along the world's axes."""
    signs = np.array([np.sign(axis[np.argmax(np.abs(axis))]) for axis in axes])
    signs[2] = np.sign(np.linalg.det(axes) * signs[0] * signs[1])
    return signs


def _extent(
    along: NDArray[np.float64], lying: Sequence[NDArray[np.bool_]], axis_of: Sequence[int], axis: int
) -> tuple[float, float]:
    """Return the lowest and highest place along an axis of the points on other axes' planes, without the outermost."""
    others = [along[on] for on, other in zip(lying, axis_of, strict=True) if other != axis and on.any()]
    low, high = np.percentile(np.concatenate(others), (1.5, 98.5))
    if not high > low:
        raise FitError("the points of its planes have no extent")
    return float(low), float(high)


def _centre(
    axes: NDArray[np.float64], ends: NDArray[np.float64], faces: Sequence[Face], size: Size
) -> NDArray[np.float64]:
    """Return the middle of the box of known size: from its faces, or its ends (3, 2) along an axis without a face."""
    middles = ends.mean(axis=1)
    for axis in range(3):
        by_face = [face.side * face.plane.offset - face.side * size[axis] / 2 for face in faces if face.axis == axis]
        if by_face:
            middles[axis] = float(np.mean(by_face))
    return np.asarray(middles @ axes)


def _check(points: NDArray[np.float64], fit: CuboidFit) -> None:
    at = f"at {np.round(fit.centre, 1).tolist()} mm"
    for edge in fit.edges:
        known = fit.size[edge.axis]
        if abs(edge.length / known - 1) > MAX_LENGTH_ERROR:
            raise FitError(f"{at} an edge is {edge.length:.4g} mm long, not {known:g} mm")
    if not fit.edges:
        raise FitError(f"{at} none of its edges is seen from end to end")
    around = (np.abs(fit.in_box(points)) < AROUND * np.array(fit.size) / 2).all(axis=1)
    share = float(np.mean(np.abs(fit.errors(points[around])) < band_of(fit.size))) if around.any() else 0.0
    if share < MIN_ON_BOX:
        raise FitError(f"{at} only {share:.0%} of the points around it lie on it, not {MIN_ON_BOX:.0%}")
    for face in fit.faces:
        filled = _filled(points, fit, face)
        if filled < MIN_FILLED:
            raise FitError(f"{at} only {filled:.0%} of its face {face.name} has points, expected {MIN_FILLED:.0%}")


def _filled(points: NDArray[np.float64], fit: CuboidFit, face: Face) -> float:
    """Return the share of a face's rectangle that has points."""
    across = [axis for axis in range(3) if axis != face.axis]
    places = fit.in_box(points[fit.on_face(face, points, band_of(fit.size))])[:, across]
    halves = [fit.size[axis] / 2 for axis in across]
    cells = np.floor((places / halves + 1) / 2 * FILL_CELLS).astype(np.int64).clip(0, FILL_CELLS - 1)
    return len(np.unique(cells, axis=0)) / FILL_CELLS**2
