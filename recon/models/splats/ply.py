"""Splats as PLY: of the original trainer, and compressed as SuperSplat writes it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.geometry.ply import ply_bytes, vector_columns
from recon.geometry.ply_elements import Elements, Lists, read_elements
from recon.geometry.splats import Splats
from recon.models.splats.raw import (
    N_RESTS,
    RawSplats,
    check_count,
    constant_harmonics,
    scales_of,
    sigmoid,
    smallest_three,
)
from recon.runtime.files import check_suffix, write_bytes

ROWS_AT_ONCE = 8192  # the columns of a row lie beside each other in the file: so many rows stay in the cache
HEADER = 64 * 1024
SIGNS = (b" f_dc_0", b" packed_position")  # properties that points of splats alone have
CHUNK = 256  # splats of a compressed file that share bounds
AXES = ("x", "y", "z")
LEAST_LOGARITHM = -40.0  # of a scale or opacity that is 0


def is_splat_ply(path: Path) -> bool:
    """Tell by its header whether a PLY file holds splats; an OSError says that it cannot be read."""
    with path.open("rb") as file:
        header = file.read(HEADER).split(b"end_header", 1)[0]
    return any(sign in header for sign in SIGNS)


def read_splat_ply(path: Path) -> RawSplats:
    """Read a PLY of splats, plain or compressed.

    Raises
    ------
    ValueError
        If it is damaged, or lacks a property.
    """
    ply = read_elements(path)
    check_count(ply.n_rows("vertex"))
    return _compressed(ply) if "packed_position" in ply.columns("vertex") else _plain(ply.columns("vertex"))


def write_splat_ply(path: Path, splats: Splats) -> Path:
    """Write splats as the PLY of the original trainer, whole or not at all; `read_splat_ply` reads it.

    A ValueError says that the name does not end in .ply.
    """
    check_suffix(path, (".ply",))
    with np.errstate(divide="ignore"):
        scales = np.maximum(np.log(splats.scales), LEAST_LOGARITHM)
        opacities = np.clip(np.log(splats.opacities) - np.log1p(-splats.opacities), LEAST_LOGARITHM, -LEAST_LOGARITHM)
    rest = splats.harmonics[:, 1:].transpose(0, 2, 1).reshape(len(scales), -1)  # channel by channel
    columns = (
        vector_columns("xyz", splats.centres)
        | vector_columns([f"f_dc_{number}" for number in range(3)], splats.harmonics[:, 0])
        | vector_columns([f"f_rest_{number}" for number in range(rest.shape[1])], rest)
        | {"opacity": opacities.astype(np.float32)}
        | vector_columns([f"scale_{number}" for number in range(3)], scales.astype(np.float32))
        | vector_columns([f"rot_{number}" for number in range(4)], splats.rotations)
    )
    return write_bytes(path, ply_bytes(columns))


def _plain(columns: Mapping[str, NDArray[Any] | Lists]) -> RawSplats:
    n_rest = sum(name.startswith("f_rest_") for name in columns)
    if n_rest % 3 or n_rest // 3 < N_RESTS[0]:
        raise ValueError(f"it has {n_rest} properties f_rest, expected 0, 9, 24 or 45")
    of_channel = n_rest // 3
    n_kept = max(n for n in N_RESTS if n <= of_channel)
    warnings = () if n_kept == of_channel else (f"has {of_channel + 1} harmonics, of which {n_kept + 1} are shown",)
    harmonics = [f"f_dc_{channel}" for channel in range(3)]
    harmonics += [f"f_rest_{channel * of_channel + number}" for number in range(n_kept) for channel in range(3)]
    scales = [f"scale_{axis}" for axis in range(3 if "scale_2" in columns else 2)]  # splats that are flat have two
    table = _rows(columns, [*AXES, *scales, *(f"rot_{number}" for number in range(4)), "opacity"])
    n_scales = len(scales)
    widths = np.zeros((len(table), 3), np.float32)
    widths[:, :n_scales] = scales_of(table[:, 3 : 3 + n_scales])
    return RawSplats(
        table[:, :3],
        widths,
        table[:, 3 + n_scales : 7 + n_scales],
        sigmoid(table[:, 7 + n_scales]),
        _rows(columns, harmonics).reshape(len(table), -1, 3),
        warnings=warnings,
    )


def _rows(columns: Mapping[str, NDArray[Any] | Lists], names: Sequence[str]) -> NDArray[np.float32]:
    """Return columns of numbers as rows, float32 (N, C)."""
    numbers = [_number(columns, name) for name in names]
    rows = np.empty((len(numbers[0]), len(names)), np.float32)
    for start in range(0, len(rows), ROWS_AT_ONCE):
        for place, column in enumerate(numbers):
            rows[start : start + ROWS_AT_ONCE, place] = column[start : start + ROWS_AT_ONCE]
    return rows


def _number(columns: Mapping[str, NDArray[Any] | Lists], name: str) -> NDArray[Any]:
    column = columns.get(name)
    if column is None or isinstance(column, Lists):
        raise ValueError(f"its splats have no property {name}")
    return column


def _compressed(ply: Elements) -> RawSplats:
    """Unpack the numbers of a compressed PLY: 11, 10 and 11 bits between the bounds of 256 splats each.

    Source: https://developer.playcanvas.com/user-manual/gaussian-splatting/formats/ply
    """
    columns, chunks = ply.columns("vertex"), ply.columns("chunk")
    n = ply.n_rows("vertex")
    if ply.n_rows("chunk") != -(-n // CHUNK):
        raise ValueError(f"it has bounds of {ply.n_rows('chunk')} chunks, expected {-(-n // CHUNK)} for {n} splats")
    place, turn, size, colour = (
        _number(columns, f"packed_{name}").astype(np.uint32) for name in ("position", "rotation", "scale", "color")
    )
    shades = _unpacked(colour, (24, 16, 8), (8, 8, 8))
    if "min_r" in chunks:
        shades = _between(chunks, shades, ("r", "g", "b"))
    values = (_unpacked(turn, (20, 10, 0), (10, 10, 10)) - np.float32(0.5)) * np.float32(np.sqrt(2))
    harmonics = constant_harmonics(shades)
    if ply.n_rows("sh"):
        harmonics = np.concatenate([harmonics, _packed_harmonics(ply.columns("sh"), n)], axis=1)
    return RawSplats(
        _between(chunks, _unpacked(place, (21, 11, 0), (11, 10, 11)), AXES),
        scales_of(_between(chunks, _unpacked(size, (21, 11, 0), (11, 10, 11)), [f"scale_{axis}" for axis in AXES])),
        smallest_three(values, turn >> 30),
        _unpacked(colour, (0,), (8,))[:, 0],
        harmonics,
    )


def _unpacked(packed: NDArray[np.uint32], shifts: Sequence[int], bits: Sequence[int]) -> NDArray[np.float32]:
    """Return parts of whole numbers (N,) as shares of their largest value, float32 (N, C)."""
    parts = [((packed >> shift) & (2**n - 1)) / np.float32(2**n - 1) for shift, n in zip(shifts, bits, strict=True)]
    return np.stack(parts, axis=1).astype(np.float32)


def _between(
    chunks: Mapping[str, NDArray[Any] | Lists], shares: NDArray[np.float32], names: Sequence[str]
) -> NDArray[np.float32]:
    """Return the numbers (N, C) at shares of the way between the bounds of their chunks."""
    low, high = (
        np.repeat(_rows(chunks, [f"{end}_{name}" for name in names]), CHUNK, axis=0)[: len(shares)]
        for end in ("min", "max")
    )
    return np.asarray(low * (1 - shares) + high * shares, np.float32)


def _packed_harmonics(columns: Mapping[str, NDArray[Any] | Lists], n: int) -> NDArray[np.float32]:
    if len(columns) % 3 or len(columns) // 3 not in N_RESTS:
        raise ValueError(f"its element sh has {len(columns)} properties, expected 9, 24 or 45")
    of_channel = len(columns) // 3
    names = [f"f_rest_{channel * of_channel + number}" for number in range(of_channel) for channel in range(3)]
    levels = _rows(columns, names)
    if len(levels) != n:
        raise ValueError(f"it has harmonics of {len(levels)} splats, expected {n}")
    shares = np.where(levels == 0, 0, np.where(levels == 255, 1, (levels + 0.5) / 256))
    return ((shares - 0.5) * 8).astype(np.float32).reshape(n, -1, 3)
