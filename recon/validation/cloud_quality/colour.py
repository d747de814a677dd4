"""Differences of colour at nearest points, in Y, Cb and Cr of BT.709, as MPEG's pc_error computes them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from recon.render.encoding.quality import psnr_db
from recon.validation.cloud_quality.compared import Pair, Prepared, Value, both_ways
from recon.validation.cloud_quality.neighbours import NearestGroups

CHANNELS = ("y", "cb", "cr")
BT709 = np.array([[0.2126, 0.7152, 0.0722], [-0.1146, -0.3854, 0.5], [0.5, -0.4542, -0.0458]])  # ITU-R BT.709, 3.2
OFFSETS = np.array([0.0, 0.5, 0.5])


def y_cb_cr(colours: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Convert sRGB (N, 3) to Y, Cb and Cr, float32 (N, 3), each from 0 to 1.

    Source
    ------
    ITU-R BT.709-6 (2015), items 3.2 and 3.3, with four decimals as in mpeg-pcc-dmetric.
    """
    return np.asarray(colours @ BT709.T / 255 + OFFSETS, np.float32)


def colours(pair: Pair) -> list[Value]:
    """Measure mean squared differences and PSNR of Y, Cb and Cr, and the largest squared ones of R, G and B.

    Parameters
    ----------
    pair : the clouds; both must have colours

    Convention
    ----------
    Colours of points at one place are averaged and truncated. Those of several nearest neighbours are averaged and
    rounded, half up, before the conversion. Y, Cb and Cr go from 0 to 1; the PSNR's peak is 1. Symmetric is the worse
    of both directions. R, G and B (`r_hausdorff_squared`) are in squared 8-bit levels.

    Raises
    ------
    ValueError
        If a cloud has no colours.

    Source
    ------
    N18665 (2019), annex on metrics; R. Mekuria, Z. Li, C. Tulvan, P. Chou, "Evaluation criteria for PCC
    (Point Cloud Compression)", ISO/IEC MPEG N16332 (2016); mpeg-pcc-dmetric 0.14.1.
    """
    real, distorted = _colours(pair.reference), _colours(pair.distorted)
    forward = _differences(pair.to_distorted, real, distorted)
    backward = _differences(pair.to_reference, distorted, real)
    values = []
    for channel, a, b in zip(CHANNELS, forward[0], backward[0], strict=True):
        values += both_ways(f"{channel}_mse", a, b, unit="", better="lower")
        values += both_ways(f"{channel}_psnr_db", psnr_db(a, 1), psnr_db(b, 1), unit="dB", better="higher")
    for channel, a, b in zip("rgb", forward[1], backward[1], strict=True):
        values += both_ways(f"{channel}_hausdorff_squared", a, b, unit="levels²", better="lower")
    return values


def _colours(cloud: Prepared) -> NDArray[np.uint8]:
    if cloud.cloud.colours is None:
        raise ValueError(f"{cloud.cloud.name}: has no colours (red, green, blue of 8 bits)")
    return cloud.places.mean(cloud.cloud.colours).astype(np.uint8)  # truncates


def _differences(
    groups: NearestGroups, values: NDArray[np.uint8], others: NDArray[np.uint8]
) -> tuple[list[float], list[float]]:
    """Return the mean squared differences of Y, Cb and Cr, and the largest squared ones of R, G and B."""
    near = np.stack([np.floor(groups.mean(others[groups.members, c].astype(np.float64)) + 0.5) for c in range(3)], 1)
    near = near.astype(np.uint8)
    squared = np.square(y_cb_cr(values) - y_cb_cr(near)).astype(np.float64)
    levels = np.square(values.astype(np.int64) - near)
    return squared.mean(axis=0).tolist(), levels.max(axis=0).astype(float).tolist()
