"""Settings that several commands share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from recon.cli.commands.setting import FRAME_RANGE, NAME, option

FRAMES: Mapping[str, Any] = {"label": "Frames", "form": FRAME_RANGE, "example": "0:25"}
PRACTICE: Mapping[str, Any] = {"label": "Scene for practice", "form": NAME, "example": "box"}
WORKERS = option(1, "Local processes with one thread each; 1: this process with all cores.", ge=1)
CLUSTER = option(
    None, "Let the workers of this Dask scheduler do the work, tcp://HOST:8786; they need the same folders or URLs."
)
DEVICE = option("cpu", "Where id, dr and pm match: cpu, or gpu, with the same disparities.")
METHODS = option(None, "TOML file of further methods: variants of ours, and other programs.")
APPROACHES = option("", "Further approaches beside these combinations, comma-separated: sgm_fb,pm_poisson.")
