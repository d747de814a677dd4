"""What a model's file holds, part by part: one material each, before the parts become one mesh."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from recon.capture.images import is_cut
from recon.runtime.files import first_of
from recon.runtime.picture_size import check_announced

NEUTRAL = 170  # sRGB grey of what has no colour
FARTHEST = 1e12  # of a coordinate; beyond it is no scene, and areas would overflow


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles of one material, or points, as a file has them.

    Parameters
    ----------
    vertices : float64 (N, 3), in the file's unit and axes
    faces : integer (M, 3), counter-clockwise seen from outside; M is 0 for points
    normals : floating (N, 3), of any length; None where the file has none
    colours : uint8 (N, 3), sRGB; None where the file has none
    uv : floating (N, 2), as in `recon.geometry.mesh.Texture`; None where the file has none
    picture : uint8 (H, W, 3), sRGB, that `uv` points into; None for none

    Raises
    ------
    ValueError
        If a coordinate is not a finite number, a face names a vertex that does not exist, or arrays differ in length.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    normals: NDArray[np.floating] | None = None
    colours: NDArray[np.uint8] | None = None
    uv: NDArray[np.floating] | None = None
    picture: NDArray[np.uint8] | None = None

    def __post_init__(self) -> None:
        n_vertices = len(self.vertices)
        check_finite(self.vertices, "vertex")
        if self.uv is not None:
            check_finite(self.uv, "texture coordinate")
        for name, values in (("normals", self.normals), ("colours", self.colours), ("texture coordinates", self.uv)):
            if values is not None and len(values) != n_vertices:
                raise ValueError(f"it has {len(values)} {name} for {n_vertices} vertices")
        if self.faces.size and (self.faces.min() < 0 or self.faces.max() >= n_vertices):
            wrong = int(np.flatnonzero(((self.faces < 0) | (self.faces >= n_vertices)).any(axis=1))[0])
            raise ValueError(
                f"face {wrong} names vertices {self.faces[wrong].tolist()}, but there are {n_vertices} (0 to "
                f"{n_vertices - 1})"
            )


@dataclass
class Contents:
    """What a reader read.

    Parameters
    ----------
    parts : of the model
    files : all that were read, the model's own first
    warnings : what is not shown as the file has it, a clause each that follows the model's name
    """

    files: list[Path]
    parts: list[Part] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def warn(self, warning: str) -> None:
        """Add a warning, once."""
        if warning not in self.warnings:
            self.warnings.append(warning)

    def beside(self, name: str, what: str) -> bytes:
        """Read a file that the model's file names.

        Parameters
        ----------
        name : path from the model's folder
        what : kind of file, for the message

        Raises
        ------
        ValueError
            If it is missing, or lies outside the folder of the model's folder, whose other files are none of its own.
        """
        if "\0" in name:
            raise ValueError(f"its {what} {name!r:.80} is no name of a file")
        folder = self.files[0].parent
        near = name.replace("\\", "/")
        path = folder / near
        around = folder.resolve().parent
        is_near = path.resolve().is_relative_to(around)
        alike = first_of(folder, [*[near] * is_near, path.name])
        if alike is not None and alike != path:
            self.warn(f"names the {what} {name}, and {alike.name} is taken for it")
            path = alike
        if not path.resolve().is_relative_to(around):
            raise ValueError(f"its {what} {name} lies elsewhere; put it beside the model, or into a folder next to it")
        if not path.is_file():
            raise ValueError(f"its {what} {name} is missing, expected at {path}")
        if path not in self.files:
            self.files.append(path)
        return path.read_bytes()


def cloud_part(
    contents: Contents,
    points: NDArray[np.float64],
    normals: NDArray[np.floating] | None,
    colours: NDArray[np.uint8] | None,
) -> Part:
    """Make a part of points, without those that are no finite numbers, as scanners write for what they did not see.

    Parameters
    ----------
    contents : gets a warning that counts what is left out
    points : float64 (N, 3)
    normals : floating (N, 3); None where the file has none
    colours : uint8 (N, 3); likewise
    """
    is_finite = np.isfinite(points).all(axis=1)
    if is_finite.all():
        return Part(points, np.zeros((0, 3), np.int64), normals, colours)
    if not is_finite.any():
        raise ValueError(f"none of its {len(points)} points has finite coordinates")
    contents.warn(f"has {np.count_nonzero(~is_finite)} of {len(points)} points without finite coordinates, left out")
    return Part(
        points[is_finite],
        np.zeros((0, 3), np.int64),
        None if normals is None else normals[is_finite],
        None if colours is None else colours[is_finite],
    )


def split_corners(part: Part, polygons: NDArray[np.int64], colours: NDArray[np.uint8] | None = None) -> Part:
    """Give every corner of every triangle a vertex of its own, in the colour of its polygon.

    Parameters
    ----------
    part : without colours
    polygons : int64 (M,), of each triangle
    colours : uint8 (P, 3), of the polygons
    """
    picked = part.faces.ravel()
    normals = None if part.normals is None else part.normals[picked]
    shades = None if colours is None else np.repeat(colours[polygons], 3, axis=0)
    return Part(part.vertices[picked], np.arange(picked.size).reshape(-1, 3), normals, shades)


def decode_picture(content: bytes, name: str) -> NDArray[np.uint8]:
    """Decode a texture, uint8 (H, W, 3), sRGB: PNG, JPEG or another format of OpenCV's; alpha is left out.

    Parameters
    ----------
    content : bytes of the file
    name : for the message

    Raises
    ------
    ValueError
        If it is cut off, too large, or no picture.
    """
    if is_cut(content):
        raise ValueError(f"its texture {name} is cut off after {len(content)} bytes")
    check_announced(content, f"its texture {name} ")
    pixels = None
    try:
        if content:
            flags = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
            pixels = cv2.imdecode(np.frombuffer(content, np.uint8), flags)
    except cv2.error as error:  # more pixels than OpenCV takes
        raise ValueError(f"its texture {name} is not readable as a picture: {error.err}") from error
    if pixels is None:
        raise ValueError(f"its texture {name} is not readable as a picture (PNG or JPEG expected)")
    return np.asarray(pixels, dtype=np.uint8)


def colours_from(values: ArrayLike) -> NDArray[np.uint8]:
    """Return sRGB bytes, uint8 (N, 3), of colours as bytes, 16-bit numbers, or floats from 0 to 1 (or to 255).

    A ValueError says that a colour is not a finite number.
    """
    colours = np.asarray(values)
    if colours.dtype == np.uint8:
        return colours
    if np.issubdtype(colours.dtype, np.integer):
        largest = 65535.0 if colours.size and colours.max() > 255 else 255.0
        return np.asarray(np.rint(np.clip(colours / largest, 0, 1) * 255), dtype=np.uint8)
    check_finite(colours, "colour")
    scale = 1.0 if colours.size and colours.max() > 1.5 else 255.0  # rounding may reach past 1
    return np.asarray(np.rint(np.clip(colours * scale, 0, 255)), dtype=np.uint8)


def check_finite(values: NDArray[np.floating], name: str) -> None:
    """Raise a ValueError that names the first of the rows (N, C) with a number that is not finite, or too large."""
    with np.errstate(invalid="ignore"):
        finite = (np.abs(values) < FARTHEST).all(axis=1)  # false for NaN
    if not finite.all():
        row = int(np.argmin(finite))
        raise ValueError(f"{name} {row} is {values[row].tolist()}, expected finite numbers")
