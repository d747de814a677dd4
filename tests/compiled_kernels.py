"""Compile most numba kernels once, so that processes of the tests, which begin together, find them on disk.

python -m tests.compiled_kernels
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from recon.pipeline.film import RenderOptions
from recon.pipeline.job import ReconstructOptions
from recon.pipeline.reconstruct import reconstruct
from recon.pipeline.render import render
from recon.studio import SynthParameters, synthesise

METHODS = ReconstructOptions(depths=("id", "dr", "pm"), fusions=("fa", "fb"), colours=("vertices", "photographs"))


def main() -> None:
    """Go the whole way with the smallest recordings: one of a person, and one of a ball by every method of ours."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for scene in ("people", "ball"):
            synthesise(folder / scene, SynthParameters(scene, n_sensors=2, n_frames=1, size=(96, 72), noise=0.5))
        reconstruct(folder / "ball", folder / "run", METHODS)
        render([folder / "run"], folder / "set", RenderOptions(size=(64, 48), seconds=0.1, renderer="software"))


if __name__ == "__main__":
    main()
