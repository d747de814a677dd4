"""The experiment's folder: its options, where everything goes, and reports that are made once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.experiment.reconstruction.scale import Scale
from recon.depth import CPU
from recon.methods.approaches import DEPTH_METHODS, VERTICES, Approach
from recon.pipeline.job import FEW, PACKED, ReconstructOptions
from recon.pipeline.sources import Source, read_sources
from recon.runtime.artefacts import Artefacts, code_version
from recon.validation.page import REPORT

SEED = 1
MEASURING = ("validation", "render", "surface", "cloud.py", "fusion", "geometry")
Artefact = tuple[Path, str]  # a run, and the name of a file in it


@dataclass(frozen=True)
class Experiment:
    """The experiment in a folder.

    Parameters
    ----------
    out : where everything goes
    scale : how large it is
    further, colours : approaches besides the paper's, as in `ReconstructOptions`
    models : folders of models of its scenes by other programs, each with a scene.json
    workers, cluster, device : as in `ReconstructOptions`
    """

    out: Path
    scale: Scale
    further: tuple[Approach, ...] = ()
    colours: tuple[str, ...] = (VERTICES,)
    models: tuple[Path, ...] = ()
    workers: int = 1
    cluster: str | None = None
    device: str = CPU

    @property
    def stimuli(self) -> Path:
        return self.out / "stimuli"

    @property
    def made(self) -> ReconstructOptions:
        """What is made of each scene."""
        return ReconstructOptions(
            depths=DEPTH_METHODS,
            further=self.further,
            colours=self.colours,
            clouds=FEW,
            meshes=PACKED,
            agreement=False,  # as the paper, and without outlines, too
            outlines=False,
            workers=self.workers,
            cluster=self.cluster,
            device=self.device,
        )

    def capture(self, name: str) -> Path:
        return self.out / "captures" / name

    def run(self, name: str) -> Path:
        return self.out / "runs" / name

    def report(self, name: str) -> Path:
        return self.out / "validation" / name

    def models_of(self, scene: str) -> list[Source]:
        """Read which models of a scene other programs made."""
        return [source for source in read_sources(self.models) if source.dataset == scene]


def make_report(
    experiment: Experiment,
    name: str,
    inputs: Sequence[Artefact],
    settings: dict[str, Any],
    write: Callable[[Path], None],
) -> None:
    """Write a validation report, unless it is there and of the same inputs.

    Parameters
    ----------
    experiment : whose folder gets it
    name : of its folder in validation/
    inputs : the files that it compares
    settings : what else it depends on, besides the code
    write : makes it at the path given
    """
    digests = [Artefacts(run).digest(artefact) for run, artefact in inputs]
    key = {"inputs": digests, "settings": settings, "code": code_version(*MEASURING)}
    Artefacts(experiment.out).make(f"validation/{name}/{REPORT}", key, write)
