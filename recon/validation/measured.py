"""Clouds to be measured, from this backend or from anything else: PLY, or text with x, y, z in the first columns."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.mesh import read_points
from recon.validation.sphere import UNITS_MM

TEXT_SUFFIXES = (".xyz", ".txt", ".asc", ".csv", ".pts")


def read_measured(path: Path, unit: str = "mm") -> NDArray[np.float32]:
    """The points (N, 3) of a cloud, mm.

    Raises
    ------
    ValueError
        If the file is missing or unreadable, holds no points, or the unit is unknown.
    """
    if unit not in UNITS_MM:
        raise ValueError(f"there is no unit {unit!r}; expected one of {', '.join(UNITS_MM)}")
    points = _read_text(path) if path.suffix.lower() in TEXT_SUFFIXES else read_points(path)
    return np.asarray(points * UNITS_MM[unit], dtype=np.float32)


def _read_text(path: Path) -> NDArray[np.float64]:
    if not path.is_file():
        raise ValueError(f"{path}: there is no such file")
    lines = path.read_text(encoding="utf-8", errors="replace").replace(",", " ").splitlines()
    rows = [line.split()[:3] for line in lines if line.strip() and not line.lstrip().startswith(("#", "//"))]
    try:
        points = np.array([[float(value) for value in row] for row in rows])
    except ValueError as error:
        raise ValueError(f"{path}: is not text with numbers x y z on each line: {error}") from error
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"{path}: expected numbers x y z on each line, found {points.shape[0]} lines that differ")
    return points
