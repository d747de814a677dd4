"""Disparity maps on disk: PFM, NPY and TIFF, and a coloured PNG to look at.

Convention
----------
In memory an unmatched pixel is NaN. NPY and TIFF keep it; PFM, which has no NaN by custom, holds infinity. Only TIFF is
compressed (deflate): a person before a masked background takes a seventh of the space.
PFM stores the bottom row first and its scale's sign gives the byte order (negative: little endian).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.runtime.files import whole_file, why_no_file
from recon.runtime.npy import read_npy
from recon.runtime.pfm import read_pfm

SUFFIXES = (".pfm", ".npy", ".tiff", ".tif", ".png")
PNG16_SCALE = 256  # KITTI's devkit, 2012
SMALL = [cv2.IMWRITE_TIFF_COMPRESSION, cv2.IMWRITE_TIFF_COMPRESSION_ADOBE_DEFLATE]
PREVIEW_PERCENTILES = (1.0, 99.0)  # a few wrong matches must not wash out the colours


def write_disparity(path: Path, disparity: NDArray[np.floating]) -> None:
    """Write a disparity map in the format of the path's suffix, whole or not at all.

    Parameters
    ----------
    path : ends in .pfm, .npy, .tiff, .tif, or .png (a coloured preview, not readable as disparities)
    disparity : floating (H, W), pixels, NaN where unmatched

    Raises
    ------
    ValueError
        If the suffix is none of these or the map is not two-dimensional.
    """
    check_suffix(path)
    values = np.ascontiguousarray(disparity, dtype=np.float32)
    if values.ndim != 2:
        raise ValueError(f"{path}: a disparity map has two dimensions, found shape {values.shape}")
    with whole_file(path) as temporary:
        if path.suffix == ".npy":
            np.save(temporary, values)
        elif path.suffix == ".pfm":
            temporary.write_bytes(_pfm_bytes(values))
        else:
            image = colour_preview(values)[:, :, ::-1] if path.suffix == ".png" else values
            if not cv2.imwrite(str(temporary), image, [] if path.suffix == ".png" else SMALL):
                raise ValueError(f"{path}: could not be written as {path.suffix}")


def read_disparity(path: Path) -> NDArray[np.float32]:
    """Read a disparity map, float32 (H, W), pixels, NaN where unmatched.

    Raises
    ------
    ValueError
        If the file is missing, damaged, of an unknown suffix, a TIFF of whole numbers, or a PNG, whose colours are not
        disparities.
    """
    check_suffix(path)
    if path.suffix == ".png":
        raise ValueError(f"{path}: a PNG is a coloured preview; read the PFM, NPY or TIFF instead")
    if not path.is_file():
        raise ValueError(f"{path}: {why_no_file(path)}")
    values = _read_values(path)
    if values.ndim != 2 or values.dtype.kind not in "fiu":
        raise ValueError(f"{path}: holds {values.dtype} of shape {values.shape}, expected numbers in two dimensions")
    with np.errstate(over="ignore"):  # infinity is no disparity
        disparity = np.array(values, dtype=np.float32)
    disparity[np.isinf(disparity)] = np.nan
    return disparity


def read_disparity_png16(path: Path) -> NDArray[np.float32]:
    """Read a disparity map stored as KITTI does: a grey PNG of 16 bits, 256 times the disparity, 0 where unmatched.

    Returns float32 (H, W), pixels, NaN where unmatched; a ValueError says that the file is something else.
    """
    image = _read_image(path, "PNG")
    if image.ndim != 2 or image.dtype != np.uint16:
        raise ValueError(f"{path}: holds {image.dtype} of shape {image.shape}, expected one channel of 16 bits")
    return np.where(image > 0, image / np.float32(PNG16_SCALE), np.float32(np.nan)).astype(np.float32)


def colour_preview(disparity: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Colour a disparity map (H, W) as sRGB, uint8 (H, W, 3): near is warm, far is cold, unmatched is black."""
    valid = np.isfinite(disparity)
    if not valid.any():
        return np.zeros((*disparity.shape, 3), dtype=np.uint8)
    low, high = np.percentile(disparity[valid], PREVIEW_PERCENTILES)
    shade = np.clip((np.where(valid, disparity, low) - low) / max(float(high - low), 1e-6), 0, 1)
    colours = cv2.applyColorMap(np.round(shade * 255).astype(np.uint8), cv2.COLORMAP_TURBO)[:, :, ::-1]
    return np.ascontiguousarray(np.where(valid[..., None], colours, 0), dtype=np.uint8)


def check_suffix(path: Path) -> None:
    """Raise a ValueError if a file's name has the suffix of no format."""
    if path.suffix not in SUFFIXES:
        raise ValueError(
            f"{path}: unknown format {path.suffix or 'without a suffix'!r}; expected {', '.join(SUFFIXES)}"
        )


def _pfm_bytes(values: NDArray[np.float32]) -> bytes:
    rows = np.where(np.isfinite(values), values, np.inf)[::-1].astype("<f4")
    return f"Pf\n{values.shape[1]} {values.shape[0]}\n-1.0\n".encode("ascii") + rows.tobytes()


def _read_values(path: Path) -> NDArray[np.generic]:
    if path.suffix == ".pfm":
        return read_pfm(path)
    if path.suffix == ".npy":
        return read_npy(path)
    image = _read_image(path, "TIFF")
    if image.dtype.kind != "f":
        raise ValueError(
            f"{path}: holds {image.dtype}, expected floating numbers: whole ones do not say what their unit is, nor "
            "what is unmatched"
        )
    return image


def _read_image(path: Path, kind: str) -> NDArray[Any]:
    try:
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:  # more pixels than OpenCV takes
        raise ValueError(f"{path}: is not readable as {kind}: {error.err}") from error
    if image is None:
        raise ValueError(f"{path}: is not readable as {kind}")
    return np.asarray(image)
