"""Splats as SOG: a ZIP file of WebP pictures whose pixels are numbers, and a `meta.json` that says which.

Source: https://developer.playcanvas.com/user-manual/gaussian-splatting/formats/sog
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ground.files import DAMAGED_ZIP
from recon.capture.images import is_cut
from recon.models.splats.raw import N_RESTS, RawSplats, check_count, scales_of, sigmoid, smallest_three
from recon.runtime.picture_size import check_announced

META = "meta.json"
LARGEST_PICTURE = 256 * 2**20  # bytes of a compressed picture
PALETTE_COLUMNS = 64  # entries of the palette of harmonics in a row of its picture
LARGEST_IS_W = 252  # alpha of a quaternion whose w is the largest; x, y and z follow


class _Bundle:
    """The pictures of a file, by what their `meta.json` says."""

    def __init__(self, bundle: zipfile.ZipFile) -> None:
        self._zip = bundle
        self.meta = json.loads(self._read(META))
        if not isinstance(self.meta, dict):
            raise ValueError(f"its {META} is {self.meta!r:.80}, expected an object")
        self.n_splats = int(self.meta["count"] if "version" in self.meta else self.meta["means"]["shape"][0])
        check_count(self.n_splats)

    def pixels(self, key: str, number: int = 0) -> NDArray[np.uint8]:
        """Return the pixels of a property's picture, one a splat: uint8 (N, 4), red, green, blue, alpha."""
        pixels = self.picture(key, number).reshape(-1, 4)
        if len(pixels) < self.n_splats:
            raise ValueError(f"its picture of {key} has {len(pixels)} pixels, expected {self.n_splats}")
        return pixels[: self.n_splats]

    def picture(self, key: str, number: int = 0) -> NDArray[np.uint8]:
        """Return a picture of a property, uint8 (H, W, 4)."""
        name = str(self.meta[key]["files"][number])
        content = self._read(name)
        check_announced(content, f"its picture {name} ")
        pixels = None if is_cut(content) else cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
        if pixels is None or pixels.ndim != 3 or pixels.dtype != np.uint8:
            raise ValueError(f"its picture {name} is not readable as WebP")
        if pixels.shape[2] == 3:
            pixels = np.dstack([pixels, np.full(pixels.shape[:2], 255, np.uint8)])
        return np.asarray(pixels[..., [2, 1, 0, 3]])

    def _read(self, name: str) -> bytes:
        if self._zip.getinfo(name).file_size > LARGEST_PICTURE:
            raise ValueError(f"its {name} has {self._zip.getinfo(name).file_size} bytes, too many for a picture")
        return self._zip.read(name)


def read_sog(path: Path) -> RawSplats:
    """Read a SOG file of version 1 or 2.

    Raises
    ------
    ValueError
        If it is damaged, or of another version.
    """
    try:
        with zipfile.ZipFile(path) as bundle:
            return _splats(_Bundle(bundle))
    except DAMAGED_ZIP as error:
        raise ValueError(f"it is not readable as a ZIP file: {error}") from error
    except (KeyError, TypeError, IndexError, OverflowError) as error:
        raise ValueError(f"its {META} or a picture that it names is incomplete: {error}") from error
    except cv2.error as error:
        raise ValueError(f"a picture of it is not readable: {error.err}") from error


def _splats(bundle: _Bundle) -> RawSplats:
    version = bundle.meta.get("version", 1)
    if version not in (1, 2):
        raise ValueError(f"it is of version {version}, expected 1 or 2")
    means = bundle.meta["means"]
    fine, coarse = bundle.pixels("means").astype(np.uint16), bundle.pixels("means", 1).astype(np.uint16)
    shares = (fine[:, :3] | coarse[:, :3] << 8) / np.float32(65535)
    logarithms = _between(means, shares)
    quats = bundle.pixels("quats")
    values = (quats[:, :3] / np.float32(255) * 2 - 1) / np.float32(np.sqrt(2))
    largest = quats[:, 3].astype(np.int64) - LARGEST_IS_W
    if (largest < 0).any():
        raise ValueError(f"its quaternions have an alpha of {quats[:, 3].min()}, expected {LARGEST_IS_W} to 255")
    colours = bundle.pixels("sh0")
    if version == 1:
        scales = _between(bundle.meta["scales"], bundle.pixels("scales")[:, :3] / np.float32(255))
        of_colours = _between(bundle.meta["sh0"], colours / np.float32(255))
        constant, opacities = of_colours[:, :3], np.asarray(sigmoid(of_colours[:, 3]), np.float64)
    else:
        scales = _codebook(bundle.meta["scales"])[bundle.pixels("scales")[:, :3]]
        constant, opacities = _codebook(bundle.meta["sh0"])[colours[:, :3]], colours[:, 3] / 255
    return RawSplats(
        (np.sign(logarithms) * np.expm1(np.abs(logarithms))).astype(np.float32),
        scales_of(scales),
        smallest_three(values, largest),
        opacities,
        np.concatenate([constant[:, None], _rest(bundle)], axis=1),
    )


def _rest(bundle: _Bundle) -> NDArray[np.float32]:
    """Return the harmonics besides the constant one, (N, K, 3), from the palette that they share."""
    entry = bundle.meta.get("shN")
    if not entry:
        return np.zeros((bundle.n_splats, 0, 3), np.float32)
    palette = bundle.picture("shN")
    n_rest = palette.shape[1] // PALETTE_COLUMNS
    if n_rest not in N_RESTS[1:] or palette.shape[1] % PALETTE_COLUMNS:
        raise ValueError(f"its palette of harmonics is {palette.shape[1]} pixels wide, expected 192, 512 or 960")
    entries = palette.reshape(-1, n_rest, 4)[..., :3]  # (P, K, 3)
    if "codebook" in entry:
        values = _codebook(entry)[entries]
    else:
        low, high = np.float32(entry["mins"]), np.float32(entry["maxs"])
        values = np.asarray(low + entries / np.float32(255) * (high - low), np.float32)
    low_byte, high_byte = bundle.pixels("shN", 1)[:, :2].astype(np.int64).T
    labels = low_byte | high_byte << 8
    if labels.max() >= len(values):
        raise ValueError(f"its harmonics name entry {labels.max()} of a palette of {len(values)}")
    return np.asarray(values[labels], np.float32)


def _between(entry: Mapping[str, Any], shares: NDArray[np.floating]) -> NDArray[np.float32]:
    low, high = np.array(entry["mins"], np.float32), np.array(entry["maxs"], np.float32)
    if low.shape != high.shape or low.shape != (shares.shape[1],):
        raise ValueError(f"it has bounds {low.tolist()} to {high.tolist()}, expected {shares.shape[1]} numbers each")
    return np.asarray(low + shares * (high - low), np.float32)


def _codebook(entry: Mapping[str, Any]) -> NDArray[np.float32]:
    values = np.array(entry["codebook"], np.float32)
    if values.shape != (256,):
        raise ValueError(f"it has a codebook of shape {values.shape}, expected 256 numbers")
    return values
