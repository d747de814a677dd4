"""Clouds to be measured, from this backend or from anything else: models, or text with x, y, z in front."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import Shape, check_resolved, measured_part
from recon.geometry.mesh_files import read_mesh
from recon.geometry.rig import UNITS_MM
from recon.models.read import GLTF_SUFFIXES
from recon.models.shape import read_model_shape
from recon.runtime.files import why_no_file
from recon.validation.measures import COMBINED

MIN_POINTS = 50
TEXT_SUFFIXES = (".xyz", ".txt", ".asc", ".csv", ".pts")
DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+(e[-+]?\d+)?", re.IGNORECASE)
MAX_DISTANCE = 1e5  # times the length that is fitted; float32 then still resolves a hundredth of that length
ODD_SCALE, OTHER_UNIT = 8.0, 75.0  # ratios of size: to be remarked; to be refused, with room for noise below 100
NEAR_UNIT = 0.25  # relative difference from the ratio of two units
TELLING = 50  # points; fewer say nothing about scale
UNITS_APART = {1000: "metres against millimetres", 100: "metres against centimetres"}


class FitError(ValueError):
    """The shape is not in the cloud, or is there more than once."""


@dataclass(frozen=True)
class CloudFile:
    """A file with one sensor's reconstruction of one placed object.

    Parameters
    ----------
    path : of the file
    sample : which of the placed objects it shows, counted from 1
    sensor : name of the sensor that saw it
    """

    path: Path
    sample: int
    sensor: str

    @property
    def name(self) -> str:
        """The name in reports and options, for example "3/S1"."""
        return f"{self.sample}/{self.sensor}"


def named_clouds(paths: Sequence[Path], sensors: Sequence[str]) -> tuple[CloudFile, ...]:
    """Assign each file to a sample and a sensor.

    The sensors' names belong to the files in order and repeat if they are fewer; the n-th file of each sensor
    shows sample n. Without names every file is a sample by itself.

    A ValueError says that the number of files is not a multiple of the number of names, or that a name is taken.
    """
    if not paths:
        raise ValueError("there is no cloud to measure")
    if COMBINED in sensors:
        raise ValueError(f"a sensor is called {COMBINED!r}, which is what reports call all sensors together; rename it")
    if sensors and len(paths) % len(sensors):
        raise ValueError(f"{len(paths)} clouds cannot be shared among {len(sensors)} sensors: {', '.join(sensors)}")
    names = [sensors[index % len(sensors)] if sensors else "S1" for index in range(len(paths))]
    seen: Counter[str] = Counter()
    files = []
    for path, name in zip(paths, names, strict=True):
        seen[name] += 1
        files.append(CloudFile(path, seen[name], name))
    return tuple(files)


def read_measured(path: Path, unit: str = "mm") -> NDArray[np.float32]:
    """Read the points (N, 3) of a cloud, or the vertices of a mesh, mm; glTF is in metres whatever the unit.

    A ValueError says that the file is missing or unreadable, holds no points, or that the unit is unknown.
    """
    suffix, scale = path.suffix.lower(), unit_mm(path, unit)
    if suffix in TEXT_SUFFIXES:
        return np.asarray(_read_text(path) * scale, dtype=np.float32)
    return np.asarray(read_model_shape(path).points * scale, dtype=np.float32)


def read_shape(path: Path) -> Shape:
    """Read points, float32, with triangles, normals and colours where the file has them; glTF in mm.

    A ValueError says that the file is missing or unreadable, holds no points or such that are too far from the origin
    for float32, or has faces that are no triangles.
    """
    suffix = path.suffix.lower()
    if suffix in TEXT_SUFFIXES:
        shape = Shape(_read_text(path).astype(np.float32), np.zeros((0, 3), np.int32))
    else:
        shape = read_model_shape(path)
    check_resolved(shape.points, f"{path}: ")
    return shape


def read_measured_shape(path: Path) -> Shape:
    """Read a mesh of a run as `read_shape` does, but for the faces where holes were filled and nothing was measured."""
    mesh = measured_part(read_mesh(path))
    return Shape(mesh.vertices, mesh.faces, mesh.normals, mesh.colours)


def unit_mm(path: Path, unit: str) -> float:
    """Return what brings a file's points to mm, once read: 1 for glTF, whatever the unit; a ValueError if unknown."""
    if unit not in UNITS_MM:
        raise ValueError(f"there is no unit {unit!r}; expected one of {', '.join(UNITS_MM)}")
    return 1.0 if path.suffix.lower() in GLTF_SUFFIXES else UNITS_MM[unit]


