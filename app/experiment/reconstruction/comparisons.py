"""Compare models and videos with photographs and with the truth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

from app.experiment.reconstruction.folder import SEED, Artefact, Experiment, make_report
from recon.geometry.mesh import Mesh
from recon.geometry.mesh_files import write_mesh
from recon.methods.approaches import Approach, parse_approach
from recon.models.read import ReadModel, read_model
from recon.pipeline.manifest import MANIFEST
from recon.pipeline.run import mesh_name, read_run
from recon.runtime.artefacts import Artefacts
from recon.runtime.files import read_json, write_json
from recon.runtime.workers import Progress
from recon.studio.truth import MESH as TRUE_MESH
from recon.studio.truth_models import TRUTH
from recon.validation.cloud_quality import CloudSettings, Sampling, find_compared, measure_clouds
from recon.validation.cloud_quality.report import write_cloud_report
from recon.validation.films.evaluation import FilmSettings, measure_films
from recon.validation.films.report import write_films_report
from recon.validation.measures import Subject
from recon.validation.truth.evaluation import MeshSettings, measure_mesh
from recon.validation.views.evaluation import ViewSettings, measure_views
from recon.validation.views.report import write_views_report

MESH_THRESHOLDS = tuple(float(mm) for mm in range(1, 21))
MESH_THRESHOLD = 5.0  # mm, of the F-score that is compared with the votes
CLOUD_MEASURES = ("d1", "pointssim")
CLOUD_DENSITY = 0.01  # samples per mm^2 of the meshes, about 20 000 on a person
CLOUD_PEAK = 1000.0  # mm, of the PSNR of D1, the same for all scenes
FILM_STEP = 3  # every third frame is measured; in `small` a model stays for five


def compare_views(experiment: Experiment, progress: Progress) -> None:
    """Compare every model of the first frame with the photographs that were held out of it."""
    for scene in experiment.scale.scenes:
        _compare_scene(experiment, scene, progress)


def _compare_scene(experiment: Experiment, scene: str, progress: Progress) -> None:
    run, others = experiment.run(scene), experiment.models_of(scene)
    settings = ViewSettings(frames=range(1), models=tuple(Path(source.setting.source) for source in others))

    def write(path: Path) -> None:
        report, shown = measure_views(run, settings, progress)
        write_views_report(report, shown, path.parent)

    models = [(run, mesh_name(approach, 0)) for approach in read_run(run).approaches]
    given = [read.digest for _, read in _first_models(experiment, scene)]  # with their textures
    make_report(experiment, f"views/{scene}", models, {"models": given} if given else {}, write)


def compare_truth(experiment: Experiment, progress: Progress) -> None:
    """Compare every model of the first frame with the true surface."""
    models = [(scene, *surface) for scene in experiment.scale.scenes for surface in surfaces(experiment, scene).items()]
    for number, (scene, name, (mesh, approaches)) in enumerate(models):
        progress("models", number, len(models))
        _compare_model(experiment, name, mesh, Subject(scene, approaches))
    progress("models", len(models), len(models))


def surfaces(experiment: Experiment, scene: str) -> dict[str, tuple[Artefact, tuple[str, ...]]]:
    """Return the first frame's surfaces by name, each with the approaches that have it: they may differ in colour."""
    run = experiment.run(scene)
    surfaces: dict[str, tuple[Artefact, tuple[str, ...]]] = {}
    for approach in read_run(run).approaches:
        parsed = parse_approach(approach)
        name = str(Approach(parsed.depth, parsed.fusion))
        _, others = surfaces.get(name, (None, ()))
        surfaces[name] = (run, mesh_name(name, 0)), (*others, approach)
    return surfaces | {name: (mesh, (name,)) for name, mesh in _placed_models(experiment, scene).items()}


def _compare_model(experiment: Experiment, name: str, mesh: Artefact, subject: Subject) -> None:
    run, file = mesh
    truth = experiment.capture(subject.dataset) / TRUE_MESH.format(frame=0)
    settings = MeshSettings(MESH_THRESHOLDS, MESH_THRESHOLD, subject, SEED)
    of_seen = replace(settings, capture=str(experiment.capture(subject.dataset)))

    def write(path: Path) -> None:
        write_json(path, measure_mesh(run / file, truth, of_seen))

    make_report(
        experiment, f"truth/{subject.dataset}_{name}", [mesh], asdict(settings) | {"counts": "what sensors see"}, write
    )


def _placed_models(experiment: Experiment, scene: str) -> dict[str, Artefact]:
    """Write the first model of other programs' approaches as it stands in the world; returns the files by approach."""
    artefacts, placed = Artefacts(experiment.out), {}
    for approach, read in _first_models(experiment, scene):
        if not isinstance(read.model, Mesh):
            raise ValueError(f"{approach}: its models of {scene} have points and no faces; expected meshes")
        name = f"models/{scene}/{approach}/0000.ply"
        artefacts.make(name, {"model": read.digest}, partial(_write_shape, mesh=replace(read.model, texture=None)))
        placed[approach] = (experiment.out, name)
    return placed


def _write_shape(path: Path, mesh: Mesh) -> None:
    write_mesh(path, mesh)


def _first_models(experiment: Experiment, scene: str) -> Iterator[tuple[str, ReadModel]]:
    """Read the first model of each approach by other programs."""
    for item in (item for source in experiment.models_of(scene) for item in source.sequences):
        assert item.placement is not None, "models of other programs have one"
        yield item.approach, read_model(item.files[0], item.placement)


def compare_clouds(experiment: Experiment, progress: Progress) -> None:
    """Compare every model of the first frame with the true surface, both sampled, by the measures of point clouds."""
    for scene in experiment.scale.scenes:
        _compare_clouds_of(experiment, scene, progress)


def _compare_clouds_of(experiment: Experiment, scene: str, progress: Progress) -> None:
    run, truth = experiment.run(scene), experiment.capture(scene) / TRUTH
    placed = list(_placed_models(experiment, scene).values())
    sampling = Sampling(CLOUD_DENSITY, SEED)
    settings = CloudSettings(measures=CLOUD_MEASURES, peak=CLOUD_PEAK, sampling=sampling)

    def write(path: Path) -> None:
        compared = find_compared([run, *((folder / name).parent for folder, name in placed)], truth, frames=range(1))
        write_cloud_report(measure_clouds(compared, settings, progress), path.parent)

    models = [*((run, mesh_name(approach, 0)) for approach in read_run(run).approaches), *placed]
    told = {"measures": CLOUD_MEASURES, "peak": CLOUD_PEAK, "sampling": asdict(sampling)}
    make_report(experiment, f"clouds/{scene}", models, told, write)


def compare_films(experiment: Experiment, progress: Progress) -> None:
    """Compare every video with that of the scene's true models."""
    settings = FilmSettings(TRUTH, every=FILM_STEP, workers=experiment.workers)

    def write(path: Path) -> None:
        write_films_report(*measure_films(experiment.stimuli, settings, progress), path.parent)

    stimuli = read_json(experiment.stimuli / MANIFEST)["stimuli"]
    films = [(experiment.stimuli, stimulus[name]) for stimulus in stimuli for name in ("video", "mask")]
    make_report(experiment, "films", films, {"reference": TRUTH, "every": FILM_STEP}, write)
