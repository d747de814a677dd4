"""Textures made ready for the renderers: small enough for them, and averaged for when they are seen from afar.

A texture seen smaller than it is holds several texels a pixel: picking some of them would flicker as the camera moves.
So it is averaged beforehand to half its size, a quarter and so on, as OpenGL does (mipmaps), and the renderer picks the
size that has about one texel a pixel. Encoded values are averaged, as the renderers average their samples.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import Texture

LARGEST_SIDE = 8192  # texels; four full HD pictures wide, 0.3 GB with its levels; OpenGL drivers hold as much


class Mipmaps(NamedTuple):
    """A texture in sizes, each half of the one before, down to one texel.

    Parameters
    ----------
    texels : uint8 (T, 3), sRGB, of all levels, row by row from the top
    levels : int64 (L, 3), the first texel, the height and the width of each level, the largest first
    uv : float32 (N, 2), as in `Texture`
    """

    texels: NDArray[np.uint8]
    levels: NDArray[np.int64]
    uv: NDArray[np.float32]


NO_MIPMAPS = Mipmaps(np.empty((0, 3), np.uint8), np.empty((0, 3), np.int64), np.empty((0, 2), np.float32))


def drawable(texture: Texture) -> Texture:
    """Halve a texture until no side is longer than `LARGEST_SIDE`."""
    pixels = texture.pixels
    while max(pixels.shape) > LARGEST_SIDE:
        pixels = _halved(pixels)
    return texture if pixels is texture.pixels else replace(texture, pixels=pixels)


def mipmaps(texture: Texture) -> Mipmaps:
    """Average a texture to all its levels."""
    images = [texture.pixels]
    while max(images[-1].shape[:2]) > 1:
        images.append(_halved(images[-1]))
    counts = [image.shape[0] * image.shape[1] for image in images]
    starts = np.cumsum([0, *counts[:-1]])
    levels = [(start, *image.shape[:2]) for start, image in zip(starts, images, strict=True)]
    return Mipmaps(
        np.concatenate([image.reshape(-1, 3) for image in images]), np.array(levels, dtype=np.int64), texture.uv
    )


def _halved(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Average an image (H, W, 3) to half its height and width, rounded down, but at least 1."""
    height, width = image.shape[:2]
    size = (max(width // 2, 1), max(height // 2, 1))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
