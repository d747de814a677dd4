"""The paper's experiment up to its stimulus set: recordings, models, videos and measures.

Every step keeps what it made (`Artefacts`), so a second start makes only what is missing. `app.experiment` goes on from
the manifest and `objective.json`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from math import prod
from pathlib import Path
from shutil import rmtree
from typing import Any

import numpy as np

from recon.approaches import DEPTH_METHODS, VERTICES, Approach, check_colours, parse_approach
from recon.capture.format import CAPTURE_FILE, read_capture
from recon.capture.masks.segment import segment_capture
from recon.depth import CPU, DEFAULTS
from recon.depth.census import WINDOW
from recon.depth.temporal import TemporalParameters
from recon.geometry.mesh import Mesh
from recon.geometry.mesh_files import write_mesh
from recon.models.read import ReadModel, read_model
from recon.models.scene_file import SCENE_FILE
from recon.pipeline.film import RenderOptions
from recon.pipeline.job import ReconstructOptions
from recon.pipeline.manifest import MANIFEST
from recon.pipeline.methods import Methods
from recon.pipeline.reconstruct import reconstruct
from recon.pipeline.render import render
from recon.pipeline.run import View, mesh_name, read_run
from recon.pipeline.sources import Source, read_sources
from recon.storage.artefacts import Artefacts, code_version
from recon.storage.files import read_json, write_json
from recon.studio import SynthParameters, synthesise
from recon.studio.scenes import CUBOID_SIZE_MM, SPHERE_RADIUS_MM
from recon.studio.truth import MESH as TRUE_MESH
from recon.studio.truth_models import TRUTH, write_truth_models
from recon.validation.cloud_quality import CloudSettings, Sampling, find_compared, measure_clouds
from recon.validation.cloud_quality.report import write_cloud_report
from recon.validation.clouds import named_clouds
from recon.validation.cuboid.evaluation import CuboidSettings, measure_cuboids
from recon.validation.cuboid.report import write_cuboid_report
from recon.validation.films.evaluation import FilmSettings, measure_films
from recon.validation.films.report import write_films_report
from recon.validation.measures import Subject
from recon.validation.page import REPORT
from recon.validation.sphere.evaluation import measure_spheres
from recon.validation.sphere.model import SphereSettings
from recon.validation.sphere.report import write_sphere_report
from recon.validation.truth.evaluation import MeshSettings, measure_mesh
from recon.validation.views.evaluation import ViewSettings, measure_views
from recon.validation.views.report import write_views_report
from recon.workers import Progress, no_progress

SCENES = ("ball", "box", "people", "standing", "face")  # figure 2
SENSORS = ("S1", "S2", "S3")
OBJECT_METHOD = "dr"  # the paper's clouds of the sphere
THRESHOLDS = tuple(2.5 * step for step in range(1, 41))  # mm, figure 6
MESH_THRESHOLDS = tuple(float(mm) for mm in range(1, 21))
MESH_THRESHOLD = 5.0  # mm, of the F-score that is compared with the votes
OBJECT_NOISE, OBJECT_CALIBRATION_PX = 3.0, 0.05  # grey levels and pixels: with none, every point is an inlier
CLOUD_MEASURES = ("d1", "pointssim")
CLOUD_DENSITY = 0.01  # samples per mm^2 of the meshes, about 20 000 on a person
CLOUD_PEAK = 1000.0  # mm, of the PSNR of D1, the same for all scenes
FILM_STEP = 3  # every third frame is measured; in `small` a model stays for five
REACH_MM = 220.0  # how far an object's centre may be from that of the working volume, on each axis
SEED = 1
SCENE_BYTES, OBJECT_BYTES = 130, 35  # on disk, for each pixel of a frame: the paper's six approaches, and one
SCENE_US, OBJECT_US, FILM_US = 14.6, 7.6, 0.2  # on two idle cores, for each pixel of a frame, microseconds
FILMS_OF_SCENE = 7  # of the paper's six approaches, and of the true models
FURTHER_S = 340.0  # for 1 650 votes, comparisons and starting everything, at any scale
OBJECTIVE_FILE = "objective.json"
RECORDING = ("capture", "studio", "rig.py", "geometry")
MEASURING = ("validation", "render", "surface", "cloud.py", "fusion", "geometry", "rig.py")


@dataclass(frozen=True)
class Scale:
    """How large the experiment is.

    Parameters
    ----------
    size : (width, height) of the scenes' cameras, pixels; a standing person fills an upright picture
    object_size : of the cameras that record the sphere and the cuboid
    n_frames, fps : of each scene's recording
    n_spheres, n_cuboids : at how many places each is recorded
    video_size, video_fps, seconds : of the videos
    """

    size: tuple[int, int]
    object_size: tuple[int, int]
    n_frames: int
    fps: float
    n_spheres: int
    n_cuboids: int
    video_size: tuple[int, int]
    video_fps: float
    seconds: float

    @property
    def gigabytes(self) -> float:
        """What recordings and models take on the disk, as measured, by the paper's six approaches."""
        scenes, objects, _films = self._pixels
        return (scenes * SCENE_BYTES + objects * OBJECT_BYTES) / 1e9

    @property
    def hours(self) -> float:
        """How long all of it takes on two idle cores, as measured, by the paper's six approaches."""
        scenes, objects, films = self._pixels
        return ((scenes * SCENE_US + objects * OBJECT_US + films * FILM_US) / 1e6 + FURTHER_S) / 3600

    @property
    def _pixels(self) -> tuple[int, int, float]:
        """Count the pixels of one camera: of the scenes, of the objects, of all films with those of the truth."""
        scenes = len(SCENES) * self.n_frames * prod(self.size)
        objects = (self.n_spheres + self.n_cuboids) * prod(self.object_size)
        films = len(SCENES) * FILMS_OF_SCENE * self.video_fps * self.seconds * prod(self.video_size)
        return scenes, objects, films

    def resized(self, n_frames: int | None = None, seconds: float | None = None) -> Scale:
        """Record each scene in another number of frames of the same time, or make videos of another length."""
        frames = n_frames or self.n_frames
        fps = self.fps * frames / self.n_frames
        return replace(self, n_frames=frames, fps=fps, seconds=seconds or self.seconds)


