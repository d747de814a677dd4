"""Evaluation of a run without a true shape: agreement of its sensors' depths, and novel views against photographs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from recon.capture.format import Capture, read_capture
from recon.capture.recording import chosen_frames
from recon.cloud import CloudParameters
from recon.geometry.mesh import Discs, Mesh, measured_part
from recon.geometry.mesh_files import read_mesh
from recon.geometry.splats import Splats
from recon.methods.approaches import FUSION_METHODS, parse_approach
from recon.models.read import read_model
from recon.pipeline.run import RUN_FILE, Run, read_run, recorded_in
from recon.pipeline.sources import ModelSequence, read_sources
from recon.runtime.files import read_json
from recon.runtime.workers import Progress, no_progress
from recon.surface import SurfaceParameters
from recon.validation.measures import LESS, MORE, Subject, measure_rows
from recon.validation.views.between_sensors import cross_sensor_rows, depth_step
from recon.validation.views.novel_view import (
    HELD_OUT,
    Photograph,
    Rendering,
    has_truth,
    photographs,
    rendered,
    true_mesh,
    view_rows,
)

FLOOR = "true depth"
MEASURES = {  # column: name, direction, unit
    "psnr_db": ("novel view PSNR", MORE, "dB"),
    "psnr_object_db": ("novel view PSNR of the object", MORE, "dB"),
    "ssim": ("novel view SSIM", MORE, "share"),
    "gradient": ("novel view gradient similarity", MORE, "share"),
    "coverage": ("novel view coverage", MORE, "share"),
    "spill": ("novel view spill", LESS, "share"),
    "roughness": ("novel view rim roughness", LESS, "ratio"),
}


@dataclass(frozen=True)
class ViewSettings:
    """Options of the evaluation.

    Parameters
    ----------
    capture : folder of the recording; None for the place that the run names
    frames : of the run; None for all
    models : folders of models of the same scene by other programs, each with a scene.json
    threshold : mm, within which two sensors' depths agree; None for the depth of one pixel of disparity
    filled : whether filled holes of the run's models count
    """

    capture: Path | None = None
    frames: range | None = None
    models: tuple[Path, ...] = ()
    threshold: float | None = None
    filled: bool = True

    def __post_init__(self) -> None:
        if self.threshold is not None and not 0 < self.threshold < math.inf:
            raise ValueError(f"threshold is {self.threshold:g} mm, expected a length above 0")


@dataclass(frozen=True, eq=False)
class Comparison:
    """A photograph, and for each approach its rendering from the same place."""

    photograph: Photograph
    pictures: Mapping[str, Rendering]


def measure_views(
    folder: Path, settings: ViewSettings, progress: Progress = no_progress
) -> tuple[dict[str, Any], list[Comparison]]:
    """Compare a run with its sensors and photographs; returns the content of report.json, and pictures of a frame.

    Parameters
    ----------
    folder : of the run
    settings : options of the evaluation
    progress : called as work is done

    Raises
    ------
    ValueError
        If the folder is no run, its recording cannot be read or is of another scene, or it has none of the frames.
    """
    run = read_run(folder)
    capture = _capture(run, settings)
    frames = chosen_frames(folder, run.frames, settings.frames)
    threshold = settings.threshold or depth_step(run)
    others = _other_models(run, settings.models)
    sensors = cross_sensor_rows(run, frames, threshold)
    rows, shown = [], []
    wanted = list(photographs(capture, frames))
    for done, photograph in enumerate(wanted):
        progress("views", done, len(wanted))
        pictures = dict(_renderings(run, others, capture, photograph, filled=settings.filled))
        for approach, rendering in pictures.items():
            place = {"approach": approach, "view": photograph.name, "kind": photograph.kind, "frame": photograph.frame}
            rows += [place | row for row in view_rows(rendering, photograph)]
        if photograph.frame == frames[0]:
            shown.append(Comparison(photograph, pictures))
    progress("views", len(wanted), len(wanted))
    means = mean_rows(rows)
    agreement = _agreement(sensors)
    report = {
        "schema_version": 1,
        "kind": "views",
        "settings": {
            "run": str(folder),
            "dataset": run.dataset,
            "frames": frames,
            "threshold_mm": threshold,
            "filled": settings.filled,
            "has_floor": any(row["approach"] == FLOOR for row in rows),
        },
        "sensors": sensors,
        "agreement": agreement,
        "views": rows,
        "means": means,
    }
    return report | {"measures": _measures(run, means, agreement)}, shown


def mean_rows(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Average over views and frames for each approach, kind of view and region; values that are None are left out."""
    groups: dict[tuple[str, str, str], list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["kind"], row["region"], row["approach"]), []).append(row)
    return [
        {"kind": kind, "region": region, "approach": approach, "n_views": len(group)}
        | {column: _mean([row[column] for row in group]) for column in (*MEASURES, "back_faces")}
        for (kind, region, approach), group in sorted(groups.items(), key=lambda item: item[0][:2])
    ]


def _capture(run: Run, settings: ViewSettings) -> Capture:
    folder = settings.capture or recorded_in(run)
    advice = f"say where the recording of {run.dataset} is with --capture FOLDER"
    try:
        capture = read_capture(folder)
    except ValueError as error:
        raise ValueError(f"{error}; {advice}") from error
    if capture.name != run.dataset:
        raise ValueError(f"{folder}: is the recording of {capture.name}, the run is of {run.dataset}; {advice}")
    return capture


