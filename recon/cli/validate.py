"""The commands of objective evaluation, `reconstudy validate …`; what they need is imported when they run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from recon.cli.console import JsonOption, ProgressLine, print_result
from recon.cli.options import parse_frames, parse_position

EVERY_DATASET = "all"
DatasetOption = Annotated[
    str, typer.Option(help="Scene of a study that this speaks for; all for an approach whatever the scene.")
]
ApproachOption = Annotated[
    list[str] | None, typer.Option(help="Approach of a study that this speaks for, such as pm_fb; may be repeated.")
]

app = typer.Typer(no_args_is_help=True, help="Objective evaluation: known objects, truth, sensors and views.")


@app.command("sphere")
def validate_sphere(
    clouds: Annotated[list[Path], typer.Argument(help="PLY, or text with x y z; one per sensor and placed ball.")],
    radius: Annotated[float, typer.Option(help="Known radius of the ball, mm.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the report.")],
    sensor: Annotated[
        list[str] | None, typer.Option(help="Sensors of the clouds, in their order; fewer names repeat.")
    ] = None,
    method: Annotated[str, typer.Option(help="robust or super4pcs.")] = "robust",
    thresholds: Annotated[str, typer.Option(help="FROM:TO or FROM:TO:STEP of the inlier curve, mm.")] = "5:100",
    unit: Annotated[str, typer.Option(help="Unit of the clouds: mm, cm, m or in.")] = "mm",
    viewpoint: Annotated[
        list[str] | None,
        typer.Option(help="[SENSOR=]x,y,z of a sensor, mm: count only points in front of or behind the ball."),
    ] = None,
    keep: Annotated[list[str] | None, typer.Option(help="SAMPLE/SENSOR to use whatever the rule says.")] = None,
    drop: Annotated[list[str] | None, typer.Option(help="SAMPLE/SENSOR to leave out whatever the rule says.")] = None,
    dataset: DatasetOption = EVERY_DATASET,
    approach: ApproachOption = None,
    seed: Annotated[int, typer.Option(min=0, help="Same seed, same report.")] = 1,
    as_json: JsonOption = False,
) -> None:
    """Fit spheres of a known radius; signed errors and inlier ratios per sensor and combined."""
    from recon.validation.clouds import named_clouds
    from recon.validation.measures import Subject
    from recon.validation.sphere.evaluation import measure_spheres
    from recon.validation.sphere.methods import SphereSettings
    from recon.validation.sphere.report import write_sphere_report

    settings = SphereSettings(
        radius=radius,
        thresholds=parse_thresholds(thresholds),
        method=method,
        unit=unit,
        viewpoints=dict(parse_viewpoint(text) for text in viewpoint or ()),
        keep=tuple(keep or ()),
        drop=tuple(drop or ()),
        subject=Subject(dataset, tuple(approach or ())),
        seed=seed,
    )
    progress = ProgressLine()
    report = measure_spheres(named_clouds(clouds, sensor or ()), settings, progress)
    progress.close()
    page = write_sphere_report(report, out)
    print_result({"report": str(page), **report}, _sphere_sentences(report, page), as_json=as_json)


@app.command("cuboid")
def validate_cuboid(
    clouds: Annotated[list[Path], typer.Argument(help="PLY, or text with x y z; one per sensor and placed cuboid.")],
    size: Annotated[str, typer.Option(help="AxBxC, the known edges in mm.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the report.")],
    sensor: Annotated[
        list[str] | None, typer.Option(help="Sensors of the clouds, in their order; fewer names repeat.")
    ] = None,
    position: Annotated[
        list[str] | None, typer.Option(help="x,y,z of the cuboid's middle where it is known, mm; once per sample.")
    ] = None,
    thresholds: Annotated[str, typer.Option(help="FROM:TO or FROM:TO:STEP of the inlier curve, mm.")] = "5:100",
    unit: Annotated[str, typer.Option(help="Unit of the clouds: mm, cm, m or in.")] = "mm",
    dataset: DatasetOption = EVERY_DATASET,
    approach: ApproachOption = None,
    seed: Annotated[int, typer.Option(min=0, help="Same seed, same report.")] = 1,
    as_json: JsonOption = False,
) -> None:
    """Planes, angles, edges and position of cuboids of known size, per sensor and combined."""
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
    print_result({"report": str(page), **report}, _cuboid_sentences(report, page), as_json=as_json)


@app.command("object")
def validate_object(
    model: Annotated[Path, typer.Argument(help="PLY of the known object's mesh.")],
    cloud: Annotated[Path, typer.Argument(help="PLY, or text with x y z, of its reconstruction.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the report.")],
    thresholds: Annotated[str, typer.Option(help="FROM:TO or FROM:TO:STEP of the inlier curve, mm.")] = "5:100",
    delta: Annotated[
        float | None,
        typer.Option(help="How far from the model a point may lie in the search, mm; default: 2 % of its diagonal."),
    ] = None,
    trim: Annotated[float, typer.Option(help="Share of the points that the refinement uses, the nearest.")] = 0.8,
    unit: Annotated[str, typer.Option(help="Unit of the cloud: mm, cm, m or in.")] = "mm",
    model_unit: Annotated[str, typer.Option(help="Unit of the model: mm, cm, m or in.")] = "mm",
    dataset: DatasetOption = EVERY_DATASET,
    approach: ApproachOption = None,
    seed: Annotated[int, typer.Option(min=0, help="Same seed, same report.")] = 1,
    as_json: JsonOption = False,
) -> None:
    """Find a known mesh in a cloud; signed distances to it and inlier ratios."""
    from recon.validation.known_object.evaluation import ObjectSettings, measure_object
    from recon.validation.known_object.registration import RegistrationParameters
    from recon.validation.known_object.report import ambiguity_text, write_object_report
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
    found, row = report["registration"], report["table"][0]
    sentence = (
        f"{found['overlap']:.1%} of the cloud within {found['delta_mm']:.3g} mm of the model; "
        f"{row['inliers']:.2%} within {row['threshold_mm']:g} mm: {page}"
    )
    doubt = f"\n{ambiguity_text(report)}" if found["is_ambiguous"] else ""
    print_result({"report": str(page), **report}, sentence + doubt, as_json=as_json)


@app.command("views")
def validate_views(
    run: Annotated[Path, typer.Argument(help="Folder of a run.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the report.")],
    capture: Annotated[
        Path | None, typer.Option(help="Folder of the recording; default: where it was when it was reconstructed.")
    ] = None,
    frames: Annotated[str | None, typer.Option(help="A:B, the frames A to B-1; default: all of the run.")] = None,
    threshold: Annotated[
        float | None,
        typer.Option(help="Within which depths of two sensors agree, mm; default: a pixel of disparity in depth."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Sensors against each other, and every model seen from held-out and from the sensors' own cameras."""
    from recon.validation.views.evaluation import ViewSettings, measure_views
    from recon.validation.views.report import write_views_report

    progress = ProgressLine()
    report, shown = measure_views(run, ViewSettings(capture, parse_frames(frames), threshold), progress)
    progress.close()
    page = write_views_report(report, shown, out)
    print_result({"report": str(page), **report}, _view_sentences(report, page), as_json=as_json)


