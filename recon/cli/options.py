"""What the commands' options mean: sizes, ranges of frames, pairs of views, places and boxes, read from text."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import typer

from recon.storage.remote import place


def parse_size(text: str) -> tuple[int, int]:
    """(width, height) of "WIDTHxHEIGHT"."""
    found = re.fullmatch(r"(\d+)x(\d+)", text)
    if found is None:
        raise typer.BadParameter(f"{text!r} is not a size; expected WIDTHxHEIGHT, for example 1920x1080")
    return int(found[1]), int(found[2])


def parse_names(text: str) -> tuple[str, ...]:
    """The names of "a,b,c"."""
    return tuple(name.strip().lower() for name in text.split(",") if name.strip())


def parse_frames(text: str | None) -> range | None:
    """The frames of "A:B", with either end left out for the first or last."""
    if text is None:
        return None
    found = re.fullmatch(r"(\d*):(\d*)", text)
    if found is None:
        raise typer.BadParameter(f"{text!r} is not a range of frames; expected A:B, for example 0:25")
    return range(int(found[1] or 0), int(found[2]) if found[2] else 2**31)


def parse_pairs(text: str) -> tuple[tuple[int, int], ...]:
    """The view numbers of "13-14,20-21"."""
    found = [re.fullmatch(r"(\d+)-(\d+)", pair.strip()) for pair in text.split(",")]
    if not all(found):
        raise typer.BadParameter(f"{text!r} are not pairs of views; expected for example 13-14,20-21")
    return tuple((int(pair[1]), int(pair[2])) for pair in found if pair)


def parse_place(address: str) -> Path:
    """The folder of a path or an fsspec URL."""
    try:
        return place(address)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error


def parse_position(text: str) -> tuple[float, float, float]:
    """The numbers of "x,y,z"."""
    try:
        x, y, z = (float(value) for value in text.split(","))
    except ValueError as error:
        raise typer.BadParameter(f"{text!r} is not a position; expected x,y,z in mm") from error
    return x, y, z


def parse_bounds(text: str | None) -> Any:
    """Bounds (2, 3) in mm of "x0,y0,z0,x1,y1,z1", or None."""
    if text is None:
        return None
    import numpy as np

    try:
        return np.array([float(value) for value in text.split(",")]).reshape(2, 3)
    except ValueError as error:
        raise typer.BadParameter(f"{text!r} are not bounds; expected x0,y0,z0,x1,y1,z1 in mm") from error
