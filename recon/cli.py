"""The reconstruction backend's commands, mounted by the product's one command line.

What a command needs is imported when it runs: `--help` and the server never load numba or OpenCV.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from recon.capture_cli import app as capture_app
from recon.console import JsonOption, ProgressLine, print_result
from recon.options import parse_frames, parse_names, parse_size

app = typer.Typer(no_args_is_help=True)
app.add_typer(capture_app, name="capture")
validate_app = typer.Typer(no_args_is_help=True, help="Objective evaluation: spheres, meshes against the truth.")
app.add_typer(validate_app, name="validate")


@app.command()
def match(
    left: Annotated[Path, typer.Argument(help="Left image of a rectified pair, 8 bit.")],
    right: Annotated[Path, typer.Argument(help="Right image, of the same size.")],
    disparities: Annotated[int, typer.Option(help="How many disparities to search.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="OUT.pfm, .npy, .tiff or .png (a coloured preview).")],
    method: Annotated[str, typer.Option(help="Depth method.")] = "id",
    min_disparity: Annotated[int, typer.Option(help="Smallest disparity to search.")] = 0,
    as_json: JsonOption = False,
) -> None:
    """Disparity of one rectified pair; unmatched is NaN (npy, tiff) or inf (pfm)."""
    from recon.pipeline import match_files

    result = match_files(left, right, out, method=method, n_disparities=disparities, min_disparity=min_disparity)
    sentence = f"{method}: {result['density']:.1%} of the pixels matched in {result['seconds']:.3f} s: {out}"
    print_result(result, sentence, as_json=as_json)


@app.command()
def reconstruct(
    capture: Annotated[Path, typer.Argument(help="Folder of the capture.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the run; starting again resumes it.")],
    depth: Annotated[str | None, typer.Option(help="Depth methods, comma between; default: all there are.")] = None,
    fusion: Annotated[str, typer.Option(help="Fusions, comma between.")] = "fa,fb",
    frames: Annotated[str | None, typer.Option(help="A:B, the frames A to B-1; default: all.")] = None,
    voxel: Annotated[float | None, typer.Option(help="Voxel size, mm; default: from the depth resolution.")] = None,
    temporal: Annotated[bool, typer.Option(help="Filter the depth maps in time, against flicker.")] = True,
    balance: Annotated[bool, typer.Option("--balance-colours", help="Make the sensors' colours agree.")] = False,
    close_holes: Annotated[
        float, typer.Option(min=0, help="Close holes whose rim is no longer than this, mm; default: leave them open.")
    ] = 0.0,
    workers: Annotated[int, typer.Option(min=1, help="Local processes.")] = 1,
    as_json: JsonOption = False,
) -> None:
    """From a capture to depth maps, clouds and meshes, for every approach."""
    from recon.depth import MATCHERS
    from recon.depth.temporal import TemporalParameters
    from recon.pipeline import ReconstructOptions
    from recon.pipeline import reconstruct as run_reconstruction
    from recon.surface import SurfaceParameters

    options = ReconstructOptions(
        depths=parse_names(depth) if depth else tuple(MATCHERS),
        fusions=parse_names(fusion),
        frames=parse_frames(frames),
        temporal=TemporalParameters() if temporal else None,
        surface=SurfaceParameters(voxel_mm=voxel, longest_rim_mm=close_holes),
        balance_colours=balance,
        workers=workers,
    )
    progress = ProgressLine()
    result = run_reconstruction(capture, out, options, progress)
    progress.close()
    made = f"{len(result['frames'])} frames, approaches {', '.join(result['approaches'])}"
    print_result(result, f"Reconstructed {result['dataset']} ({made}): {out}", as_json=as_json)


@app.command()
def export(
    mesh: Annotated[Path, typer.Argument(help="A mesh as PLY, for example RUN/meshes/pm_fb/0000.ply.")],
    out: Annotated[Path, typer.Argument(help="OUT.glb for viewers and the web, or OUT.ply.")],
    as_json: JsonOption = False,
) -> None:
    """Write a mesh in another format: GLB opens in any 3D viewer, turned by hand."""
    from recon.mesh import read_mesh, write_mesh

    model = read_mesh(mesh)
    write_mesh(out, model)
    result = {"out": str(out), "vertices": len(model.vertices), "faces": len(model.faces)}
    print_result(result, f"Wrote {result['vertices']} vertices and {result['faces']} faces: {out}", as_json=as_json)


@app.command()
def render(
    runs: Annotated[list[Path], typer.Argument(help="Runs, one per scene.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the stimulus set.")],
    size: Annotated[str, typer.Option(help="WIDTHxHEIGHT, pixels.")] = "1920x1080",
    fps: Annotated[float, typer.Option(min=1, max=120, help="Frames a second.")] = 25.0,
    seconds: Annotated[float, typer.Option(min=0.04, help="Length of every video.")] = 15.0,
    background: Annotated[str, typer.Option(help="Name of the artificial background.")] = "studio",
    loop: Annotated[
        str, typer.Option(help="Recordings shorter than the video: repeat, bounce (back and forth) or static.")
    ] = "bounce",
    renderer: Annotated[str, typer.Option(help="auto, or the name of a renderer.")] = "auto",
    master: Annotated[bool, typer.Option(help="Keep a near-lossless master beside each video.")] = True,
    workers: Annotated[int, typer.Option(min=1, help="Local processes, one video each.")] = 1,
    as_json: JsonOption = False,
) -> None:
    """Fly-through videos of every approach of every run, and the stimulus set's manifest."""
    from recon.files import read_json
    from recon.flythrough import RenderOptions
    from recon.pipeline import render as render_runs

    options = RenderOptions(
        size=parse_size(size),
        fps=fps,
        seconds=seconds,
        background=background,
        loop=loop,
        renderer=renderer,
        master=master,
        workers=workers,
    )
    progress = ProgressLine()
    manifest = render_runs(runs, out, options, progress)
    progress.close()
    stimuli = read_json(manifest)["stimuli"]
    faults = [f"{stimulus['video']}: {fault}" for stimulus in stimuli for fault in stimulus["quality"]["faults"]]
    sentences = [f"Rendered {len(stimuli)} videos: {manifest}", *(f"below the bar for encoding: {f}" for f in faults)]
    print_result({"manifest": str(manifest), "faults": faults}, "\n".join(sentences), as_json=as_json)