@app.command("mesh")
def validate_mesh(
    mesh: Annotated[Path, typer.Argument(help="PLY of a mesh or cloud, mm.")],
    truth: Annotated[Path, typer.Option(help="PLY of the true mesh or cloud, in the same frame.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the report.")],
    thresholds: Annotated[str, typer.Option(help="FROM:TO or FROM:TO:STEP, mm.")] = "1:20:1",
    threshold: Annotated[
        float | None, typer.Option(help="The one of these whose F-score counts as a measure; default: the middle one.")
    ] = None,
    dataset: DatasetOption = EVERY_DATASET,
    approach: ApproachOption = None,
    cell: Annotated[
        float | None,
        typer.Option(help="Compare `sampled` points by their means in cells of this size, mm, as Tanks and Temples."),
    ] = None,
    voxel: Annotated[float, typer.Option(help="Over which ETH3D averages, mm.")] = 10.0,
    scanner: Annotated[
        str | None, typer.Option(help="x,y,z, mm: where the truth was scanned from; ETH3D counts what is seen there.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the samples on the surfaces.")] = 1,
    as_json: JsonOption = False,
) -> None:
    """Accuracy, completeness and F-score against the truth."""
    from recon.validation.measures import Subject
    from recon.validation.truth.evaluation import MeshSettings, measure_mesh
    from recon.validation.truth.report import write_mesh_report

    subject = Subject(dataset, tuple(approach or ()))
    place = None if scanner is None else parse_position(scanner)
    settings = MeshSettings(parse_thresholds(thresholds), threshold, subject, seed, cell, voxel, place)
    report = measure_mesh(mesh, truth, settings)
    page = write_mesh_report(report, out)
    best = next(row for row in report["scores"] if row["threshold_mm"] == settings.chosen)
    sentence = (
        f"accuracy {report['accuracy']['mean_mm']:.3g} mm, completeness {report['completeness']['mean_mm']:.3g} mm, "
        f"F-score {best['f_score']:.2%} at {best['threshold_mm']:g} mm: {page}"
    )
    print_result({"report": str(page), **report}, sentence, as_json=as_json)


