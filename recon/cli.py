"""The reconstruction backend's commands, mounted by the product's one command line.

What a command needs is imported when it runs: `--help` and the server never load numba or OpenCV.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from recon.console import JsonOption, ProgressLine, print_result

if TYPE_CHECKING:
    from recon.capture.check import CheckReport

app = typer.Typer(no_args_is_help=True)
capture_app = typer.Typer(no_args_is_help=True, help="Recordings: make, import, segment, check.")
app.add_typer(capture_app, name="capture")
validate_app = typer.Typer(no_args_is_help=True, help="Objective evaluation: spheres, meshes against the truth.")
app.add_typer(validate_app, name="validate")

TEMPLE_PAIRS = "13-14,20-21,27-28"  # three sensors on one joint spot in Middlebury's templeRing


@capture_app.command("synth")
def capture_synth(
    out: Annotated[Path, typer.Argument(help="Folder to make; must be empty or absent.")],
    scene: Annotated[str, typer.Option(help="ball, box, people, standing, face, sphere or cuboid.")] = "ball",
    sensors: Annotated[int, typer.Option(min=1, help="How many stereo sensors.")] = 3,
    frames: Annotated[int, typer.Option(min=1, help="How many frames; one period of the motion.")] = 25,
    size: Annotated[str, typer.Option(help="WIDTHxHEIGHT of every camera, pixels.")] = "1280x720",
    noise: Annotated[float, typer.Option(min=0, help="Sensor noise, grey levels (standard deviation).")] = 1.5,
    fps: Annotated[float, typer.Option(help="Frames a second.")] = 25.0,
    position: Annotated[str, typer.Option(help="x,y,z in mm from the centre, for sphere and cuboid.")] = "0,0,0",
    exposure_spread: Annotated[float, typer.Option(min=0, help="Spread of the cameras' exposures, a share.")] = 0.02,
    calibration_error: Annotated[float, typer.Option(min=0, help="Error of the calibration, pixels.")] = 0.0,
    seed: Annotated[int, typer.Option(help="Same seed, same bytes.")] = 1,
    as_json: JsonOption = False,
) -> None:
    """Record a synthetic scene with known depth, masks and mesh."""
    from recon.studio import SynthParameters, synthesise

    progress = ProgressLine()
    parameters = SynthParameters(
        scene=scene,
        n_sensors=sensors,
        n_frames=frames,
        size=parse_size(size),
        noise=noise,
        seed=seed,
        fps=fps,
        position=parse_position(position),
        exposure_spread=exposure_spread,
        calibration_error_px=calibration_error,
    )
    capture = synthesise(out, parameters, progress=progress)
    progress.close()
    result = {"capture": str(out), "name": capture.name, "sensors": len(capture.sensors), "frames": capture.n_frames}
    print_result(
        result, f"Recorded {capture.n_frames} frames by {len(capture.sensors)} sensors: {out}", as_json=as_json
    )


@capture_app.command("import")
def capture_import(
    kind: Annotated[str, typer.Argument(help="Format of the source: middlebury, opencv, colmap or json.")],
    source: Annotated[Path, typer.Argument(help="Folder of the recording, or its calibration or JSON file.")],
    out: Annotated[Path, typer.Argument(help="Folder to make; must be empty or absent.")],
    pairs: Annotated[
        str | None,
        typer.Option(
            help=f"LEFT-RIGHT view numbers of every sensor, comma between; middlebury's default: {TEMPLE_PAIRS}."
        ),
    ] = None,
    frames: Annotated[int | None, typer.Option(min=1, help="Frames to take; default: all (middlebury: 3).")] = None,
    bounds: Annotated[
        str | None, typer.Option(help="x0,y0,z0,x1,y1,z1 in mm; default: the source's own bounding box.")
    ] = None,
    units: Annotated[
        str | None, typer.Option(help="Unit of the source's lengths: mm, cm, m, in, or its length in mm.")
    ] = None,
    up: Annotated[
        str, typer.Option(help="Axis of the source's world that points upwards: x, -x, y, -y, z or -z.")
    ] = "y",
    fps: Annotated[float | None, typer.Option(min=0.01, help="Frames a second; default: the videos', else 25.")] = None,
    name: Annotated[str | None, typer.Option(help="The scene's name; default: the source's.")] = None,
    shots: Annotated[
        str | None, typer.Option(help="json: names of the shots to take as frames, comma between.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Bring a real recording into the capture format."""
    from recon.capture.check import check_capture
    from recon.capture.colmap import import_colmap
    from recon.capture.described import import_json
    from recon.capture.middlebury import FPS, import_middlebury
    from recon.capture.opencv import import_opencv
    from recon.capture.sources import ImportOptions, parse_unit

    box, unit = parse_bounds(bounds), parse_unit(units) if units else None
    options = ImportOptions(name=name, n_frames=frames, bounds=box, unit_mm=unit, fps=fps, up=up)
    if kind == "middlebury":
        views = parse_pairs(pairs or TEMPLE_PAIRS)
        import_middlebury(source, out, pairs=views, n_frames=frames or 3, bounds=box, name=name, fps=fps or FPS)
    elif kind == "opencv":
        import_opencv(source, out, options)
    elif kind == "colmap":
        import_colmap(source, out, parse_pairs(pairs) if pairs else None, options)
    elif kind == "json":
        names = tuple(shot.strip() for shot in shots.split(",")) if shots else None
        import_json(source, out, options, shots=names)
    else:
        expected = "middlebury, opencv, colmap or json"
        raise typer.BadParameter(f"{kind!r} is not a format that can be imported; expected {expected}")
    report = check_capture(out)
    print_result({"capture": str(out), **report.as_json()}, _check_sentences(out, report), as_json=as_json)


