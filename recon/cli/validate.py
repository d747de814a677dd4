"""The commands of objective evaluation, mounted as `validate`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from recon.cli.commands.measures import (
    ValidateCloud,
    ValidateCuboid,
    ValidateFilms,
    ValidateMesh,
    ValidateObject,
    ValidateSphere,
    ValidateViews,
)
from recon.cli.console import ProgressLine, print_result
from recon.cli.flags import with_settings
from recon.cli.options import parse_frames, parse_names, parse_position, refuse_url, split_names
from recon.cli.validation_sentences import (
    cloud_sentences,
    cuboid_sentences,
    film_sentences,
    mesh_sentences,
    object_sentences,
    sphere_sentences,
    view_sentences,
)

if TYPE_CHECKING:
    from recon.validation.measures import Subject

DECIMALS = 9  # of thresholds, so that the third step of 0.1 is 0.3 as it is written


def _report_folder(context: typer.Context, parameter: typer.CallbackParam, out: Path) -> Path:
    """Refuse a URL, or a folder of somebody else's, before anything is measured."""
    from recon.validation.page import check_report_folder

    refuse_url(context, parameter, out)
    check_report_folder(out)
    return out


REPORT = {"file_okay": False, "callback": _report_folder}  # of each command's setting `out`

app = typer.Typer(
    no_args_is_help=True,
    help="Measure reconstructions: known objects, true meshes, clouds, sensors against each other, views, films.",
)


@app.command("sphere")
@with_settings(ValidateSphere, out=REPORT)
def validate_sphere(asked: ValidateSphere, *, as_json: bool) -> None:
    """Fit spheres of known radius, and report signed errors and inlier ratios per sensor and combined."""
    from recon.validation.clouds import named_clouds
    from recon.validation.sphere.evaluation import measure_spheres
    from recon.validation.sphere.fit.model import ReferenceSettings, SphereSettings
    from recon.validation.sphere.report import write_sphere_report

    settings = asked.filled_in(
        SphereSettings,
        thresholds=parse_thresholds(asked.thresholds),
        viewpoints=parse_viewpoints(asked.viewpoint or ()),
        keep=tuple(asked.keep or ()),
        drop=tuple(asked.drop or ()),
        reference=ReferenceSettings(tuple(asked.reference_centre), asked.reference_unit, asked.reference_frame)
        if asked.reference_centre
        else None,
        subject=_subject(asked),
    )
    with ProgressLine() as progress:
        report, pictured = measure_spheres(named_clouds(asked.clouds, asked.sensors or ()), settings, progress)
        page = write_sphere_report(report, pictured, asked.out)
    print_report(report, page, sphere_sentences(report), as_json=as_json)


@app.command("cuboid")
@with_settings(ValidateCuboid, out=REPORT)
def validate_cuboid(asked: ValidateCuboid, *, as_json: bool) -> None:
    """Fit cuboids of known size, and report planes, angles, edges and positions per sensor and combined."""
    from recon.validation.clouds import named_clouds
    from recon.validation.cuboid.evaluation import CuboidSettings, measure_cuboids
    from recon.validation.cuboid.report import write_cuboid_report

    settings = asked.filled_in(
        CuboidSettings,
        size=parse_edges(asked.size),
        thresholds=parse_thresholds(asked.thresholds),
        positions=tuple(parse_position(text) for text in asked.position or ()),
        subject=_subject(asked),
    )
    with ProgressLine() as progress:
        report, measured = measure_cuboids(named_clouds(asked.clouds, asked.sensors or ()), settings, progress)
        page = write_cuboid_report(report, measured, asked.out)
    print_report(report, page, cuboid_sentences(report), as_json=as_json)


@app.command("object")
@with_settings(ValidateObject, out=REPORT)
def validate_object(asked: ValidateObject, *, as_json: bool) -> None:
    """Find a known mesh in a cloud, and report signed distances and inlier ratios."""
    from recon.validation.known_object.evaluation import ObjectSettings, measure_object
    from recon.validation.known_object.registration import RegistrationParameters
    from recon.validation.known_object.report import write_object_report

    settings = asked.filled_in(
        ObjectSettings,
        thresholds=parse_thresholds(asked.thresholds),
        registration=asked.filled_in(RegistrationParameters),
        subject=_subject(asked),
    )
    with ProgressLine():
        report, measured = measure_object(asked.model, asked.cloud, settings)
        page = write_object_report(report, measured, asked.out)
    print_report(report, page, object_sentences(report), as_json=as_json)