@validate_app.command("sphere")
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
    seed: Annotated[int, typer.Option(min=0, help="Same seed, same report.")] = 1,
    as_json: JsonOption = False,
) -> None:
    """Fit spheres of a known radius; signed errors and inlier ratios per sensor and combined."""
    from recon.validation.sphere_report import write_sphere_report
    from recon.validation.spheres import SphereSettings, measure_spheres, sphere_clouds

    settings = SphereSettings(
        radius=radius,
        thresholds=parse_thresholds(thresholds),
        method=method,
        unit=unit,
        viewpoints=dict(parse_viewpoint(text) for text in viewpoint or ()),
        keep=tuple(keep or ()),
        drop=tuple(drop or ()),
        seed=seed,
    )
    progress = ProgressLine()
    report = measure_spheres(sphere_clouds(clouds, sensor or ()), settings, progress)
    progress.close()
    page = write_sphere_report(report, out)
    print_result({"report": str(page), **report}, _sphere_sentences(report, page), as_json=as_json)


@validate_app.command("mesh")
def validate_mesh(
    mesh: Annotated[Path, typer.Argument(help="PLY of a mesh or cloud, mm.")],
    truth: Annotated[Path, typer.Option(help="PLY of the true mesh or cloud, in the same frame.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the report.")],
    thresholds: Annotated[str, typer.Option(help="FROM:TO or FROM:TO:STEP, mm.")] = "1:20:1",
    seed: Annotated[int, typer.Option(min=0, help="Of the samples on the surfaces.")] = 1,
    as_json: JsonOption = False,
) -> None:
    """Accuracy, completeness and F-score against the truth."""
    from recon.validation.ground_truth import measure_mesh
    from recon.validation.mesh_report import write_mesh_report

    report = measure_mesh(mesh, truth, parse_thresholds(thresholds), seed)
    page = write_mesh_report(report, out)
    best = report["scores"][len(report["scores"]) // 2]
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


def _sphere_sentences(report: dict[str, Any], page: Path) -> str:
    lines = [
        f"{row['sensor']} ({row['subset']}): {row['inliers']:.2%} within {row['threshold_mm']:g} mm "
        f"in {row['n_samples']} samples"
        for row in report["table"]
    ]
    lines += [f"left out: {row['name']}: {'; '.join(row['reasons'])}" for row in report["excluded"]]
    failed = {row["name"]: row["failure"] for row in report["reconstructions"] if row["failure"]}
    return "\n".join([*lines, *(f"no fit: {name}: {why}" for name, why in failed.items()), f"Report: {page}"])
