"""The commands of objective evaluation, mounted as `validate`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from recon.cli.console import JsonOption, ProgressLine, print_result
from recon.cli.options import WorkersOption, parse_frames, parse_names, parse_position, refuse_url
from recon.cli.validation_sentences import (
    cloud_sentences,
    cuboid_sentences,
    film_sentences,
    mesh_sentences,
    object_sentences,
    sphere_sentences,
    view_sentences,
)

EVERY_DATASET = "all"
DECIMALS = 9  # of thresholds, so that the third step of 0.1 is 0.3 as it is written
DatasetOption = Annotated[str, typer.Option(help="Scene of a study that the results are for; all: every scene.")]
ApproachOption = Annotated[
    list[str] | None, typer.Option(help="Approach of a study that the results are for, such as pm_fb; may be repeated.")
]


def _report_folder(context: typer.Context, parameter: typer.CallbackParam, out: Path) -> Path:
    """Refuse a URL, or a folder of somebody else's, before anything is measured."""
    from recon.validation.page import check_report_folder

    refuse_url(context, parameter, out)
    check_report_folder(out)
    return out


ReportOption = Annotated[
    Path, typer.Option("--out", "-o", file_okay=False, callback=_report_folder, help="Folder of the report.")
]
SensorsOption = Annotated[
    list[str] | None, typer.Option(help="Sensor of each cloud, in order; fewer names than clouds repeat.")
]
ThresholdsOption = Annotated[str, typer.Option(help="Thresholds of the inlier curve, mm: FROM:TO or FROM:TO:STEP.")]
SeedOption = Annotated[
    int, typer.Option(min=0, help="Seed of the random samples; the same seed gives the same report.")
]
UnitOption = Annotated[str, typer.Option(help="Unit of PLY, OBJ and text: mm, cm, m or in.")]

app = typer.Typer(
    no_args_is_help=True,
    help="Measure reconstructions: known objects, true meshes, clouds, sensors against each other, views, films.",
)


@app.command("sphere")
def validate_sphere(
    clouds: Annotated[
        list[Path], typer.Argument(help="PLY, OBJ, glTF, or text with x y z; one file per sensor and placed ball.")
    ],
    radius: Annotated[float, typer.Option(help="Radius of the ball, mm.")],
    out: ReportOption,
    sensor: SensorsOption = None,
    method: Annotated[str, typer.Option(help="How to find the sphere: robust or super4pcs.")] = "robust",
    thresholds: ThresholdsOption = "5:100",
    unit: UnitOption = "mm",
    viewpoint: Annotated[
        list[str] | None,
        typer.Option(help="[SENSOR=]x,y,z of a sensor, mm; then only points in front of or behind the ball count."),
    ] = None,
    keep: Annotated[list[str] | None, typer.Option(help="SAMPLE/SENSOR to use although the rule excludes it.")] = None,
    drop: Annotated[
        list[str] | None, typer.Option(help="SAMPLE/SENSOR to leave out although the rule keeps it.")
    ] = None,
    reference_centre: Annotated[
        list[Path] | None,
        typer.Option(
            help="Another instrument's scan of the ball, such as a LiDAR's, once per placed ball in order; or one text "
            "file with a centre x y z a line."
        ),
    ] = None,
    reference_unit: Annotated[str, typer.Option(help="Unit of the reference: mm, cm, m or in.")] = "mm",
    reference_frame: Annotated[
        str, typer.Option(help="own: the reference has a frame of its own, which is estimated; sensors: the clouds'.")
    ] = "own",
    dataset: DatasetOption = EVERY_DATASET,
    approach: ApproachOption = None,
    seed: SeedOption = 1,
    as_json: JsonOption = False,
) -> None:
    """Fit spheres of known radius, and report signed errors and inlier ratios per sensor and combined."""
    from recon.validation.clouds import named_clouds
    from recon.validation.measures import Subject
    from recon.validation.sphere.evaluation import measure_spheres
    from recon.validation.sphere.fit.model import ReferenceSettings, SphereSettings
    from recon.validation.sphere.report import write_sphere_report

    settings = SphereSettings(
        radius=radius,
        thresholds=parse_thresholds(thresholds),
        method=method,
        unit=unit,
        viewpoints=parse_viewpoints(viewpoint or ()),
        keep=tuple(keep or ()),
        drop=tuple(drop or ()),
        reference=ReferenceSettings(tuple(reference_centre), reference_unit, reference_frame)
        if reference_centre
        else None,
        subject=Subject(dataset, tuple(approach or ())),
        seed=seed,
    )
    progress = ProgressLine()
    report, pictured = measure_spheres(named_clouds(clouds, sensor or ()), settings, progress)
    progress.close()
    page = write_sphere_report(report, pictured, out)
    print_report(report, page, sphere_sentences(report), as_json=as_json)


