"""Several textures as one: their pictures side by side, so that a model of many materials has one texture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import Texture
from recon.models.part import Part

MARGIN = 8  # texels around each picture that repeat its edge, so that neighbours do not shine through at a distance
PATCH = 4  # texels to a side of the patch that stands for a part of one colour
LARGEST = 16384  # texels to a side
SLACK = 1e-3  # a place so far outside of the picture is a rounding error


def one_texture(parts: Sequence[Part]) -> Texture | None:
    """Return one texture for all vertices of the parts in turn; None if no part has a picture.

    Parameters
    ----------
    parts : each with a picture and places in it, or of one colour throughout

    Raises
    ------
    ValueError
        If vertex colours stand beside textures, or the pictures together are too large.
    """
    if all(part.picture is None for part in parts):
        return None
    first = parts[0]
    if all(part.picture is first.picture for part in parts) and first.picture is not None:
        return Texture(first.picture, np.concatenate([part.uv for part in parts if part.uv is not None]))
    tiles = [_tile(part) for part in parts]
    pictures = list({id(part.picture): part.picture for part in tiles}.values())
    corners, (height, width) = packed([_size(picture) for picture in pictures])
    if max(height, width) > LARGEST:
        raise ValueError(
            f"its textures together need {width}x{height} texels, at most {LARGEST}x{LARGEST} are possible; make them "
            "smaller or bake one"
        )
    pixels = np.zeros((height, width, 3), np.uint8)
    place = {}
    for picture, (row, column) in zip(pictures, corners, strict=True):
        assert picture is not None
        padded = np.pad(picture, ((MARGIN, MARGIN), (MARGIN, MARGIN), (0, 0)), mode="edge")
        pixels[row : row + padded.shape[0], column : column + padded.shape[1]] = padded
        place[id(picture)] = (row + MARGIN, column + MARGIN)
    uv = []
    for tile in tiles:
        assert tile.picture is not None
        assert tile.uv is not None
        row, column = place[id(tile.picture)]
        rows, columns = tile.picture.shape[:2]
        x = (column + tile.uv[:, 0] * columns) / width
        y = 1 - (row + (1 - tile.uv[:, 1]) * rows) / height
        uv.append(np.stack([x, y], axis=1))
    return Texture(pixels, np.concatenate(uv))


def _tile(part: Part) -> Part:
    """Return the part with a picture that its places do not leave: repeated as often as they go around."""
    if part.picture is None or part.uv is None:
        if part.colours is not None and len(part.colours) and (part.colours != part.colours[0]).any():
            raise ValueError("it has parts with textures and parts with vertex colours; bake both into textures")
        colour = np.zeros(3, np.uint8) if part.colours is None or not len(part.colours) else part.colours[0]
        middle = np.full((len(part.vertices), 2), 0.5)
        return replace(part, uv=middle, picture=np.tile(colour, (PATCH, PATCH, 1)))
    if not len(part.uv):
        return part
    low = np.floor(part.uv.min(axis=0) + SLACK)
    uv = part.uv - low
    across, up = (max(int(n), 1) for n in np.ceil(uv.max(axis=0) - SLACK))
    rows, columns = part.picture.shape[:2]
    if max(across * columns, up * rows) > LARGEST:
        raise ValueError(
            f"a texture of {columns}x{rows} texels is repeated {across} by {up} times beside other textures; bake it"
        )
    picture = part.picture if across == up == 1 else np.tile(part.picture, (up, across, 1))
    return replace(part, uv=np.clip(uv / (across, up), 0, 1), picture=picture)


def _size(picture: NDArray[np.uint8] | None) -> tuple[int, int]:
    assert picture is not None
    return picture.shape[0] + 2 * MARGIN, picture.shape[1] + 2 * MARGIN


def packed(sizes: Sequence[tuple[int, int]]) -> tuple[list[tuple[int, int]], tuple[int, int]]:
    """Lay boxes on shelves, the highest first; returns their corners (row, column) and the height and width of all.

    Parameters
    ----------
    sizes : (height, width) of each box
    """
    width = max(max(columns for _, columns in sizes), int(np.ceil(np.sqrt(sum(h * w for h, w in sizes)))))
    corners: list[tuple[int, int]] = [(0, 0)] * len(sizes)
    row = column = shelf = 0
    for index in sorted(range(len(sizes)), key=lambda index: sizes[index], reverse=True):
        height, across = sizes[index]
        if column + across > width:
            row, column, shelf = row + shelf, 0, 0
        corners[index] = (row, column)
        column, shelf = column + across, max(shelf, height)
    return corners, (row + shelf, width)
