"""Splats as SPZ, versions 2 to 4: one gzip stream, or from version 4 on a Zstandard stream for each property.

Source: https://github.com/nianticlabs/spz (load-spz.cc)
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.models.splats.raw import N_RESTS, RawSplats, check_count, check_length, scales_of, smallest_three

MAGIC = b"NGSP"
GZIP = b"\x1f\x8b"
HEADER, LONG_HEADER = struct.Struct("<4sIIBBBx"), struct.Struct("<4sIIBBBBI12x")
TABLE_ENTRY = struct.Struct("<QQ")
ANTIALIASED = 0x1  # flag
COLOUR_SCALE = np.float32(0.15)
LAST_BIT = 23  # of a coordinate, besides its sign
NEAR_THE_END = 0.99  # of what the bits hold
BEYOND = ", where its numbers end: what lay farther out is elsewhere; write it in a larger unit, such as metres"
ON_AXIS = 511  # largest of nine bits


def read_spz(path: Path) -> RawSplats:
    """Read an SPZ file.

    Raises
    ------
    ValueError
        If it is damaged, or of another version.
    """
    content = path.read_bytes()
    if content.startswith(GZIP):
        return _read_gzip(content)
    if content.startswith(MAGIC) and len(content) >= LONG_HEADER.size:
        return _read_streams(content)
    raise ValueError(f"it begins with {content[:4]!r}, expected a gzip stream or NGSP")


def _read_gzip(content: bytes) -> RawSplats:
    stream = zlib.decompressobj(wbits=31)
    try:
        header = stream.decompress(content, HEADER.size)
        if len(header) < HEADER.size:
            raise ValueError(f"it ends after {len(header)} bytes of its header")
        magic, version, n, degree, bits, flags = HEADER.unpack(header)
        _check(magic, version, (2, 3), bits, degree)
        check_count(n)
        sizes = _sizes(n, degree, version)
        body = stream.decompress(stream.unconsumed_tail, sum(sizes))
    except zlib.error as error:
        raise ValueError(f"its gzip stream is damaged: {error}") from error
    check_length(len(body), sum(sizes), n)
    parts = np.split(np.frombuffer(body, np.uint8), np.cumsum(sizes)[:-1])
    return _splats(parts, n, bits, version, bool(flags & ANTIALIASED))


def _read_streams(content: bytes) -> RawSplats:
    import pyarrow  # heavy, and of this form alone

    magic, version, n, degree, bits, flags, n_streams, at = LONG_HEADER.unpack_from(content)
    _check(magic, version, (4,), bits, degree)
    check_count(n)
    sizes = _sizes(n, degree, version)
    n_expected = sum(size > 0 for size in sizes)
    start = at + n_streams * TABLE_ENTRY.size
    if n_streams < n_expected or at < LONG_HEADER.size or start > len(content):
        raise ValueError(f"its table has {n_streams} streams, expected {n_expected} within the file")
    parts = []
    for number, size in enumerate(sizes):
        if not size:
            parts.append(np.zeros(0, np.uint8))
            continue
        packed, unpacked = TABLE_ENTRY.unpack_from(content, at + number * TABLE_ENTRY.size)
        if unpacked != size or start + packed > len(content):
            raise ValueError(f"its stream {number} has {unpacked} bytes, expected {size} within the file")
        try:
            body = pyarrow.decompress(content[start : start + packed], size, codec="zstd", asbytes=True)
        except (OSError, ValueError) as error:
            raise ValueError(f"its stream {number} is damaged: {error}") from error
        check_length(len(body), size, n)
        parts.append(np.frombuffer(body, np.uint8))
        start += packed
    return _splats(parts, n, bits, version, bool(flags & ANTIALIASED))


def _check(magic: bytes, version: int, versions: tuple[int, ...], bits: int, degree: int) -> None:
    if magic != MAGIC:
        raise ValueError(f"its stream begins with {magic!r}, expected NGSP")
    if version not in versions:
        raise ValueError(f"it is of version {version}, expected 2, 3 or 4")
    if degree >= len(N_RESTS) or not 1 <= bits <= 24:
        raise ValueError(
            f"it has harmonics of degree {degree} and {bits} bits after the point, expected 0 to 3, 1 to 24"
        )


def _sizes(n: int, degree: int, version: int) -> list[int]:
    """Return the bytes of positions, opacities, colours, scales, rotations and harmonics."""
    return [9 * n, n, 3 * n, 3 * n, (3 if version == 2 else 4) * n, 3 * N_RESTS[degree] * n]


def _splats(parts: list[NDArray[np.uint8]], n: int, bits: int, version: int, antialiased: bool) -> RawSplats:
    places, opacities, colours, scales, rotations, rest = parts
    low, middle, high = places.reshape(-1, 3).astype(np.int32).T
    fixed = (low | middle << 8 | high << 16) << 8 >> 8  # with the sign of 24 bits
    reach = float(np.abs(fixed).max()) / 2**bits
    ends = reach > NEAR_THE_END * 2 ** (LAST_BIT - bits)
    constant = (colours.reshape(n, 1, 3) / np.float32(255) - np.float32(0.5)) / COLOUR_SCALE
    others = (rest.reshape(n, -1, 3).astype(np.float32) - 128) / 128
    return RawSplats(
        (fixed / np.float64(2**bits)).reshape(n, 3).astype(np.float32),
        scales_of(scales.reshape(n, 3) / np.float32(16) - 10),
        _three_bytes(rotations) if version == 2 else _four_bytes(rotations),
        opacities / np.float32(255),
        np.concatenate([constant, others], axis=1).astype(np.float32),
        antialiased,
        (f"reaches {reach:.0f} of its unit{BEYOND}",) if ends else (),
    )


def _three_bytes(packed: NDArray[np.uint8]) -> NDArray[np.float32]:
    xyz = packed.reshape(-1, 3) / np.float32(127.5) - 1
    w = np.sqrt(np.maximum(0, 1 - (xyz**2).sum(axis=1)))
    return np.column_stack([w, xyz]).astype(np.float32)


def _four_bytes(packed: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Unpack the three smaller numbers, ten bits each, the last one lowest, and the place of the largest above them."""
    numbers = packed.view("<u4")
    parts = np.stack([numbers >> shift & 0x3FF for shift in (20, 10, 0)], axis=1)
    size = (parts & ON_AXIS).astype(np.float32) * np.float32(np.sqrt(0.5) / ON_AXIS)
    xyzw = smallest_three(np.where(parts >> 9, -size, size), numbers >> 30)
    return np.asarray(xyzw[:, [3, 0, 1, 2]])
