"""A Python package of others as pip leaves it: a module and its metadata in a folder of packages."""

from __future__ import annotations

from pathlib import Path


def install(folder: Path, name: str, code: str, entry_points: str, version: str = "1.0") -> None:
    """Put a package of one module, and what it registers, into a folder that is on the path."""
    (folder / f"{name}.py").write_text(code)
    metadata = folder / f"{name}-{version}.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    (metadata / "entry_points.txt").write_text(entry_points)