def parse_thresholds(text: str) -> tuple[float, ...]:
    """The thresholds of "FROM:TO" in steps of 2.5 mm, or of "FROM:TO:STEP"."""
    try:
        low, high, step = [float(value) for value in text.split(":")] + [2.5] * (text.count(":") == 1)
    except ValueError:
        low, high, step = 0.0, 0.0, 0.0
    if not (0 < low <= high < 1e6 and step > 0 and (high - low) / step < 10_000):
        raise typer.BadParameter(
            f"{text!r} are no thresholds; expected FROM:TO or FROM:TO:STEP in mm, for example 5:100"
        )
    return tuple(low + step * index for index in range(int((high - low) / step + 1e-9) + 1))


def parse_edges(text: str) -> tuple[float, float, float]:
    """The edges of "AxBxC", mm."""
    try:
        a, b, c = (float(value) for value in text.lower().split("x"))
    except ValueError:
        a, b, c = 0.0, 0.0, 0.0
    if not (min(a, b, c) > 0 and max(a, b, c) < 1e6):
        raise typer.BadParameter(f"{text!r} is no size; expected AxBxC in mm, for example 220x320x160")
    return a, b, c


def parse_viewpoint(text: str) -> tuple[str, tuple[float, float, float]]:
    """Sensor and place of "SENSOR=x,y,z", or of "x,y,z" for the only sensor, S1."""
    name, _, place = text.rpartition("=")
    try:
        x, y, z = (float(value) for value in place.split(","))
    except ValueError as error:
        raise typer.BadParameter(
            f"{text!r} is no viewpoint; expected SENSOR=x,y,z in mm, for example S1=0,0,0"
        ) from error
    return name or "S1", (x, y, z)


def _view_sentences(report: dict[str, Any], page: Path) -> str:
    threshold = report["settings"]["threshold_mm"]
    lines = [
        f"{row['kind']}, {row['approach']}: "
        + ", ".join(
            f"{name} {row[column]:{form}}"
            for name, column, form in (
                ("PSNR", "psnr_db", ".2f"),
                ("SSIM", "ssim", ".3f"),
                ("coverage", "coverage", ".1%"),
                ("spill", "spill", ".1%"),
            )
            if row[column] is not None
        )
        for row in report["means"]
        if row["region"] == "all"
    ]
    lines += [
        f"sensors by {row['depth']}: {row['agree']:.1%} of the depths agree within {threshold:.3g} mm"
        for row in report["agreement"]
        if row["agree"] is not None
    ]
    return "\n".join([*lines, f"Report: {page}"])


def _cuboid_sentences(report: dict[str, Any], page: Path) -> str:
    lines = []
    for row in report["reconstructions"]:
        if row["failure"]:
            lines.append(f"no fit: {row['name']}: {row['failure']}")
            continue
        angles, edges = (
            ", ".join(f"{one[column]:+.3g}" for one in report[part] if one["name"] == row["name"])
            for part, column in (("angles", "error_deg"), ("edges", "error_mm"))
        )
        faces = f"faces {' '.join(row['faces'])}"
        lines.append(f"{row['name']}: {faces}; angles off by {angles} degrees, edges by {edges} mm")
    return "\n".join([*lines, f"Report: {page}"])


def _sphere_sentences(report: dict[str, Any], page: Path) -> str:
    lines = [
        f"{row['sensor']} ({row['subset']}): {row['inliers']:.2%} within {row['threshold_mm']:g} mm "
        f"in {row['n_samples']} samples"
        for row in report["table"]
    ]
    lines += [f"left out: {row['name']}: {'; '.join(row['reasons'])}" for row in report["excluded"]]
    lines += [
        f"remark: {row['name']}: {'; '.join(row['remarks'])}" for row in report["reconstructions"] if row["remarks"]
    ]
    failed = {row["name"]: row["failure"] for row in report["reconstructions"] if row["failure"]}
    return "\n".join([*lines, *(f"no fit: {name}: {why}" for name, why in failed.items()), f"Report: {page}"])
