"""Splats of any form, chosen by the file's ending and, for PLY, by its header."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from recon.geometry.splats import Splats
from recon.models.splats.ksplat import read_ksplat
from recon.models.splats.ply import is_splat_ply, read_splat_ply
from recon.models.splats.raw import RawSplats, cleaned
from recon.models.splats.sog import read_sog
from recon.models.splats.splat import read_splat
from recon.models.splats.spz import read_spz
from recon.runtime.files import refused

SPLAT_READERS: dict[str, Callable[[Path], RawSplats]] = {
    ".ply": read_splat_ply,
    ".spz": read_spz,
    ".splat": read_splat,
    ".ksplat": read_ksplat,
    ".sog": read_sog,
}


def holds_splats(path: Path) -> bool:
    """Tell whether a file holds splats; one that cannot be opened does not."""
    suffix = path.suffix.lower()
    if suffix != ".ply":
        return suffix in SPLAT_READERS
    try:
        return is_splat_ply(path)
    except OSError:
        return False


def read_splats(path: str | Path) -> Splats:
    """Read Gaussian splats in the file's own unit and axes; those that cannot be drawn are left out.

    Parameters
    ----------
    path : of a file in one of the formats of `SPLAT_READERS`

    Raises
    ------
    ValueError
        If the file is missing, damaged or of another kind; the message begins with the path.
    """
    return read_with_warnings(Path(path))[0]


def read_with_warnings(path: Path) -> tuple[Splats, tuple[str, ...]]:
    """Read splats as `read_splats` does; returns them, and a clause for each fault that follows the file's name."""
    reader = SPLAT_READERS.get(path.suffix.lower())
    if reader is None:
        raise ValueError(f"{path}: is no file of splats, expected {', '.join(SPLAT_READERS)}")
    try:
        return cleaned(reader(path))
    except OSError as error:
        raise refused(path, error) from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
