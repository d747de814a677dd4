"""The refinement of a cuboid: each face on its points, the box on all of them, then the lengths of its edges.

Where no face is seen at an end of the box, the end is where the points of the other faces end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from recon.validation.clouds import FitError
from recon.validation.cuboid.edges import end_of_points
from recon.validation.cuboid.model import CuboidFit, Edge, Face, band_of
from recon.validation.cuboid.planes import refined_plane

END_WINDOW_SHARE = 0.15  # of an edge's length, searched on either side of where its end should be
JOINT_CUTOFF = 3.0  # Tukey's constant in standard deviations
LEAST_POINTS = 12  # of a face


def refined(points: NDArray[np.float64], fit: CuboidFit) -> CuboidFit:
    """Measure each face anew on its points, float64 (N, 3), mm, then the box on all of them together."""
    band = band_of(fit.size)
    faces, points_on = [], []
    for face in fit.faces:
        on_face = points[fit.on_face(face, points, band)]
        if len(on_face) < LEAST_POINTS:
            raise FitError(f"only {len(on_face)} points lie on its face {face.name}")
        faces.append(replace(face, plane=refined_plane(on_face, face.plane, band)))
        points_on.append(on_face)
    turn, places = _joint(fit, faces, points_on)
    turned = replace(fit, axes=turn @ fit.axes, faces=tuple(faces))
    middles = np.zeros(3)  # of the box, from the centre so far
    for axis in range(3):
        placed = [(face, place) for face, place in zip(faces, places, strict=True) if face.axis == axis]
        by_face = [place - face.side * fit.size[axis] / 2 for face, place in placed]
        middles[axis] = np.mean(by_face) if by_face else _middle_by_outline(points, turned, axis)
    return replace(turned, centre=turned.centre + middles @ turned.axes)


def measured_edges(points: NDArray[np.float64], fit: CuboidFit) -> tuple[Edge, ...]:
    """Measure with points (N, 3), mm, the lengths along the axes of which both ends are seen."""
    edges = []
    for axis in range(3):
        places, ends = [], []
        for side in (-1.0, 1.0):
            face = next((face for face in fit.faces if (face.axis, face.side) == (axis, side)), None)
            if face is None:
                places.append(_outline_end(points, fit, axis, side))
                ends.append("outline")
            else:
                on_face = fit.in_box(points[fit.on_face(face, points, band_of(fit.size))])
                middle = fit.centre + (on_face.mean(axis=0) @ fit.axes)
                places.append(float(on_face[:, axis].mean() - face.side * face.plane.errors(middle[None])[0]))
                ends.append("face")
        if not np.isnan(places).any():
            edges.append(Edge(axis, places[1] - places[0], (ends[0], ends[1])))
    return tuple(edges)


def _joint(
    fit: CuboidFit, faces: Sequence[Face], points_on: Sequence[NDArray[np.float64]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the box's rotation (3, 3), and the places (F,) of the faces along their axes, that suit all points.

    It is one Gauss-Newton step of Tukey-weighted least squares: a small turn w moves a point u of the box's frame by
    w x u.
    """
    system, right = np.zeros((3 + len(faces), 3 + len(faces))), np.zeros(3 + len(faces))
    places = np.zeros(len(faces))
    for index, (face, points) in enumerate(zip(faces, points_on, strict=True)):
        u = fit.in_box(points)
        place = float(np.median(u[:, face.axis]))
        errors = u[:, face.axis] - place
        weights = np.clip(1 - (face.plane.errors(points) / (JOINT_CUTOFF * face.plane.scale)) ** 2, 0, None) ** 2
        rows = np.zeros((len(points), len(right)))
        second, third = (face.axis + 1) % 3, (face.axis + 2) % 3
        rows[:, second], rows[:, third], rows[:, 3 + index] = u[:, third], -u[:, second], -1.0
        weighted = rows * weights[:, None]
        system += weighted.T @ rows
        right -= weighted.T @ errors
        places[index] = place
    solution = np.linalg.solve(system, right)
    turn = np.array([[1, -solution[2], solution[1]], [solution[2], 1, -solution[0]], [-solution[1], solution[0], 1]])
    u, _, vt = np.linalg.svd(turn)
    return np.asarray(u @ vt), places + solution[3:]


def _middle_by_outline(points: NDArray[np.float64], fit: CuboidFit, axis: int) -> float:
    ends = [_outline_end(points, fit, axis, side) for side in (-1.0, 1.0)]
    return 0.0 if np.isnan(ends).any() else float(np.mean(ends))


def _outline_end(points: NDArray[np.float64], fit: CuboidFit, axis: int, side: float) -> float:
    """Return where the faces' points end along an axis on one side of the centre, mm; NaN where that is not seen."""
    start, window = side * fit.size[axis] / 2, END_WINDOW_SHARE * fit.size[axis]
    u = fit.in_box(points)
    ends = []
    for face in fit.faces:
        if face.axis == axis:
            continue
        other = 3 - axis - face.axis
        on = (np.abs(face.plane.errors(points)) < band_of(fit.size)) & (np.abs(u[:, other]) < 0.45 * fit.size[other])
        ends.append(end_of_points(u[on, axis], start, side, window))
    seen = np.array([end for end in ends if not np.isnan(end[0])]).reshape(-1, 2)
    return float(np.average(seen[:, 0], weights=seen[:, 1] ** -2.0)) if len(seen) else float("nan")
