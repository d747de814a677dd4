"""Record the scenes, reconstruct them, and render the videos."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from shutil import rmtree

from app.experiment.reconstruction.folder import Experiment
from recon.capture.format import CAPTURE_FILE, read_capture
from recon.capture.masks.segment import segment_capture
from recon.models.scene_file import SCENE_FILE
from recon.pipeline.film import RenderOptions
from recon.pipeline.reconstruct import reconstruct
from recon.pipeline.render import render
from recon.runtime.artefacts import Artefacts, code_version
from recon.runtime.workers import Progress
from recon.studio import SynthParameters, synthesise
from recon.studio.truth_models import TRUTH, write_truth_models

RECORDING = ("capture", "studio", "geometry")


def record(experiment: Experiment, name: str, parameters: SynthParameters, progress: Progress) -> None:
    """Make a synthetic recording with its masks, unless it is there.

    Parameters
    ----------
    experiment, name : where it goes
    parameters : what to record
    progress : told after each frame
    """
    folder = experiment.capture(name)

    def write(_path: Path) -> None:
        rmtree(folder, ignore_errors=True)
        synthesise(folder, parameters, progress=progress)
        segment_capture(folder, progress=progress)

    key = {"parameters": asdict(parameters), "code": code_version(*RECORDING)}
    Artefacts(experiment.out).make(f"captures/{name}/{CAPTURE_FILE}", key, write)


def reconstruct_scene(experiment: Experiment, scene: str, progress: Progress) -> None:
    """Make the models of a scene by every approach.

    Parameters
    ----------
    experiment, scene : whose recording is there
    progress : told after each file
    """
    reconstruct(experiment.capture(scene), experiment.run(scene), experiment.made, progress)


def render_scenes(experiment: Experiment, progress: Progress) -> None:
    """Render the videos, and one of the truth of each scene for `compare_films`; write their manifest."""
    scale = experiment.scale
    options = RenderOptions(
        scale.video_size,
        scale.video_fps,
        scale.seconds,
        loop="repeat",
        workers=experiment.workers,
        cluster=experiment.cluster,
    )
    folders = [folder for name in scale.scenes for folder in (experiment.run(name), _lay_out_truth(experiment, name))]
    render([*folders, *experiment.models], experiment.stimuli, options, progress)


def _lay_out_truth(experiment: Experiment, scene: str) -> Path:
    """Make the true meshes of a scene the models of the approach `truth`, unless they are; returns their folder."""
    folder = experiment.out / TRUTH / scene

    def write(_path: Path) -> None:
        rmtree(folder, ignore_errors=True)
        write_truth_models(read_capture(experiment.capture(scene)), folder)

    artefacts = Artefacts(experiment.out)
    recording = artefacts.digest(f"captures/{scene}/{CAPTURE_FILE}")
    artefacts.make(f"{TRUTH}/{scene}/{SCENE_FILE}", {"recording": recording, "code": code_version(*RECORDING)}, write)
    return folder
