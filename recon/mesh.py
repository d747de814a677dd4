"""Clouds and meshes, what moves between cloud, surface and render, and their one reader and writer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Cloud:
    """Coloured, oriented points in the world frame.

    Parameters
    ----------
    points : float32 (N, 3), mm
    normals : float32 (N, 3), unit length, outwards (towards the sensor that saw the point)
    colours : uint8 (N, 3), sRGB
    """

    points: NDArray[np.float32]
    normals: NDArray[np.float32]
    colours: NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh in the world frame with a colour on every vertex.

    Parameters
    ----------
    vertices : float32 (N, 3), mm
    faces : int32 (M, 3), counter-clockwise seen from outside
    normals : float32 (N, 3), unit length, outwards
    colours : uint8 (N, 3), sRGB
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]
    normals: NDArray[np.float32]
    colours: NDArray[np.uint8]