@app.command("views")
@with_settings(ValidateViews, out=REPORT)
def validate_views(asked: ValidateViews, *, as_json: bool) -> None:
    """Compare sensors with each other, and models with held-out and with the sensors' own photographs."""
    from recon.validation.views.evaluation import ViewSettings, measure_views
    from recon.validation.views.report import write_views_report

    with ProgressLine() as progress:
        models = tuple(asked.models or ())
        settings = ViewSettings(asked.capture, parse_frames(asked.frames), models, asked.threshold, asked.filled)
        report, shown = measure_views(asked.run, settings, progress)
        page = write_views_report(report, shown, asked.out)
    print_report(report, page, view_sentences(report), as_json=as_json)


@app.command("mesh")
@with_settings(ValidateMesh, out=REPORT)
def validate_mesh(asked: ValidateMesh, *, as_json: bool) -> None:
    """Report accuracy, completeness and F-score against the truth."""
    from recon.validation.truth.evaluation import MeshSettings, measure_mesh
    from recon.validation.truth.report import write_mesh_report

    settings = asked.filled_in(
        MeshSettings,
        thresholds=parse_thresholds(asked.thresholds),
        table_threshold=asked.threshold,
        subject=_subject(asked),
        scanner=None if asked.scanner is None else parse_position(asked.scanner),
        capture=None if asked.capture is None else str(asked.capture),
    )
    with ProgressLine():
        report = measure_mesh(asked.mesh, asked.truth, settings)
        page = write_mesh_report(report, asked.out)
    print_report(report, page, mesh_sentences(report), as_json=as_json)


@app.command("cloud")
@with_settings(ValidateCloud, out=REPORT)
def validate_cloud(asked: ValidateCloud, *, as_json: bool) -> None:
    """Compare clouds or meshes with a reference: D1, D2, Chamfer, F-score, colours, PointSSIM, and other programs."""
    from recon.validation.cloud_quality.evaluation import CloudSettings, measure_clouds
    from recon.validation.cloud_quality.plugin import plugin_measures
    from recon.validation.cloud_quality.programs import program_measures
    from recon.validation.cloud_quality.reading import Sampling
    from recon.validation.cloud_quality.report import write_cloud_report
    from recon.validation.cloud_quality.sequences import find_compared

    settings = asked.filled_in(
        CloudSettings,
        sampling=Sampling(asked.density, asked.seed),
        measures=parse_names(asked.measures or ""),
        others=plugin_measures() | program_measures(asked.methods, asked.out / "programs"),
    )
    files = find_compared(
        asked.clouds,
        asked.reference,
        names=tuple(asked.approach or ()),
        dataset=asked.dataset,
        frames=parse_frames(asked.frames),
    )
    with ProgressLine() as progress:
        comparison = measure_clouds(files, settings, progress)
        page = write_cloud_report(comparison, asked.out)
    print_report(comparison.report, page, cloud_sentences(comparison.report), as_json=as_json)


@app.command("films")
@with_settings(ValidateFilms, out=REPORT)
def validate_films(asked: ValidateFilms, *, as_json: bool) -> None:
    """Compare films with the reference's on the same path: PSNR-Y, SSIM, MS-SSIM, VMAF, flicker, or more by request."""
    with ProgressLine() as progress:
        from recon.validation.films.evaluation import FilmSettings, measure_films
        from recon.validation.films.perceptual import Perceptual, parse_display, parse_weights
        from recon.validation.films.programs import film_programs
        from recon.validation.films.report import write_films_report

        names = split_names(asked.measure)
        perceptual = Perceptual(names, parse_display(asked.display), parse_weights(asked.weights or ()))
        programs = film_programs(asked.methods, asked.out / "programs")
        settings = FilmSettings(asked.reference, asked.masters, asked.every, asked.workers, perceptual, programs)
        report, films = measure_films(asked.stimulus_set, settings, progress)
        page = write_films_report(report, films, asked.out)
    print_report(report, page, film_sentences(report), as_json=as_json)


def _subject(asked: ValidateSphere | ValidateCuboid | ValidateObject | ValidateMesh) -> Subject:
    """Say what clouds show, in a study's words."""
    from recon.validation.measures import Subject

    return Subject(asked.dataset, tuple(asked.approach or ()))


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