@capture_app.command("calibrate")
def capture_calibrate(
    images: Annotated[
        list[Path],
        typer.Argument(help="Folder with left and right, or with such folders per sensor; or every camera's folder."),
    ],
    board: Annotated[str, typer.Option(help="chessboard:9x6:25 (inner corners, mm) or charuco:11x8:30:22.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="calibration.yml; its report lies beside it.")],
    as_json: JsonOption = False,
) -> None:
    """Cameras, stereo pairs and all sensors in one world, from pictures of a board."""
    from recon.capture.board import parse_board
    from recon.capture.calibration import calibrate_folders

    progress = ProgressLine()
    report = calibrate_folders(images, parse_board(board), out, progress=progress)
    progress.close()
    result = {"calibration": str(out), **report.as_json()}
    print_result(result, f"{report.as_text()}\nCalibrated {len(report.pairs)} sensors: {out}", as_json=as_json)


@capture_app.command("segment")
def capture_segment(
    capture: Annotated[Path, typer.Argument(help="Folder of the capture.")],
    method: Annotated[
        str | None, typer.Option(help="plate or threshold; default: plate where there is one, else threshold.")
    ] = None,
    threshold: Annotated[int | None, typer.Option(min=1, max=254, help="Grey levels above the background.")] = None,
    scribbles: Annotated[
        Path | None, typer.Option(help="Folder of pictures, or JSON, with strokes on key frames; instead of a method.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Write foreground masks by clean plate, by threshold against a dark background, or by scribbles."""
    from recon.capture.segment import segment_capture

    progress = ProgressLine()
    made = segment_capture(capture, method=method, threshold=threshold, scribbles=scribbles, progress=progress)
    progress.close()
    result = {"capture": str(capture), "sensors": len(made.sensors), "frames": made.n_frames}
    print_result(
        result, f"Wrote masks of {made.n_frames} frames by {len(made.sensors)} sensors: {capture}", as_json=as_json
    )


@capture_app.command("check")
def capture_check(
    capture: Annotated[Path, typer.Argument(help="Folder of the capture.")],
    report_folder: Annotated[
        Path | None, typer.Option("--report", help="Folder for report.html (with thumbnails) and report.json.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Everything that is wrong with a capture, in one go; exit 1 if anything is."""
    from recon.capture.check import check_capture
    from recon.capture.check_page import write_check

    report = check_capture(capture)
    if report_folder is not None:
        write_check(report, report_folder)
    print_result(report.as_json(), _check_sentences(capture, report), as_json=as_json)
    if report.problems:
        raise typer.Exit(1)


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


def parse_size(text: str) -> tuple[int, int]:
    """(width, height) of "WIDTHxHEIGHT"."""
    found = re.fullmatch(r"(\d+)x(\d+)", text)
    if found is None:
        raise typer.BadParameter(f"{text!r} is not a size; expected WIDTHxHEIGHT, for example 1920x1080")
    return int(found[1]), int(found[2])


def parse_names(text: str) -> tuple[str, ...]:
    """The names of "a,b,c"."""
    return tuple(name.strip().lower() for name in text.split(",") if name.strip())


def parse_frames(text: str | None) -> range | None:
    """The frames of "A:B", with either end left out for the first or last."""
    if text is None:
        return None
    found = re.fullmatch(r"(\d*):(\d*)", text)
    if found is None:
        raise typer.BadParameter(f"{text!r} is not a range of frames; expected A:B, for example 0:25")
    return range(int(found[1] or 0), int(found[2]) if found[2] else 2**31)


def parse_pairs(text: str) -> tuple[tuple[int, int], ...]:
    """The view numbers of "13-14,20-21"."""
    found = [re.fullmatch(r"(\d+)-(\d+)", pair.strip()) for pair in text.split(",")]
    if not all(found):
        raise typer.BadParameter(f"{text!r} are not pairs of views; expected for example {TEMPLE_PAIRS}")
    return tuple((int(pair[1]), int(pair[2])) for pair in found if pair)


def parse_position(text: str) -> tuple[float, float, float]:
    """The numbers of "x,y,z"."""
    try:
        x, y, z = (float(value) for value in text.split(","))
    except ValueError as error:
        raise typer.BadParameter(f"{text!r} is not a position; expected x,y,z in mm") from error
    return x, y, z


def parse_bounds(text: str | None) -> Any:
    """Bounds (2, 3) in mm of "x0,y0,z0,x1,y1,z1", or None."""
    if text is None:
        return None
    import numpy as np

    try:
        return np.array([float(value) for value in text.split(",")]).reshape(2, 3)
    except ValueError as error:
        raise typer.BadParameter(f"{text!r} are not bounds; expected x0,y0,z0,x1,y1,z1 in mm") from error


def _check_sentences(folder: Path, report: CheckReport) -> str:
    verdict = "\n".join(f"problem: {problem}" for problem in report.problems) or "Nothing is wrong."
    return f"{folder}: {report.n_frames} frames, {len(report.sensors)} sensors\n{report.as_text()}\n{verdict}"


def _sphere_sentences(report: dict[str, Any], page: Path) -> str:
    lines = [
        f"{row['sensor']} ({row['subset']}): {row['inliers']:.2%} within {row['threshold_mm']:g} mm "
        f"in {row['n_samples']} samples"
        for row in report["table"]
    ]
    lines += [f"left out: {row['name']}: {'; '.join(row['reasons'])}" for row in report["excluded"]]
    failed = {row["name"]: row["failure"] for row in report["reconstructions"] if row["failure"]}
    return "\n".join([*lines, *(f"no fit: {name}: {why}" for name, why in failed.items()), f"Report: {page}"])