@app.command("cuboid")
def validate_cuboid(
    clouds: Annotated[
        list[Path], typer.Argument(help="PLY, OBJ, glTF, or text with x y z; one file per sensor and placed cuboid.")
    ],
    size: Annotated[str, typer.Option(help="The cuboid's edges in mm, AxBxC.")],
    out: ReportOption,
    sensor: SensorsOption = None,
    position: Annotated[
        list[str] | None, typer.Option(help="x,y,z of the cuboid's centre in mm, if it is known; once per sample.")
    ] = None,
    thresholds: ThresholdsOption = "5:100",
    unit: UnitOption = "mm",
    dataset: DatasetOption = EVERY_DATASET,
    approach: ApproachOption = None,
    seed: SeedOption = 1,
    as_json: JsonOption = False,
) -> None:
    """Fit cuboids of known size, and report planes, angles, edges and positions per sensor and combined."""
    from recon.validation.clouds import named_clouds
    from recon.validation.cuboid.evaluation import CuboidSettings, measure_cuboids
    from recon.validation.cuboid.report import write_cuboid_report
    from recon.validation.measures import Subject

    settings = CuboidSettings(
        size=parse_edges(size),
        thresholds=parse_thresholds(thresholds),
        unit=unit,
        positions=tuple(parse_position(text) for text in position or ()),
        subject=Subject(dataset, tuple(approach or ())),
        seed=seed,
    )
    progress = ProgressLine()
    report, measured = measure_cuboids(named_clouds(clouds, sensor or ()), settings, progress)
    progress.close()
    page = write_cuboid_report(report, measured, out)
    print_report(report, page, cuboid_sentences(report), as_json=as_json)


@app.command("object")
def validate_object(
    model: Annotated[Path, typer.Argument(help="The known object's mesh: PLY, OBJ or glTF.")],
    cloud: Annotated[Path, typer.Argument(help="Reconstruction of the object: PLY, OBJ, glTF, or text with x y z.")],
    out: ReportOption,
    thresholds: ThresholdsOption = "5:100",
    delta: Annotated[
        float | None,
        typer.Option(help="How far from the model points may lie during the search, mm; default: 2 % of its diagonal."),
    ] = None,
    trim: Annotated[float, typer.Option(help="Share of the points, nearest first, that the refinement uses.")] = 0.8,
    unit: UnitOption = "mm",
    model_unit: Annotated[str, typer.Option(help="Unit of the model: mm, cm, m or in.")] = "mm",
    dataset: DatasetOption = EVERY_DATASET,
    approach: ApproachOption = None,
    seed: SeedOption = 1,
    as_json: JsonOption = False,
) -> None:
    """Find a known mesh in a cloud, and report signed distances and inlier ratios."""
    from recon.validation.known_object.evaluation import ObjectSettings, measure_object
    from recon.validation.known_object.registration import RegistrationParameters
    from recon.validation.known_object.report import write_object_report
    from recon.validation.measures import Subject

    settings = ObjectSettings(
        thresholds=parse_thresholds(thresholds),
        registration=RegistrationParameters(delta=delta, trim=trim, seed=seed),
        unit=unit,
        model_unit=model_unit,
        subject=Subject(dataset, tuple(approach or ())),
    )
    report, measured = measure_object(model, cloud, settings)
    page = write_object_report(report, measured, out)
    print_report(report, page, object_sentences(report), as_json=as_json)