def _renderings(
    run: Run, others: Mapping[str, ModelSequence], capture: Capture, photograph: Photograph, *, filled: bool
) -> Iterator[tuple[str, Rendering]]:
    for approach in run.approaches:
        if photograph.frame not in run.frames_of(approach):
            continue
        mesh = _mesh(run.folder / run.mesh_name(approach, photograph.frame))
        yield approach, rendered(mesh if filled else measured_part(mesh), photograph.camera)
    for approach, sequence in others.items():
        number = 0 if sequence.is_still else run.frames.index(photograph.frame)
        model = _other_model(sequence, number)
        rendering = rendered(model, photograph.camera)
        inside_out = isinstance(model, Mesh) and _is_inside_out(model, capture)
        yield approach, rendering.turned() if inside_out else rendering
    if has_truth(capture, photograph.frame):
        yield FLOOR, rendered(_floor(run.folder, capture, photograph.frame), photograph.camera)


@lru_cache(maxsize=4)
def _is_inside_out(mesh: Mesh, capture: Capture) -> bool:
    """Whether a model of another program shows its sensors mostly what glTF, PLY and OBJ call the backs of faces."""
    seen = [rendered(mesh, stream.left.camera) for stream in capture.sensors]
    return sum(int(each.back.sum()) for each in seen) > sum(int(each.covered.sum()) for each in seen)


@lru_cache(maxsize=16)
def _mesh(path: Path) -> Mesh:
    return read_mesh(path)


def _other_models(run: Run, folders: Sequence[Path]) -> dict[str, ModelSequence]:
    """Return the models of other programs by approach; each has one for every frame of the run, or stands still."""
    others = {item.approach: item for source in read_sources(folders) for item in source.sequences}
    for name, item in others.items():
        place = item.files[0].parent
        if item.dataset != run.dataset:
            raise ValueError(f"{place}: is of dataset {item.dataset}, expected that of the run, {run.dataset}")
        if name in run.approaches:
            raise ValueError(f"{place}: the run has an approach {name} already; give this one another name")
        if len(item.files) != len(run.frames) and not item.is_still:
            raise ValueError(f"{place}: has {len(item.files)} models, expected {len(run.frames)}, one for each frame")
    return others


@lru_cache(maxsize=4)
def _other_model(sequence: ModelSequence, number: int) -> Mesh | Splats:
    assert sequence.placement is not None, "models of other programs have one"
    model = read_model(sequence.files[number], sequence.placement).model
    if isinstance(model, Discs):
        raise ValueError(
            f"{sequence.files[number]}: has points and no faces; expected a mesh or splats, to compare with photographs"
        )
    return model


@lru_cache(maxsize=2)
def _floor(folder: Path, capture: Capture, frame: int) -> Mesh:
    """Make the mesh from true depth, by the run's parameters and the fusion of its last approach; by FB if not ours."""
    run, options = read_run(folder), read_json(folder / RUN_FILE)["options"]
    fusion = parse_approach(run.approaches[-1]).fusion
    known = options.get("methods", {}).get("fusion", {})  # earlier runs knew ours alone
    used = known.get(fusion, {"method": fusion, "parameters": options["surface"]})
    if used.get("method") not in FUSION_METHODS:
        used = {"method": "fb", "parameters": options["surface"]}
    return true_mesh(
        capture,
        frame,
        used["method"],
        CloudParameters(**options["cloud"]),
        SurfaceParameters(**used["parameters"]),
        outlines=options.get("outlines", False),  # earlier runs had none
    )


def mean_agreement(
    rows: Sequence[Mapping[str, Any]], columns: Sequence[str] = ("agree", "in_front", "median_abs_mm")
) -> dict[str, Any]:
    """Average the agreement of sensors over rows, each weighted by the points it shares; None where none are shared."""
    shared = [row for row in rows if row["n_compared"]]
    weights = [row["n_compared"] for row in shared]
    means = {
        name: float(np.average([row[name] for row in shared], weights=weights)) if shared else None for name in columns
    }
    return {"n_compared": sum(weights)} | means


def _agreement(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Average over frames and pairs of sensors for each depth method."""
    methods = dict.fromkeys(row["depth"] for row in rows)
    return [{"depth": method} | mean_agreement([row for row in rows if row["depth"] == method]) for method in methods]


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _measures(
    run: Run, means: Sequence[Mapping[str, Any]], agreement: Sequence[Mapping[str, Any]]
) -> list[dict[str, Any]]:
    """List measures over the whole object, from held-out photographs where there are any, else from the sensors'."""
    kinds = {row["kind"] for row in means}
    kind = HELD_OUT if HELD_OUT in kinds else next(iter(kinds))
    rows = []
    for row in means:
        if (row["kind"], row["region"]) == (kind, "all") and row["approach"] != FLOOR:
            subject = Subject(run.dataset, (row["approach"],))
            for column, (name, direction, unit) in MEASURES.items():
                rows += measure_rows(subject, name, row[column], direction=direction, unit=unit)
    for row in agreement:
        approaches = tuple(approach for approach in run.approaches if parse_approach(approach).depth == row["depth"])
        subject = Subject(run.dataset, approaches)
        rows += measure_rows(subject, "sensors agree", row["agree"], direction=MORE, unit="share")
        rows += measure_rows(subject, "sensors apart", row["median_abs_mm"], direction=LESS, unit="mm")
    return rows
