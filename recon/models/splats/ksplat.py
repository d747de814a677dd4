"""Splats as .ksplat: sections of splats, their places relative to the middles of buckets where they are compressed.

Source: https://github.com/mkkellogg/GaussianSplats3D (SplatBuffer.js)
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.models.splats.raw import N_RESTS, RawSplats, check_count, check_length, constant_harmonics

HEADER, SECTION_HEADER = 4096, 1024  # bytes
NUMBERS = ("<f4", "<u2", "<u2")  # of places by level of compression
SIZES = ("<f4", "<f2", "<f2")  # of scales and rotations
HARMONICS = ("<f4", "<f2", "u1")
HALF_RANGE = 32767  # of places where a section does not say
MOST_SECTIONS = 1000


@dataclass(frozen=True)
class _Section:
    n_splats: int
    n_reserved: int
    capacity: int
    n_buckets: int
    block: float
    bucket_bytes: int
    half_range: int
    n_full: int
    n_partial: int
    degree: int


def read_ksplat(path: Path) -> RawSplats:
    """Read a .ksplat file.

    Raises
    ------
    ValueError
        If it is damaged, or of another version.
    """
    content = path.read_bytes()
    if len(content) < HEADER:
        raise ValueError(f"it has {len(content)} bytes, expected a header of {HEADER}")
    major, minor = content[0], content[1]
    n_sections, n_splats, level = struct.unpack_from("<4xI8xIH", content)
    if (major, minor > 0) != (0, True) or level >= len(NUMBERS) or n_sections > MOST_SECTIONS:
        raise ValueError(
            f"it is of version {major}.{minor} with {n_sections} sections and compression {level}, expected version "
            f"0.1, at most {MOST_SECTIONS} sections, and compression 0, 1 or 2"
        )
    check_count(n_splats)
    low, high = struct.unpack_from("<ff", content, 36)
    bounds = (low or -1.5, high or 1.5)
    check_length(len(content), HEADER + n_sections * SECTION_HEADER, n_splats)
    sections = [_section(content, HEADER + number * SECTION_HEADER) for number in range(n_sections)]
    n_rest = max((N_RESTS[section.degree] for section in sections if section.n_splats), default=0)
    at, parts = HEADER + n_sections * SECTION_HEADER, []
    for section in sections:
        part, at = _read_section(content, at, section, level, bounds, n_rest)
        parts.append(part)
    n_held = sum(len(part.centres) for part in parts)
    if n_held < n_splats:
        raise ValueError(f"its sections hold {n_held} splats, expected {n_splats}")

    def joined(name: str) -> NDArray[np.floating]:
        return np.concatenate([getattr(part, name) for part in parts])[:n_splats]

    return RawSplats(joined("centres"), joined("scales"), joined("rotations"), joined("opacities"), joined("harmonics"))


def _section(content: bytes, at: int) -> _Section:
    numbers = struct.unpack_from("<IIIIfHxxI4xIIH", content, at)
    section = _Section(*numbers)
    if section.degree >= len(N_RESTS) or section.n_splats > section.n_reserved:
        raise ValueError(
            f"a section has harmonics of degree {section.degree} and {section.n_splats} splats in room for "
            f"{section.n_reserved}"
        )
    return section


def _read_section(
    content: bytes, at: int, section: _Section, level: int, bounds: tuple[float, float], n_rest: int
) -> tuple[RawSplats, int]:
    """Return the splats of a section that begins at a byte, and the byte where it ends."""
    row = np.dtype(
        [
            ("centre", NUMBERS[level], 3),
            ("scale", SIZES[level], 3),
            ("rotation", SIZES[level], 4),
            ("colour", "u1", 4),
            ("harmonics", HARMONICS[level], 3 * N_RESTS[section.degree]),
        ]
    )
    middles_at = at + 4 * section.n_partial
    splats_at = middles_at + section.bucket_bytes * section.n_buckets
    end = splats_at + row.itemsize * section.n_reserved
    check_length(len(content), splats_at + row.itemsize * section.n_splats, section.n_splats)
    rows = np.frombuffer(content, row, section.n_splats, splats_at)
    centres = rows["centre"].astype(np.float32)
    if level:
        sizes = np.frombuffer(content, "<u4", section.n_partial, at)
        middles = np.frombuffer(content, "<f4", 3 * section.n_buckets, middles_at).reshape(-1, 3)
        half = section.half_range or HALF_RANGE
        step = np.float32(section.block / 2 / half)
        centres = (centres - half) * step + middles[_buckets(section, sizes)]
    harmonics = np.zeros((section.n_splats, 1 + n_rest, 3), np.float32)
    harmonics[:, :1] = constant_harmonics(rows["colour"][:, :3] / np.float32(255))
    _fill_rest(harmonics, rows["harmonics"], level, bounds)
    opacities = rows["colour"][:, 3] / np.float32(255)
    return RawSplats(
        centres, rows["scale"].astype(np.float32), rows["rotation"].astype(np.float32), opacities, harmonics
    ), end


def _buckets(section: _Section, sizes: NDArray[np.uint32]) -> NDArray[np.int64]:
    """Return the bucket (N,) of each splat: full ones first, then those that are filled in part."""
    if section.n_full + section.n_partial > section.n_buckets:
        raise ValueError(f"it fills {section.n_full + section.n_partial} buckets of {section.n_buckets}")
    counts = np.concatenate([np.full(section.n_full, section.capacity, np.int64), sizes.astype(np.int64)])
    if not section.n_splats <= counts.sum() <= section.n_reserved + section.capacity:
        raise ValueError(f"its buckets hold {counts.sum()} splats, expected {section.n_splats}")
    return np.searchsorted(np.cumsum(counts), np.arange(section.n_splats), side="right")


def _fill_rest(
    harmonics: NDArray[np.float32], packed: NDArray[np.generic], level: int, bounds: tuple[float, float]
) -> None:
    """Write the harmonics of degree 1 and above, which stand degree by degree, then channel by channel."""
    values = packed.astype(np.float32)
    if level == 2:
        values = np.asarray(bounds[0] + values / 255 * (bounds[1] - bounds[0]), np.float32)
    at = 0
    for degree in (1, 2, 3):
        n = 2 * degree + 1
        if at < values.shape[1]:
            band = values[:, at : at + 3 * n].reshape(-1, 3, n)
            harmonics[:, degree**2 : (degree + 1) ** 2] = band.transpose(0, 2, 1)
            at += 3 * n
