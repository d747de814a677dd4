"""The paper's experiment, as far as the stimulus set: recordings, models, videos, and what is measured of them.

Every step leaves files keyed by what they were made from, so that a second start makes only what is missing. The
study server goes on from the manifest and from `objective.json`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np

from recon.capture.format import CAPTURE_FILE
from recon.capture.masks.segment import segment_capture
from recon.depth import DEFAULTS
from recon.depth.census import RADIUS as CENSUS_RADIUS
from recon.depth.temporal import TemporalParameters
from recon.pipeline.film import RenderOptions
from recon.pipeline.reconstruct import ReconstructOptions, reconstruct, render
from recon.pipeline.run import cloud_name, mesh_name, read_run
from recon.storage.artefacts import Artefacts, code_version
from recon.storage.files import read_json, write_json
from recon.studio import SynthParameters, synthesise
from recon.studio.scenes import CUBOID_SIZE_MM, SPHERE_RADIUS_MM
from recon.studio.truth import MESH as TRUE_MESH
from recon.validation.clouds import named_clouds
from recon.validation.cuboid.evaluation import CuboidSettings, measure_cuboids
from recon.validation.cuboid.report import write_cuboid_report
from recon.validation.measures import Subject
from recon.validation.page import write_report_json
from recon.validation.sphere.evaluation import measure_spheres
from recon.validation.sphere.methods import SphereSettings
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
MESH_THRESHOLD = 5.0  # mm, of the F-score that is laid beside the votes
OBJECT_NOISE, OBJECT_CALIBRATION_PX = 3.0, 0.05  # grey levels and pixels: with none, every point is an inlier
REACH_MM = 220.0  # of a validation object's middle from that of the working volume, on each axis
SEED = 1
OBJECTIVE_FILE, REPORT = "objective.json", "report.json"
RECORDING = ("capture", "studio", "rig.py", "geometry")
MEASURING = ("validation", "render", "surface", "cloud.py", "fusion.py", "geometry", "rig.py")


@dataclass(frozen=True)
class Scale:
    """How large the experiment is.

    Parameters
    ----------
    size : (width, height) of the scenes' cameras, pixels; a standing person fills an upright picture
    object_size : of those that record the sphere and the cuboid
    n_frames, fps : of each scene's recording
    n_spheres, n_cuboids : placed objects
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
    def film_megapixels(self) -> float:
        """Of all frames of one video."""
        return self.video_size[0] * self.video_size[1] / 1e6 * round(self.seconds * self.video_fps)


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
    workers, cluster : who reconstructs and renders, as in `ReconstructOptions`
    """

    out: Path
    scale: Scale
    workers: int = 1
    cluster: str | None = None

    @property
    def stimuli(self) -> Path:
        return self.out / "stimuli"

    def capture(self, name: str) -> Path:
        return self.out / "captures" / name

    def run(self, name: str) -> Path:
        return self.out / "runs" / name

    def report(self, name: str) -> Path:
        return self.out / "validation" / name


Artefact = tuple[Path, str]  # a run and what of it
Step = tuple[str, float, Callable[[Progress], None]]  # name, expected seconds, what to do


def steps(of: Experiment, pace: float = 1.0) -> list[Step]:
    """What is to be done, in order.

    Parameters
    ----------
    pace : how many times as long as the machine that the costs were measured on this one takes
    """
    scale, costs = of.scale, expected_seconds(of.scale)
    planned: list[Step] = []
    for scene in SCENES:
        parameters = SynthParameters(scene=scene, n_frames=scale.n_frames, size=scale.size, fps=scale.fps, seed=SEED)
        planned.append((f"record {scene}", costs["record"], partial(record, of, scene, parameters)))
        planned.append((f"reconstruct {scene}", costs["reconstruct"], partial(reconstruct_scene, of, scene)))
    planned += [
        ("render the videos", costs["render"], partial(render_scenes, of)),
        ("measure the sphere", costs["sphere"], partial(measure_sphere, of)),
        ("measure the cuboid", costs["cuboid"], partial(measure_cuboid, of)),
        ("compare with photographs", costs["views"], partial(compare_views, of)),
        ("compare with the truth", costs["truth"], partial(compare_truth, of)),
        ("write down what was measured", 0.1, partial(write_objective, of)),
    ]
    return [(name, pace * seconds, do) for name, seconds, do in planned]


# Seconds on two idle cores of 2026, from the processor time of `small`: a fixed part for each piece of work, and one
# that grows with its megapixels (of all cameras, or of the video).
RECORD_S, RECORD_MPX_S = 2.0, 0.7
MATCH_MPX_S, MESH_MPX_S = 7.0, 3.0
RENDER_MPX_S = 0.06
OBJECT_S, OBJECT_MPX_S = 1.2, 0.8
CUBOID_S = 3.0  # more for each than a sphere: its report's faces and pictures
VIEWS_S, VIEWS_MPX_S = 1.5, 1.5
TRUTH_S = 2.0
N_APPROACHES = 6


def expected_seconds(scale: Scale) -> dict[str, float]:
    """About how long each kind of step takes on two cores."""
    camera = scale.size[0] * scale.size[1] / 1e6
    seen = len(SENSORS) * camera  # megapixels of all sensors' left pictures
    of_object = len(SENSORS) * scale.object_size[0] * scale.object_size[1] / 1e6
    one_object = OBJECT_S + OBJECT_MPX_S * of_object
    return {
        "record": RECORD_S + scale.n_frames * 2 * seen * RECORD_MPX_S,
        "reconstruct": scale.n_frames * seen * (MATCH_MPX_S + MESH_MPX_S),
        "render": len(SCENES) * N_APPROACHES * scale.film_megapixels * RENDER_MPX_S,
        "sphere": scale.n_spheres * one_object,
        "cuboid": scale.n_cuboids * (one_object + CUBOID_S),
        "views": len(SCENES) * (VIEWS_S + VIEWS_MPX_S * seen),
        "truth": len(SCENES) * N_APPROACHES * TRUTH_S,
    }


def measured_pace(progress: Progress = no_progress) -> float:
    """How many times as long as expected this machine takes, from one frame of a scene and some of its video."""
    tiny = Scale((180, 320), (64, 64), 1, 5.0, 1, 1, (960, 540), 25.0, 0.4)
    with TemporaryDirectory() as folder:
        for is_warm in (False, True):  # the first pass compiles
            probe = Experiment(Path(folder) / str(is_warm), tiny)
            started = perf_counter()
            record(probe, "ball", SynthParameters(scene="ball", n_frames=1, size=tiny.size, fps=tiny.fps), progress)
            reconstruct_scene(probe, "ball", progress)
            options = RenderOptions(tiny.video_size, tiny.video_fps, tiny.seconds)
            render([probe.run("ball")], probe.stimuli, options, progress)
            seconds = perf_counter() - started
    costs = expected_seconds(tiny)
    return seconds / (costs["record"] + costs["reconstruct"] + costs["render"] / len(SCENES))


def record(of: Experiment, name: str, parameters: SynthParameters, progress: Progress) -> None:
    """A synthetic recording with its masks, unless it is there."""
    folder = of.capture(name)

    def write(_path: Path) -> None:
        rmtree(folder, ignore_errors=True)
        synthesise(folder, parameters, progress=progress)
        segment_capture(folder, progress=progress)

    key = {"parameters": asdict(parameters), "code": code_version(*RECORDING)}
    Artefacts(of.out).make(f"captures/{name}/{CAPTURE_FILE}", key, write)


def reconstruct_scene(of: Experiment, scene: str, progress: Progress) -> None:
    """Models of a scene by every approach."""
    options = ReconstructOptions(workers=of.workers, cluster=of.cluster)
    reconstruct(of.capture(scene), of.run(scene), options, progress)


def render_scenes(of: Experiment, progress: Progress) -> None:
    """The thirty videos and their manifest."""
    scale = of.scale
    options = RenderOptions(
        scale.video_size, scale.video_fps, scale.seconds, loop="repeat", workers=of.workers, cluster=of.cluster
    )
    render([of.run(scene) for scene in SCENES], of.stimuli, options, progress)


def measure_sphere(of: Experiment, progress: Progress) -> None:
    """The sphere at many places: figures 5 and 6, table 4."""
    clouds = list(_object_clouds(of, "sphere", of.scale.n_spheres, progress))
    subject = Subject(approaches=(f"{OBJECT_METHOD}_fa", f"{OBJECT_METHOD}_fb"))
    settings = SphereSettings(SPHERE_RADIUS_MM, THRESHOLDS, subject=subject, seed=SEED)

    def write(path: Path) -> None:
        report = measure_spheres(named_clouds([run / name for run, name in clouds], SENSORS), settings, progress)
        write_sphere_report(report, path.parent)

    _measured(of, "sphere", clouds, asdict(settings), write)


def measure_cuboid(of: Experiment, progress: Progress) -> None:
    """The cuboid at several places."""
    clouds = list(_object_clouds(of, "cuboid", of.scale.n_cuboids, progress))
    settings = CuboidSettings(CUBOID_SIZE_MM, THRESHOLDS, seed=SEED)

    def write(path: Path) -> None:
        report, measured = measure_cuboids(
            named_clouds([run / name for run, name in clouds], SENSORS), settings, progress
        )
        write_cuboid_report(report, measured, path.parent)

    _measured(of, "cuboid", clouds, asdict(settings), write)


def _object_clouds(of: Experiment, kind: str, n: int, progress: Progress) -> Iterator[Artefact]:
    """Record and reconstruct a validation object at so many places; its clouds, sensor by sensor."""
    places = np.random.default_rng([SEED, n]).uniform(-REACH_MM, REACH_MM, (n, 3)).round(1)
    for number, place in enumerate(places):
        progress(f"placed {kind}s", number, n)
        x, y, z = place.tolist()
        name = f"{kind}_{number + 1:02d}"
        parameters = SynthParameters(
            scene=kind,
            n_frames=1,
            size=of.scale.object_size,
            seed=SEED,
            position=(x, y, z),
            noise=OBJECT_NOISE,
            calibration_error_px=OBJECT_CALIBRATION_PX,
        )
        record(of, name, parameters, no_progress)
        options = ReconstructOptions((OBJECT_METHOD,), ("fb",), workers=of.workers, cluster=of.cluster)
        reconstruct(of.capture(name), of.run(name), options)
        yield from ((of.run(name), cloud_name(OBJECT_METHOD, sensor, 0)) for sensor in SENSORS)
    progress(f"placed {kind}s", n, n)


def compare_views(of: Experiment, progress: Progress) -> None:
    """Every model of a frame that has held-out photographs, from where these were taken."""
    for scene in SCENES:
        models = [(of.run(scene), mesh_name(approach, 0)) for approach in read_run(of.run(scene)).approaches]

        def write(path: Path, scene: str = scene) -> None:
            report, shown = measure_views(of.run(scene), ViewSettings(frames=range(1)), progress)
            write_views_report(report, shown, path.parent)

        _measured(of, f"views/{scene}", models, {}, write)


def compare_truth(of: Experiment, progress: Progress) -> None:
    """Every model of the first frame against the true surface."""
    models = [(scene, approach) for scene in SCENES for approach in read_run(of.run(scene)).approaches]
    for number, (scene, approach) in enumerate(models):
        progress("models", number, len(models))
        run, name = of.run(scene), mesh_name(approach, 0)
        truth = of.capture(scene) / TRUE_MESH.format(frame=0)
        settings = MeshSettings(MESH_THRESHOLDS, MESH_THRESHOLD, Subject(scene, (approach,)), SEED)

        def write(path: Path, mesh: Path = run / name, truth: Path = truth, settings: MeshSettings = settings) -> None:
            write_report_json(path.parent, measure_mesh(mesh, truth, settings))

        _measured(of, f"truth/{scene}_{approach}", [(run, name)], asdict(settings), write)
    progress("models", len(models), len(models))


def _measured(
    of: Experiment, name: str, inputs: Sequence[Artefact], settings: dict[str, Any], write: Callable[[Path], None]
) -> None:
    """Write a validation report, unless it is there and of the same inputs."""
    digests = [Artefacts(run).digest(artefact) for run, artefact in inputs]
    key = {"inputs": digests, "settings": settings, "code": code_version(*MEASURING)}
    Artefacts(of.out).make(f"validation/{name}/{REPORT}", key, write)


def write_objective(of: Experiment, _progress: Progress) -> None:
    """What the study server has to know of all this besides the manifest."""
    reports = sorted(path.parent.relative_to(of.out).as_posix() for path in (of.out / "validation").rglob(REPORT))
    content = {
        "schema_version": 1,
        "scale": asdict(of.scale),
        "scenes": list(SCENES),
        "reports": reports,
        "parameters": {method: asdict(parameters) for method, parameters in DEFAULTS.items()},
        "census_window": 2 * CENSUS_RADIUS + 1,
        "temporal": asdict(TemporalParameters()),
        "n_points": _points(of),
    }
    write_json(of.out / OBJECTIVE_FILE, content)


def _points(of: Experiment) -> list[int]:
    """Points of each reconstructed sphere, all sensors together."""
    rows = read_json(of.report("sphere") / REPORT)["reconstructions"]
    samples = sorted({row["sample"] for row in rows})
    return [sum(row["n_points"] for row in rows if row["sample"] == sample) for sample in samples]
