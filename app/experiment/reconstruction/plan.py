"""The experiment's steps in their order, and what the study and the report need to know of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial

from app.experiment.reconstruction.comparisons import (
    compare_clouds,
    compare_films,
    compare_truth,
    compare_views,
    surfaces,
)
from app.experiment.reconstruction.folder import SEED, Experiment
from app.experiment.reconstruction.objects import measure_cuboid, measure_sphere, sphere_imaging, sphere_points
from app.experiment.reconstruction.scenes import reconstruct_scene, record, render_scenes
from recon.depth import DEFAULTS
from recon.depth.matching.census import WINDOW
from recon.depth.temporal import TemporalParameters
from recon.methods.approaches import DEPTH_METHODS, check_colours
from recon.pipeline.manifest import MANIFEST
from recon.pipeline.methods import Methods
from recon.pipeline.sources import read_sources
from recon.runtime.files import read_json, write_json
from recon.runtime.workers import Progress
from recon.studio import SynthParameters
from recon.studio.truth_models import TRUTH

OBJECTIVE_FILE = "objective.json"
Step = tuple[str, Callable[[Progress], None]]  # a name, and what makes what is missing


def steps(experiment: Experiment) -> list[Step]:
    """List what is to be done, in order; a ValueError if models by other programs are not of all these scenes."""
    scale = experiment.scale
    check_colours(experiment.colours)
    Methods().check(
        tuple(approach.depth for approach in experiment.further),
        tuple(approach.fusion for approach in experiment.further),
    )
    _check_models(experiment, taken=[*map(str, experiment.made.models), TRUTH])
    planned: list[Step] = []
    for scene in scale.scenes:
        parameters = SynthParameters(scene=scene, n_frames=scale.n_frames, size=scale.size, fps=scale.fps, seed=SEED)
        planned.append((f"record {scene}", partial(record, experiment, scene, parameters)))
        planned.append((f"reconstruct {scene}", partial(reconstruct_scene, experiment, scene)))
    return [
        *planned,
        ("render the videos", partial(render_scenes, experiment)),
        ("measure the sphere", partial(measure_sphere, experiment)),
        ("measure the cuboid", partial(measure_cuboid, experiment)),
        ("compare with photographs", partial(compare_views, experiment)),
        ("compare with the truth", partial(compare_truth, experiment)),
        ("compare as clouds with the truth", partial(compare_clouds, experiment)),
        ("compare the videos with the truth's", partial(compare_films, experiment)),
        ("write down what was measured", partial(write_objective, experiment)),
    ]


def _check_models(experiment: Experiment, taken: Sequence[str]) -> None:
    """Check models by other programs, before hours of work; `taken` are the names of the experiment's approaches."""
    expected = experiment.scale.scenes
    given: dict[str, set[str]] = {}
    for source in read_sources(experiment.models):
        if source.dataset not in expected:
            raise ValueError(
                f"{source.setting.source}: is of dataset {source.dataset}, expected {' or '.join(expected)}"
            )
        for sequence in source.sequences:
            given.setdefault(sequence.approach, set()).add(source.dataset)
    for approach, scenes in given.items():
        if approach in taken:
            raise ValueError(f"{approach}: is an approach of the experiment itself; give the models another name")
        if missing := [scene for scene in expected if scene not in scenes]:
            those = ", ".join(sorted(scenes))
            raise ValueError(
                f"{approach}: has models of {those}, but none of {', '.join(missing)}; give a folder for each scene"
            )


def write_objective(experiment: Experiment, _progress: Progress) -> None:
    """Write down, beside the manifest, what the study and the report need to know."""
    shown = experiment.scale.scenes
    truth = [f"truth/{scene}_{name}" for scene in shown for name in surfaces(experiment, scene)]
    scenes = [f"{kind}/{scene}" for kind in ("clouds", "views") for scene in shown]
    reports = sorted(f"validation/{name}" for name in ("cuboid", "films", "sphere", *scenes, *truth))
    imaging = sphere_imaging(experiment.scale.object_size[0])
    content = {
        "schema_version": 1,
        "scale": asdict(experiment.scale),
        "scenes": list(shown),
        "levels": {
            stimulus["approach"]: stimulus["levels"]
            for stimulus in read_json(experiment.stimuli / MANIFEST)["stimuli"]
            if stimulus["approach"] != TRUTH
        },
        "reports": reports,
        "parameters": {method: asdict(DEFAULTS[method]) for method in DEPTH_METHODS},
        "census_window": WINDOW,
        "temporal": asdict(TemporalParameters()),
        "n_points": sphere_points(experiment),
        "sphere_imaging": imaging | {"defocus": dict(imaging["defocus"])},
    }
    write_json(experiment.out / OBJECTIVE_FILE, content)