@app.command("views")
def validate_views(
    run: Annotated[Path, typer.Argument(help="Folder of a run.")],
    out: ReportOption,
    capture: Annotated[
        Path | None, typer.Option(help="Folder of the recording; default: where the run says it was.")
    ] = None,
    frames: Annotated[str | None, typer.Option(help="A:B for the frames A to B-1; default: all of the run.")] = None,
    models: Annotated[
        list[Path] | None,
        typer.Option(help="Folder of models of the scene by another program, with a scene.json; once for each."),
    ] = None,
    threshold: Annotated[
        float | None,
        typer.Option(help="Depths of two sensors agree within this, mm; default: the depth of one pixel of disparity."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Compare sensors with each other, and models with held-out and with the sensors' own photographs."""
    from recon.validation.views.evaluation import ViewSettings, measure_views
    from recon.validation.views.report import write_views_report

    progress = ProgressLine()
    report, shown = measure_views(
        run, ViewSettings(capture, parse_frames(frames), tuple(models or ()), threshold), progress
    )
    progress.close()
    page = write_views_report(report, shown, out)
    print_report(report, page, view_sentences(report), as_json=as_json)


@app.command("mesh")
def validate_mesh(
    mesh: Annotated[Path, typer.Argument(help="Mesh or cloud: PLY, OBJ or glTF; mm.")],
    truth: Annotated[Path, typer.Option(help="True mesh or cloud, in the same coordinates: PLY, OBJ or glTF.")],
    out: ReportOption,
    thresholds: Annotated[str, typer.Option(help="Thresholds of the F-score, mm: FROM:TO or FROM:TO:STEP.")] = "1:20:1",
    threshold: Annotated[
        float | None, typer.Option(help="The threshold whose F-score counts as a measure; default: the middle one.")
    ] = None,
    dataset: DatasetOption = EVERY_DATASET,
    approach: ApproachOption = None,
    cell: Annotated[
        float | None,
        typer.Option(help="Compare means of points in cells of this size, mm, as Tanks and Temples does."),
    ] = None,
    voxel: Annotated[float, typer.Option(help="Size of the voxels over which ETH3D averages, mm.")] = 10.0,
    scanner: Annotated[
        str | None,
        typer.Option(
            help="x,y,z in mm from where the truth was scanned; ETH3D then counts what was visible from there."
        ),
    ] = None,
    seed: SeedOption = 1,
    as_json: JsonOption = False,
) -> None:
    """Report accuracy, completeness and F-score against the truth."""
    from recon.validation.measures import Subject
    from recon.validation.truth.evaluation import MeshSettings, measure_mesh
    from recon.validation.truth.report import write_mesh_report

    subject = Subject(dataset, tuple(approach or ()))
    place = None if scanner is None else parse_position(scanner)
    settings = MeshSettings(parse_thresholds(thresholds), threshold, subject, seed, cell, voxel, place)
    report = measure_mesh(mesh, truth, settings)
    page = write_mesh_report(report, out)
    print_report(report, page, mesh_sentences(report), as_json=as_json)


@app.command("cloud")
def validate_cloud(
    clouds: Annotated[
        list[Path],
        typer.Argument(
            help="For each approach a cloud or mesh (PLY, OBJ, glTF), or a folder of one for every frame; or a run."
        ),
    ],
    reference: Annotated[
        Path, typer.Option(help="The reference (PLY, OBJ, glTF), or its folder of frames, such as CAPTURE/truth.")
    ],
    out: ReportOption,
    approach: Annotated[
        list[str] | None,
        typer.Option(help="Approach that a cloud belongs to, once for each in order; default: the cloud's name."),
    ] = None,
    dataset: Annotated[
        str | None, typer.Option(help="Scene of a study that the clouds show; default: the run's, else all.")
    ] = None,
    frames: Annotated[
        str | None, typer.Option(help="A:B for the frames A to B-1; default: all that are shared.")
    ] = None,
    measures: Annotated[
        str | None,
        typer.Option(help="Only these: d1, d2, chamfer, f_score, colour, pointssim, or one of --methods; with commas."),
    ] = None,
    peak: Annotated[
        float | None,
        typer.Option(
            help="Peak of the PSNR of D1 and D2; default: the largest distance of neighbours in the reference."
        ),
    ] = None,
    threshold: Annotated[
        float | None,
        typer.Option(help="Threshold of the F-score; default: a hundredth of the reference's longest side."),
    ] = None,
    density: Annotated[
        float | None,
        typer.Option(help="Samples of meshes per squared unit; default: what puts 100 000 on the reference."),
    ] = None,
    unit: Annotated[str, typer.Option(help="Unit of all clouds, for the tables; nothing is converted.")] = "mm",
    seed: SeedOption = 1,
    methods: Annotated[Path | None, typer.Option(help="TOML file of measures by other programs, such as PCQM.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Compare clouds or meshes with a reference: D1, D2, Chamfer, F-score, colours, PointSSIM, and other programs."""
    from recon.validation.cloud_quality.evaluation import CloudSettings, measure_clouds
    from recon.validation.cloud_quality.plugin import plugin_measures
    from recon.validation.cloud_quality.programs import program_measures
    from recon.validation.cloud_quality.reading import Sampling
    from recon.validation.cloud_quality.report import write_cloud_report
    from recon.validation.cloud_quality.sequences import find_compared

    settings = CloudSettings(
        unit=unit,
        peak=peak,
        threshold=threshold,
        sampling=Sampling(density, seed),
        measures=parse_names(measures or ""),
        others=plugin_measures() | program_measures(methods, out / "programs"),
    )
    files = find_compared(clouds, reference, names=tuple(approach or ()), dataset=dataset, frames=parse_frames(frames))
    progress = ProgressLine()
    comparison = measure_clouds(files, settings, progress)
    progress.close()
    page = write_cloud_report(comparison, out)
    print_report(comparison.report, page, cloud_sentences(comparison.report), as_json=as_json)


@app.command("films")
def validate_films(
    stimulus_set: Annotated[Path, typer.Argument(metavar="SET", help="Folder of the stimulus set, or its manifest.")],
    reference: Annotated[
        str, typer.Option(help="Condition that every other film of its scene is compared with, such as truth.")
    ],
    out: ReportOption,
    masters: Annotated[
        bool, typer.Option("--masters", help="Measure the near-lossless masters, not the videos participants see.")
    ] = False,
    every: Annotated[int, typer.Option(min=1, help="Measure each such frame only, from the first on.")] = 1,
    workers: WorkersOption = 1,
    as_json: JsonOption = False,
) -> None:
    """Compare films with the reference's on the same path: PSNR-Y, SSIM, MS-SSIM, VMAF and flicker."""
    from recon.validation.films.evaluation import FilmSettings, measure_films
    from recon.validation.films.report import write_films_report

    progress = ProgressLine()
    report, films = measure_films(stimulus_set, FilmSettings(reference, masters, every, workers), progress)
    progress.close()
    page = write_films_report(report, films, out)
    print_report(report, page, film_sentences(report), as_json=as_json)


def print_report(report: Mapping[str, Any], page: Path, sentences: Sequence[str], *, as_json: bool) -> None:
    """Print a report: as one JSON object, or as the sentences that a person reads, and where its page lies."""
    print_result({"report": str(page), **report}, "\n".join([*sentences, f"Report: {page}"]), as_json=as_json)


def parse_thresholds(text: str) -> tuple[float, ...]:
    """Read the thresholds of "FROM:TO", in steps of 2.5 mm, or of "FROM:TO:STEP"."""
    try:
        low, high, step = [float(value) for value in text.split(":")] + [2.5] * (text.count(":") == 1)
    except ValueError:
        low, high, step = 0.0, 0.0, 0.0
    if not (0 < low <= high < 1e6 and step > 0 and (high - low) / step < 10_000):
        raise typer.BadParameter(
            f"{text!r} are no thresholds; expected FROM:TO or FROM:TO:STEP in mm, for example 5:100"
        )
    return tuple(round(low + step * index, DECIMALS) for index in range(int((high - low) / step + 1e-9) + 1))


def parse_edges(text: str) -> tuple[float, float, float]:
    """Read the edges of "AxBxC", mm."""
    try:
        a, b, c = (float(value) for value in text.lower().split("x"))
    except ValueError:
        a, b, c = 0.0, 0.0, 0.0
    if not (min(a, b, c) > 0 and max(a, b, c) < 1e6):
        raise typer.BadParameter(f"{text!r} is no size; expected AxBxC in mm, for example 220x320x160")
    return a, b, c


def parse_viewpoints(texts: Sequence[str]) -> dict[str, tuple[float, float, float]]:
    """Read the place of each sensor from "SENSOR=x,y,z", or from "x,y,z" for the only sensor, S1."""
    parts = [text.rpartition("=") for text in texts]
    places = {name or "S1": parse_position(place) for name, _, place in parts}
    if len(places) < len(texts):
        raise typer.BadParameter(f"{' and '.join(texts)}: a sensor has two places; expected SENSOR=x,y,z once for each")
    return places
