"""Points to be compared, as the measures take them, and the merging of points at one place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import colour_rows, finite_rows
from recon.runtime.files import naming


@dataclass(frozen=True, eq=False)
class PointSet:
    """Points with what is known of them; `reading.read_point_set` reads them from a file.

    Parameters
    ----------
    name : in messages
    points : float32 (N, 3), in the unit of the file
    normals : float32 (N, 3), of any length; None where unknown
    colours : uint8 (N, 3), sRGB; None where unknown

    Raises
    ------
    ValueError
        If there is no point, the arrays differ in length, or a value is not finite; it names the row.
    """

    name: str
    points: NDArray[np.float32]
    normals: NDArray[np.float32] | None = None
    colours: NDArray[np.uint8] | None = None

    def __post_init__(self) -> None:
        if not len(self.points):
            raise ValueError(f"{self.name}: holds no points")
        with naming(self.name):
            object.__setattr__(self, "points", finite_rows(self.points, "points"))
            if self.normals is not None:
                object.__setattr__(self, "normals", finite_rows(self.normals, "normals", len(self.points)))
            if self.colours is not None:
                object.__setattr__(self, "colours", colour_rows(self.colours, len(self.points)))

    def __len__(self) -> int:
        return len(self.points)


def longest_side(cloud: PointSet) -> float:
    """Return the longest side of the bounding box, in the unit of length."""
    return float(np.ptp(cloud.points, axis=0).max())


@dataclass(frozen=True, eq=False)
class Places:
    """The places where points lie, each once, in the order of x, then y, then z.

    Parameters
    ----------
    points : float32 (M, 3)
    order : int64 (N,), rows of the point set by place; those of one place in the file's order
    starts : int64 (M,), where each place begins in `order`
    """

    points: NDArray[np.float32]
    order: NDArray[np.int64]
    starts: NDArray[np.int64]

    @property
    def counts(self) -> NDArray[np.int64]:
        """Number of points at each place, int64 (M,)."""
        return np.diff(self.starts, append=len(self.order))

    def first(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return of values (N, C) of a set's points those of the first in the file at each place, (M, C)."""
        return values[self.order[self.starts]]

    def mean(self, values: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Average values (N, C) of a set's points over each place, (M, C)."""
        sums = np.add.reduceat(values[self.order].astype(np.float64), self.starts, axis=0)
        return np.asarray(sums / self.counts[:, None])


def merged(points: NDArray[np.float32]) -> Places:
    """Find the places where points float32 (N, 3) lie."""
    order = np.lexsort(points.T[::-1])  # stable, so the file's order holds within a place
    ordered = points[order]
    is_new = np.ones(len(points), np.bool_)
    is_new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    starts = np.flatnonzero(is_new)
    return Places(np.ascontiguousarray(ordered[starts]), order, starts)
