"""Small clouds for the tests."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np

from recon.geometry.ply import FLOAT_NORMAL, UINT8_COLOUR, ply_bytes, vector_columns
from recon.validation.cloud_quality.points import PointSet
from tests.command_line import Command


def ball(n: int = 400, *, noise: float = 0.0, colour_noise: float = 0.0, seed: int = 1) -> PointSet:
    """A coloured ball of radius 100 with its normals, at random places, disturbed."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    disturbed = np.random.default_rng(seed + 1)
    points = 100 * normals + noise * disturbed.normal(size=(n, 3))
    levels = 128 + 100 * np.sin(3 * normals) + colour_noise * disturbed.normal(size=(n, 3))
    return PointSet("ball", points, normals, np.clip(levels, 0, 255).astype(np.uint8))


def write(path: Path, cloud: PointSet, *, normals: bool = True, colours: bool = True, scale: float = 1.0) -> Path:
    """Write a cloud as PLY, with what is asked for."""
    columns = vector_columns("xyz", cloud.points * np.float32(scale))
    if normals and cloud.normals is not None:
        columns |= vector_columns(FLOAT_NORMAL, cloud.normals)
    if colours and cloud.colours is not None:
        columns |= vector_columns(UINT8_COLOUR, cloud.colours)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(ply_bytes(columns))
    return path


def validate(command: Command, out: Path, *arguments: object) -> dict[str, Any]:
    """Run `validate cloud`, and return what it prints with --json."""
    outcome = command("validate", "cloud", *arguments, "-o", out, "--json")
    assert outcome.code == 0, outcome.err
    report: dict[str, Any] = json.loads(outcome.out)
    return report


def refusal(command: Command, out: Path, *arguments: object) -> str:
    """Run `validate cloud` with what it refuses, and return the only line that it then prints."""
    outcome = command("validate", "cloud", *arguments, "-o", out)
    assert outcome.code == 1, outcome
    assert not out.exists()
    (line,) = [line for line in outcome.err.splitlines() if not line.startswith("clouds: 0/")]
    return line


def table(out: Path) -> list[dict[str, str]]:
    """Read the table of measures in a report's folder."""
    with (out / "measures.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))