def checked_points(points: NDArray[np.floating], length: float, name: str) -> NDArray[np.float32]:
    """Return points as float32 (N, 3), mm, if a shape of this length can be fitted to them at all.

    Parameters
    ----------
    points : floating (N, 3), mm
    length : mm, of the shape, such as a sphere's radius
    name : of that length in messages

    Raises
    ------
    ValueError
        If the length is not positive, there are too few points, or a coordinate is not finite or too large.
    """
    if not (np.isfinite(length) and length > 0):
        raise ValueError(f"the {name} is {length:g} mm, expected a positive number")
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"points have shape {points.shape}, expected (N, 3)")
    if len(points) < MIN_POINTS:
        raise ValueError(f"the cloud has {len(points)} points, expected at least {MIN_POINTS}")
    is_finite = np.isfinite(points)
    if not is_finite.all():
        row = int(np.argmin(is_finite.all(axis=1)))
        raise ValueError(f"point {row} is {points[row].tolist()}: not a finite number; remove such points first")
    largest = max(-float(points.min()), float(points.max()))
    if largest > MAX_DISTANCE * length:
        raise ValueError(
            f"a coordinate is {largest:.3g} mm where the {name} is {length:g} mm: too far away to be measured in "
            "single precision; move the cloud to its origin, or look for a wrong unit"
        )
    return np.ascontiguousarray(points, dtype=np.float32)


def hint_at_unit(points: NDArray[np.float32], fit: Callable[[NDArray[np.float32]], object]) -> str:
    """Return the end of an error's sentence: the unit in which a fit would find its shape; "" if there is none.

    Parameters
    ----------
    points : float32 (N, 3), taken to be in mm
    fit : fits to points in mm, or raises a FitError
    """
    for unit, length in UNITS_MM.items():
        if length == 1.0:
            continue
        try:
            fit(points * np.float32(length))
        except FitError:
            continue
        return f"; it would fit if the cloud were in {unit}: say so with --unit {unit}"
    return ""


def size_remarks(names: tuple[str, str], measured: NDArray[np.floating], reference: NDArray[np.floating]) -> list[str]:
    """Return sentences on another size or place, or raise a ValueError if the units must differ.

    Parameters
    ----------
    names : of what is measured and of its reference, in the sentences
    measured, reference : floating (N, 3) and (M, 3)
    """
    name, reference_name = names
    size, real_size = (float(np.linalg.norm(np.ptp(points, axis=0))) for points in (measured, reference))
    if min(len(measured), len(reference)) < TELLING or not min(size, real_size) > 0:
        return []
    ratio = max(size, real_size) / min(size, real_size)
    if ratio >= ODD_SCALE:
        unit = next((unit for unit in UNITS_APART if abs(ratio / unit - 1) < NEAR_UNIT), None)
        doubt = "." if unit is None else f": {UNITS_APART[unit]}?"
        relation = "larger" if size > real_size else "smaller"
        sentence = (
            f"{name}: is about {_round_figure(unit or ratio)} times {relation} than its reference "
            f"{reference_name} (diagonals {size:.3g} and {real_size:.3g}){doubt}"
        )
        if ratio >= OTHER_UNIT:
            raise ValueError(f"{sentence} Bring both to one unit first")
        return [sentence]
    low, high = measured.min(axis=0), measured.max(axis=0)
    if (low > reference.max(axis=0)).any() or (high < reference.min(axis=0)).any():
        return [f"{name}: lies wholly beside its reference {reference_name}; are both in the same coordinates?"]
    return []


def _read_text(path: Path) -> NDArray[np.float64]:
    if not path.is_file():
        raise ValueError(f"{path}: {why_no_file(path)}")
    lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    told = [(number, line) for number, line in enumerate(lines, 1) if line.strip() and not _is_note(line)]
    if path.suffix.lower() == ".pts" and told and told[0][1].strip().isdecimal():
        n_points, told = int(told[0][1]), told[1:]
        if n_points != len(told):
            raise ValueError(f"{path}: its first line promises {n_points} points, {len(told)} follow; is it cut off?")
    points = np.array([_numbers(path, number, line) for number, line in told])
    if not len(points):
        raise ValueError(f"{path}: holds no points")
    return points


def _is_note(line: str) -> bool:
    return line.lstrip().startswith(("#", "//"))


def _numbers(path: Path, number: int, line: str) -> list[float]:
    """Read x, y and z of a line; a ValueError names the line that does not begin with them."""
    words = line.split() if "," in line else []
    if len(words) >= 3 and any(map(DECIMAL_COMMA.fullmatch, words[:3])):
        raise ValueError(f"{path}: line {number} is {line!r:.60}, with decimal commas; write decimal points instead")
    try:
        x, y, z = (float(word) for word in line.replace(",", " ").split()[:3])
    except ValueError:
        x = y = z = math.nan
    if not all(map(math.isfinite, (x, y, z))):
        raise ValueError(
            f"{path}: line {number} is {line!r:.60}, expected finite numbers x y z, parted by spaces or commas; "
            "remove such lines, or put # before those that are notes"
        )
    return [x, y, z]


def _round_figure(ratio: float) -> str:
    """Write a ratio with two digits, and spaces between thousands."""
    digits = 1 - int(np.floor(np.log10(ratio)))
    return f"{round(ratio, digits):,.0f}".replace(",", " ")