SCALES = {
    "small": Scale((360, 640), (640, 640), 3, 5.0, 29, 3, (480, 270), 25.0, 3.0),
    "full": Scale((1080, 1920), (1440, 1440), 125, 25.0, 29, 12, (1920, 1080), 25.0, 15.0),
}


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
            outlines=False,  # as the paper
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


Artefact = tuple[Path, str]  # a run, and the name of a file in it
Step = tuple[str, Callable[[Progress], None]]  # a name, and what makes what is missing


def steps(experiment: Experiment) -> list[Step]:
    """List what is to be done, in order; a ValueError if models by other programs are not of all these scenes."""
    scale = experiment.scale
    check_colours(experiment.colours)
    Methods().check(
        tuple(approach.depth for approach in experiment.further),
        tuple(approach.fusion for approach in experiment.further),
    )
    _check_models(read_sources(experiment.models), [*map(str, experiment.made.models), TRUTH])
    planned: list[Step] = []
    for scene in SCENES:
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


def _check_models(sources: Sequence[Source], taken: Sequence[str]) -> None:
    """Check models by other programs, before hours of work; `taken` are the names of the experiment's approaches."""
    given: dict[str, set[str]] = {}
    for source in sources:
        if source.dataset not in SCENES:
            raise ValueError(f"{source.setting.source}: is of dataset {source.dataset}, expected {' or '.join(SCENES)}")
        for sequence in source.sequences:
            given.setdefault(sequence.approach, set()).add(source.dataset)
    for approach, scenes in given.items():
        if approach in taken:
            raise ValueError(f"{approach}: is an approach of the experiment itself; give the models another name")
        if missing := [scene for scene in SCENES if scene not in scenes]:
            those = ", ".join(sorted(scenes))
            raise ValueError(
                f"{approach}: has models of {those}, but none of {', '.join(missing)}; give a folder for each scene"
            )


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
    folders = [folder for scene in SCENES for folder in (experiment.run(scene), _lay_out_truth(experiment, scene))]
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


def measure_sphere(experiment: Experiment, progress: Progress) -> None:
    """Measure the sphere at many places: figures 5 and 6, table 4."""
    clouds = list(_object_clouds(experiment, "sphere", experiment.scale.n_spheres, progress))
    subject = Subject(approaches=(f"{OBJECT_METHOD}_fa", f"{OBJECT_METHOD}_fb"))
    settings = SphereSettings(SPHERE_RADIUS_MM, THRESHOLDS, "super4pcs", subject=subject, seed=SEED)

    def write(path: Path) -> None:
        files = named_clouds([run / name for run, name in clouds], SENSORS)
        write_sphere_report(*measure_spheres(files, settings, progress), path.parent)

    _make_report(experiment, "sphere", clouds, asdict(settings), write)


def measure_cuboid(experiment: Experiment, progress: Progress) -> None:
    """Measure the cuboid at several places."""
    clouds = list(_object_clouds(experiment, "cuboid", experiment.scale.n_cuboids, progress))
    settings = CuboidSettings(CUBOID_SIZE_MM, THRESHOLDS, seed=SEED)

    def write(path: Path) -> None:
        files = named_clouds([run / name for run, name in clouds], SENSORS)
        write_cuboid_report(*measure_cuboids(files, settings, progress), path.parent)

    _make_report(experiment, "cuboid", clouds, asdict(settings), write)


