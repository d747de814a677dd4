"""Splats as a file has them, before what cannot be drawn is left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from recon.geometry.splats import N_HARMONICS, Splats

C0 = 0.28209479177387814  # the constant harmonic
MOST_SPLATS = 8_000_000  # of a file; the largest scenes in publications have 6 to 7 million
FARTHEST = 1e12  # of a coordinate or scale, as for meshes
N_RESTS = tuple(n - 1 for n in N_HARMONICS)  # coefficients of a channel besides the constant one, by degree


@dataclass
class RawSplats:
    """What a reader read.

    Parameters
    ----------
    centres, scales : floating (N, 3), in the file's unit
    rotations : floating (N, 4), w first, of any length
    opacities : floating (N,), 0 to 1
    harmonics : floating (N, K, 3)
    antialiased : whether the file says that the method was trained so
    warnings : what is not shown as the file has it, a clause each that follows the file's name
    """

    centres: NDArray[np.floating]
    scales: NDArray[np.floating]
    rotations: NDArray[np.floating]
    opacities: NDArray[np.floating]
    harmonics: NDArray[np.floating]
    antialiased: bool = False
    warnings: tuple[str, ...] = ()


def check_count(n_splats: int) -> None:
    """Raise a ValueError if a file has no splats, or more than can be drawn here."""
    if n_splats < 1:
        raise ValueError("it holds no splats")
    if n_splats > MOST_SPLATS:
        raise ValueError(f"it has {n_splats} splats, expected {MOST_SPLATS} at most; prune it, or train with fewer")


def check_length(n_bytes: int, expected: int, n_splats: int) -> None:
    """Raise a ValueError if a file's contents are shorter than its number of splats needs.

    Parameters
    ----------
    n_bytes, expected : of the contents, as they are and as they have to be at least
    n_splats : that the file promises
    """
    if n_bytes < expected:
        raise ValueError(f"it ends after {n_bytes} bytes, expected {expected} for its {n_splats} splats")


def cleaned(raw: RawSplats) -> tuple[Splats, tuple[str, ...]]:
    """Leave out what cannot be drawn; returns the splats, and a clause for each kind of fault that was found.

    Raises
    ------
    ValueError
        If no splat is left.
    """
    warnings = list(raw.warnings)
    n = len(raw.centres)
    check_count(n)
    rotations = np.asarray(raw.rotations, np.float64)
    with np.errstate(invalid="ignore", over="ignore"):
        lengths = np.linalg.norm(rotations, axis=1)
        usable = np.isfinite(lengths) & np.isfinite(raw.opacities)
        for values in (raw.centres, raw.scales):
            usable &= (np.abs(values) < FARTHEST).all(axis=1)  # false for NaN
        for number in range(raw.harmonics.shape[1]):
            usable &= np.isfinite(raw.harmonics[:, number]).all(axis=1)
    if not usable.any():
        raise ValueError(f"none of its {n} splats has finite numbers")
    is_zero = usable & (lengths == 0)
    if is_zero.any():
        warnings.append(f"has {is_zero.sum()} splats with the quaternion 0, which are not turned")
        rotations = np.where(is_zero[:, None], np.array([1.0, 0, 0, 0]), rotations)
        lengths = np.where(is_zero, 1, lengths)
    if not usable.all():
        warnings.append(f"has {n - usable.sum()} of {n} splats with numbers that are not finite, which are left out")
    every = usable.all()

    def kept(values: NDArray[np.floating]) -> NDArray[np.float32]:
        return np.asarray(values if every else values[usable], np.float32)

    splats = Splats(
        kept(raw.centres),
        kept(raw.scales),
        kept(rotations / np.where(usable, lengths, 1)[:, None]),
        np.clip(kept(raw.opacities), 0, 1),
        kept(raw.harmonics),
        raw.antialiased,
    )
    return splats, tuple(warnings)


def sigmoid(logits: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return opacities (N,), 0 to 1, of logits; NaN stays."""
    with np.errstate(over="ignore"):
        return np.asarray(1 / (1 + np.exp(-np.asarray(logits, np.float32))), np.float32)


def scales_of(logarithms: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return scales (N, 3) of their natural logarithms; too large ones become infinite, and `cleaned` drops them."""
    with np.errstate(over="ignore"):
        return np.asarray(np.exp(np.asarray(logarithms, np.float32)), np.float32)


def constant_harmonics(colours: ArrayLike) -> NDArray[np.float32]:
    """Return harmonics (N, 1, 3) of colours (N, 3), 0 to 1, that are the same from everywhere."""
    return np.asarray((np.asarray(colours, np.float32) - np.float32(0.5)) / np.float32(C0), np.float32)[:, None]


def smallest_three(values: NDArray[np.floating], largest: NDArray[np.integer]) -> NDArray[np.float32]:
    """Return quaternions (N, 4) of their three smaller numbers.

    Parameters
    ----------
    values : (N, 3), the numbers besides the largest one, in order
    largest : (N,), the place of the number that was left out, which is at least 0
    """
    n = len(values)
    quaternions = np.empty((n, 4), np.float32)
    rows = np.arange(n)
    for place in range(3):
        quaternions[rows, place + (place >= largest)] = values[:, place]
    quaternions[rows, largest] = np.sqrt(np.maximum(0, 1 - (values.astype(np.float32) ** 2).sum(axis=1)))
    return quaternions
