"""Settings that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from recon.commands.setting import FRAME_RANGE, NAME, Setting

FRAMES = Setting(
    "A:B for the frames A to B-1; default: all.",
    label="Frames",
    note="A:B for the frames A to B-1; empty: all",
    form=FRAME_RANGE,
    example="0:25",
)
PRACTICE = Setting("", label="Scene for practice", note="one with two films; empty: none", form=NAME, example="box")
WORKERS = Setting("Local processes with one thread each; 1: this process with all cores.")
CLUSTER = Setting(
    "Let the workers of this Dask scheduler do the work, tcp://HOST:8786; they need the same folders or URLs."
)
DEVICE = Setting("Where id, dr and pm match: cpu, or gpu, with the same disparities.")
METHODS = Setting("TOML file of further methods: variants of ours, and other programs.")
APPROACHES = Setting("Further approaches beside these combinations, comma-separated: sgm_fb,pm_poisson.")

Workers = Annotated[int, WORKERS, Field(ge=1)]
Cluster = Annotated[str | None, CLUSTER]
Device = Annotated[Literal["cpu", "gpu"], DEVICE]
Methods = Annotated[Path | None, METHODS]
Approaches = Annotated[str, APPROACHES]


def out(meaning: str) -> Setting:
    """Return the setting of where a command writes."""
    return Setting(meaning, flags=("--out", "-o"))