def _object_clouds(experiment: Experiment, kind: str, n: int, progress: Progress) -> Iterator[Artefact]:
    """Record and reconstruct a validation object at `n` places; yields its clouds, sensor by sensor."""
    places = np.random.default_rng([SEED, n]).uniform(-REACH_MM, REACH_MM, (n, 3)).round(1)
    for number, place in enumerate(places):
        progress(f"placed {kind}s", number, n)
        x, y, z = place.tolist()
        name = f"{kind}_{number + 1:02d}"
        parameters = SynthParameters(
            scene=kind,
            n_frames=1,
            size=experiment.scale.object_size,
            seed=SEED,
            position=(x, y, z),
            noise=OBJECT_NOISE,
            calibration_error_px=OBJECT_CALIBRATION_PX,
        )
        record(experiment, name, parameters, no_progress)
        options = ReconstructOptions(
            (OBJECT_METHOD,),
            ("fb",),
            outlines=False,
            workers=experiment.workers,
            cluster=experiment.cluster,
            device=experiment.device,
        )
        reconstruct(experiment.capture(name), experiment.run(name), options)
        yield from ((experiment.run(name), View(OBJECT_METHOD, sensor, 0).cloud) for sensor in SENSORS)
    progress(f"placed {kind}s", n, n)


def compare_views(experiment: Experiment, progress: Progress) -> None:
    """Compare every model of the first frame with the photographs that were held out of it."""
    for scene in SCENES:
        _compare_scene(experiment, scene, progress)


def _compare_scene(experiment: Experiment, scene: str, progress: Progress) -> None:
    run, others = experiment.run(scene), experiment.models_of(scene)
    settings = ViewSettings(frames=range(1), models=tuple(Path(source.setting.source) for source in others))

    def write(path: Path) -> None:
        report, shown = measure_views(run, settings, progress)
        write_views_report(report, shown, path.parent)

    models = [(run, mesh_name(approach, 0)) for approach in read_run(run).approaches]
    given = [read.digest for _, read in _first_models(experiment, scene)]  # with their textures
    _make_report(experiment, f"views/{scene}", models, {"models": given} if given else {}, write)


def compare_truth(experiment: Experiment, progress: Progress) -> None:
    """Compare every model of the first frame with the true surface."""
    models = [(scene, *surface) for scene in SCENES for surface in _surfaces(experiment, scene).items()]
    for number, (scene, name, (mesh, approaches)) in enumerate(models):
        progress("models", number, len(models))
        _compare_model(experiment, name, mesh, Subject(scene, approaches))
    progress("models", len(models), len(models))


def _surfaces(experiment: Experiment, scene: str) -> dict[str, tuple[Artefact, tuple[str, ...]]]:
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

    def write(path: Path) -> None:
        write_json(path, measure_mesh(run / file, truth, settings))

    _make_report(experiment, f"truth/{subject.dataset}_{name}", [mesh], asdict(settings), write)


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
    for scene in SCENES:
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
    _make_report(experiment, f"clouds/{scene}", models, told, write)


def compare_films(experiment: Experiment, progress: Progress) -> None:
    """Compare every video with that of the scene's true models."""
    settings = FilmSettings(TRUTH, every=FILM_STEP, workers=experiment.workers)

    def write(path: Path) -> None:
        write_films_report(*measure_films(experiment.stimuli, settings, progress), path.parent)

    stimuli = read_json(experiment.stimuli / MANIFEST)["stimuli"]
    films = [(experiment.stimuli, stimulus[name]) for stimulus in stimuli for name in ("video", "mask")]
    _make_report(experiment, "films", films, {"reference": TRUTH, "every": FILM_STEP}, write)


def _make_report(
    experiment: Experiment,
    name: str,
    inputs: Sequence[Artefact],
    settings: dict[str, Any],
    write: Callable[[Path], None],
) -> None:
    """Write a validation report, unless it is there and of the same inputs."""
    digests = [Artefacts(run).digest(artefact) for run, artefact in inputs]
    key = {"inputs": digests, "settings": settings, "code": code_version(*MEASURING)}
    Artefacts(experiment.out).make(f"validation/{name}/{REPORT}", key, write)


def write_objective(experiment: Experiment, _progress: Progress) -> None:
    """Write down, beside the manifest, what the study and the report need to know."""
    truth = [f"truth/{scene}_{name}" for scene in SCENES for name in _surfaces(experiment, scene)]
    scenes = [f"{kind}/{scene}" for kind in ("clouds", "views") for scene in SCENES]
    reports = sorted(f"validation/{name}" for name in ("cuboid", "films", "sphere", *scenes, *truth))
    content = {
        "schema_version": 1,
        "scale": asdict(experiment.scale),
        "scenes": list(SCENES),
        "levels": {
            stimulus["approach"]: stimulus["levels"]
            for stimulus in read_json(experiment.stimuli / MANIFEST)["stimuli"]
            if stimulus["approach"] != TRUTH
        },
        "reports": reports,
        "parameters": {method: asdict(DEFAULTS[method]) for method in DEPTH_METHODS},
        "census_window": WINDOW,
        "temporal": asdict(TemporalParameters()),
        "n_points": _points(experiment),
    }
    write_json(experiment.out / OBJECTIVE_FILE, content)


def _points(experiment: Experiment) -> list[int]:
    """Count the points of each reconstructed sphere, all sensors together."""
    rows = read_json(experiment.report("sphere") / REPORT)["reconstructions"]
    samples = sorted({row["sample"] for row in rows})
    return [sum(row["n_points"] for row in rows if row["sample"] == sample) for sample in samples]
