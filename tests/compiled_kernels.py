"""Compile most numba kernels once: set-up does it, so that no command waits for it, nor processes of the tests.

python -m tests.compiled_kernels
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

from recon.cli.console import ProgressLine
from recon.pipeline.film import RenderOptions
from recon.pipeline.job import ReconstructOptions
from recon.pipeline.reconstruct import reconstruct
from recon.pipeline.render import render
from recon.studio import SynthParameters, synthesise

METHODS = ReconstructOptions(depths=("id", "dr", "pm"), fusions=("fa", "fb"), colours=("vertices", "photographs"))


def steps(folder: Path) -> list[Callable[[], object]]:
    """Go the whole way with the smallest recordings: one of a person, and one of a ball by every method of ours."""
    ball, person = (
        partial(synthesise, folder / scene, SynthParameters(scene, n_sensors=2, n_frames=1, size=(96, 72), noise=0.5))
        for scene in ("ball", "people")
    )
    film = RenderOptions(size=(64, 48), seconds=0.1, renderer="software")
    return [
        ball,
        person,
        partial(reconstruct, folder / "ball", folder / "run", METHODS),
        partial(render, [folder / "run"], folder / "set", film),
    ]


def main() -> None:
    """Compile, and say how far it is."""
    with tempfile.TemporaryDirectory() as name, ProgressLine() as progress:
        todo = steps(Path(name))
        progress("setup: compiling kernels, once", 0, len(todo))
        for done, step in enumerate(todo, start=1):
            step()
            progress("setup: compiling kernels, once", done, len(todo))


if __name__ == "__main__":
    main()
