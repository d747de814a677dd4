"""A fitted cuboid: its frame, visible faces and measured edges."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.validation.cuboid.planes import Plane

AXIS_NAMES = ("a", "b", "c")
BAND_SHARE = 1 / 12  # of the shortest edge, within which a point counts for a plane
CLEAR = 3.0  # standard deviations; points nearer to a neighbouring face count for neither


def band_of(size: tuple[float, float, float]) -> float:
    """Return how far from a face a point may lie and still count for it, mm."""
    return BAND_SHARE * min(size)


@dataclass(frozen=True, eq=False)
class Face:
    """A visible face, measured by itself.

    Parameters
    ----------
    axis : 0, 1 or 2, the box's axis along its normal
    side : -1.0 or 1.0, the end of that axis
    plane : fitted to its points alone, the normal outwards
    """

    axis: int
    side: float
    plane: Plane

    @property
    def name(self) -> str:
        """The name in the report, for example "a+"."""
        return f"{AXIS_NAMES[self.axis]}{'+' if self.side > 0 else '-'}"


@dataclass(frozen=True, eq=False)
class Edge:
    """A measured length of the box along one axis.

    Parameters
    ----------
    axis : 0, 1 or 2
    length : mm
    ends : how the low and the high end were measured: "face" or "outline"
    """

    axis: int
    length: float
    ends: tuple[str, str]


@dataclass(frozen=True, eq=False)
class CuboidFit:
    """A cuboid of known size.

    Parameters
    ----------
    size : mm, the known edges
    axes : float64 (3, 3), rows the unit directions along the edges, a right-handed frame
    centre : float64 (3,), mm
    faces : those that are visible
    edges : measured along each axis of which both ends are seen
    """

    size: tuple[float, float, float]
    axes: NDArray[np.float64]
    centre: NDArray[np.float64]
    faces: tuple[Face, ...]
    edges: tuple[Edge, ...] = ()

    def in_box(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return points (N, 3) in the box's frame, along its axes from its centre, mm."""
        return np.asarray((np.asarray(points, dtype=np.float64) - self.centre) @ self.axes.T)

    def errors(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the signed distances (N,) of points (N, 3) to the surface of the box, mm, positive outside."""
        beyond = np.abs(self.in_box(points)) - np.array(self.size) / 2
        return np.asarray(np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0))

    def on_face(self, face: Face, points: NDArray[np.floating], band: float) -> NDArray[np.bool_]:
        """Return which points lie on a face, bool (N,): near its plane, over its rectangle, clear of other faces.

        Parameters
        ----------
        face : of this box
        points : floating (N, 3), mm
        band : mm, how far from the plane they may lie
        """
        inside = np.abs(self.in_box(points)) < np.array(self.size) / 2 - CLEAR * face.plane.scale
        inside[:, face.axis] = np.abs(face.plane.errors(points)) < band
        return np.asarray(inside.all(axis=1))

    def dihedral_angles(self) -> list[tuple[Face, Face, float]]:
        """Return every two faces that meet, and the angle inside the box between their planes, degrees."""
        angles = []
        for face, other in itertools.combinations(self.faces, 2):
            if face.axis != other.axis:
                cosine = float(np.clip(face.plane.normal @ other.plane.normal, -1, 1))
                angles.append((face, other, 180.0 - float(np.degrees(np.arccos(cosine)))))
        return angles
