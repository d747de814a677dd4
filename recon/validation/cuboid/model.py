"""A cuboid that was found in a cloud: its frame, its visible faces, its edges, and what follows from them."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.validation.cuboid.planes import Plane

AXIS_NAMES = ("a", "b", "c")
BAND_SHARE = 1 / 12  # of the shortest edge, within which a point speaks for a plane
CLEAR = 3.0  # standard deviations that a point keeps from the neighbouring faces to count for its own


def band_of(size: tuple[float, float, float]) -> float:
    """How far from a face a point may lie and still be of it, mm."""
    return BAND_SHARE * min(size)


@dataclass(frozen=True, eq=False)
class Face:
    """A visible face, measured by itself.

    Parameters
    ----------
    axis : 0, 1 or 2, of the size that lies along its normal
    side : -1.0 or 1.0, on which end of that axis
    plane : its own, the normal outwards
    """

    axis: int
    side: float
    plane: Plane

    @property
    def name(self) -> str:
        """Such as "a+"."""
        return f"{AXIS_NAMES[self.axis]}{'+' if self.side > 0 else '-'}"


@dataclass(frozen=True, eq=False)
class Edge:
    """A measured length of the box along one axis.

    Parameters
    ----------
    axis : 0, 1 or 2
    length : mm
    ends : what either end was measured by, low then high: "face" or "outline"
    """

    axis: int
    length: float
    ends: tuple[str, str]


@dataclass(frozen=True, eq=False)
class CuboidFit:
    """A cuboid of known size.

    Parameters
    ----------
    size : mm, known edges
    axes : float64 (3, 3), rows the unit directions along the edges, a right-handed frame
    centre : float64 (3,), mm
    faces : those that are visible
    edges : measured lengths, of the axes both of whose ends were seen
    """

    size: tuple[float, float, float]
    axes: NDArray[np.float64]
    centre: NDArray[np.float64]
    faces: tuple[Face, ...]
    edges: tuple[Edge, ...] = ()

    def in_box(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Points (N, 3) along the box's axes from its centre, mm."""
        return np.asarray((np.asarray(points, dtype=np.float64) - self.centre) @ self.axes.T)

    def errors(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Signed distance (N,) of points (N, 3) to the surface of the box of known size, mm, positive outside."""
        beyond = np.abs(self.in_box(points)) - np.array(self.size) / 2
        return np.asarray(np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0))

    def on_face(self, face: Face, points: NDArray[np.floating], band: float) -> NDArray[np.bool_]:
        """Which of points (N, 3) lie within `band` of a face's plane, over its rectangle, clear of those beside it."""
        inside = np.abs(self.in_box(points)) < np.array(self.size) / 2 - CLEAR * face.plane.scale
        inside[:, face.axis] = np.abs(face.plane.errors(points)) < band
        return np.asarray(inside.all(axis=1))

    def dihedral_angles(self) -> list[tuple[Face, Face, float]]:
        """Every two faces that meet, and the angle inside the box between their own planes, degrees."""
        found = []
        for one, other in itertools.combinations(self.faces, 2):
            if one.axis != other.axis:
                cosine = float(np.clip(one.plane.normal @ other.plane.normal, -1, 1))
                found.append((one, other, 180.0 - float(np.degrees(np.arccos(cosine)))))
        return found
