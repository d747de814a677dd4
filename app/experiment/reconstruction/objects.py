"""Record, reconstruct and measure objects of known size: the sphere and the cuboid."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np

from app.experiment.reconstruction.folder import SEED, Artefact, Experiment, make_report
from app.experiment.reconstruction.scenes import record
from recon.pipeline.job import ReconstructOptions
from recon.pipeline.reconstruct import reconstruct
from recon.pipeline.run import View
from recon.runtime.files import read_json
from recon.runtime.workers import Progress, no_progress
from recon.studio import SynthParameters
from recon.studio.scenes import CUBOID_SIZE_MM, SPHERE_RADIUS_MM
from recon.validation.clouds import named_clouds
from recon.validation.cuboid.evaluation import CuboidSettings, measure_cuboids
from recon.validation.cuboid.report import write_cuboid_report
from recon.validation.measures import Subject
from recon.validation.page import REPORT
from recon.validation.sphere.evaluation import measure_spheres
from recon.validation.sphere.fit.model import SphereSettings
from recon.validation.sphere.report import write_sphere_report

SENSORS = ("S1", "S2", "S3")
OBJECT_METHOD = "dr"  # the paper's clouds of the sphere
THRESHOLDS = tuple(2.5 * step for step in range(1, 41))  # mm, figure 6
OBJECT_NOISE, OBJECT_CALIBRATION_PX = 3.0, 0.05  # grey levels and pixels: with none, every point is an inlier
REACH_MM = 220.0  # how far an object's centre may be from that of the working volume, on each axis


def measure_sphere(experiment: Experiment, progress: Progress) -> None:
    """Measure the sphere at many places: figures 5 and 6, table 4."""
    clouds = list(_object_clouds(experiment, "sphere", experiment.scale.n_spheres, progress))
    subject = Subject(approaches=(f"{OBJECT_METHOD}_fa", f"{OBJECT_METHOD}_fb"))
    settings = SphereSettings(SPHERE_RADIUS_MM, THRESHOLDS, "super4pcs", subject=subject, seed=SEED)

    def write(path: Path) -> None:
        files = named_clouds([run / name for run, name in clouds], SENSORS)
        write_sphere_report(*measure_spheres(files, settings, progress), path.parent)

    make_report(experiment, "sphere", clouds, asdict(settings), write)


def measure_cuboid(experiment: Experiment, progress: Progress) -> None:
    """Measure the cuboid at several places."""
    clouds = list(_object_clouds(experiment, "cuboid", experiment.scale.n_cuboids, progress))
    settings = CuboidSettings(CUBOID_SIZE_MM, THRESHOLDS, seed=SEED)

    def write(path: Path) -> None:
        files = named_clouds([run / name for run, name in clouds], SENSORS)
        write_cuboid_report(*measure_cuboids(files, settings, progress), path.parent)

    make_report(experiment, "cuboid", clouds, asdict(settings), write)


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
            agreement=False,
            outlines=False,
            workers=experiment.workers,
            cluster=experiment.cluster,
            device=experiment.device,
        )
        reconstruct(experiment.capture(name), experiment.run(name), options)
        yield from ((experiment.run(name), View(OBJECT_METHOD, sensor, 0).cloud) for sensor in SENSORS)
    progress(f"placed {kind}s", n, n)


def sphere_points(experiment: Experiment) -> list[int]:
    """Count the points of each reconstructed sphere, all sensors together."""
    rows = read_json(experiment.report("sphere") / REPORT)["reconstructions"]
    samples = sorted({row["sample"] for row in rows})
    return [sum(row["n_points"] for row in rows if row["sample"] == sample) for sample in samples]
