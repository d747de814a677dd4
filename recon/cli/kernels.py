"""Say that numba compiles kernels, which a command does the first time on a machine, and which takes a while."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from recon.cli.console import ProgressLine

ROOT = Path(__file__).parents[1]
STUDIO, DEPTH, RENDER = "studio", "depth", "render"  # packages with kernels
MARK = "njit("  # in a file with kernels


def tell_of_compiling(progress: ProgressLine, *packages: str | Path) -> None:
    """Say once that kernels are compiled first, where none of a package's has been here; imports nothing."""
    missing = [Path(package).name for package in packages if not _is_compiled(ROOT / package)]
    if missing:
        progress.say(
            f"First, kernels are compiled ({', '.join(missing)}), once on this machine: a minute or two of processor "
            "time, before the progress below moves."
        )


def _is_compiled(package: Path) -> bool:
    """Whether a kernel of a package lies compiled on disk, newer than its source."""
    return any(
        compiled.stat().st_mtime >= source.stat().st_mtime
        for source in package.rglob("*.py")
        if MARK in source.read_text(encoding="utf-8")
        for compiled in _compiled(source)
    )


def _compiled(source: Path) -> Iterator[Path]:
    """Find what numba has kept of a file: where the environment says, beside it, or in the user's folder."""
    name = f"{source.stem}.*.nbi"
    if folder := os.environ.get("NUMBA_CACHE_DIR"):
        yield from Path(folder).glob(f"*/{name}")
        return
    yield from (source.parent / "__pycache__").glob(name)
    yield from (Path.home() / ".cache" / "numba").glob(f"*/{name}")
