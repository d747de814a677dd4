"""The commands on recordings, mounted as `capture`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recon.cli.console import JsonOption, ProgressLine, counted, print_result
from recon.cli.flags import with_settings
from recon.cli.options import parse_bounds, parse_frames, parse_pairs, parse_position, parse_size, telling
from recon.commands.recordings import (
    TEMPLE_PAIRS,
    CaptureCalibrate,
    CaptureCheck,
    CaptureImport,
    CaptureSegment,
)

if TYPE_CHECKING:
    from recon.capture.checking.check import CheckReport

app = typer.Typer(no_args_is_help=True, help="Make, import, export, calibrate, segment and check recordings.")

IMPORTED = {  # formats, and the options that not all of them take
    "middlebury": ("pairs",),
    "opencv": ("units", "up"),
    "colmap": ("pairs", "units", "up"),
    "nerfstudio": ("pairs", "units", "up"),
    "meshroom": ("pairs", "units", "up"),
    "json": ("units", "up", "shots"),
}


@app.command("synth")
def capture_synth(
    out: Annotated[Path, typer.Argument(help="Folder to make; must be empty or absent.")],
    scene: Annotated[str, typer.Option(help="Scene: ball, box, people, standing, face, sphere or cuboid.")] = "ball",
    sensors: Annotated[int, typer.Option(min=1, help="How many stereo sensors.")] = 3,
    frames: Annotated[
        int, typer.Option(min=1, help="How many frames; together they show one period of the motion.")
    ] = 25,
    size: Annotated[str, typer.Option(help="WIDTHxHEIGHT of every camera, pixels.")] = "1280x720",
    noise: Annotated[float, typer.Option(min=0, help="Sensor noise, grey levels (standard deviation).")] = 1.5,
    fps: Annotated[float, typer.Option(help="Frames a second.")] = 25.0,
    position: Annotated[
        str, typer.Option(help="Where the sphere or the cuboid is: x,y,z in mm from the centre.")
    ] = "0,0,0",
    exposure_spread: Annotated[
        float, typer.Option(min=0, help="How much the cameras' exposures differ, as a share.")
    ] = 0.02,
    calibration_error: Annotated[float, typer.Option(min=0, help="Error of the calibration, pixels.")] = 0.0,
    distortion: Annotated[float, typer.Option(help="About the lenses' k1 in OpenCV's model; -0.1 is usual.")] = 0.0,
    depth_maps: Annotated[
        bool, typer.Option("--depth-maps", help="Record by single cameras with depth maps instead of by stereo pairs.")
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="Seed; the same seed gives the same bytes.")] = 1,
    as_json: JsonOption = False,
) -> None:
    """Record a synthetic scene, with its true depth, masks and mesh."""
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
        distortion=distortion,
        depth_maps=depth_maps,
    )
    capture = synthesise(out, parameters, progress=progress)
    progress.close()
    result = {"capture": str(out), "name": capture.name, "sensors": len(capture.sensors), "frames": capture.n_frames}
    print_result(
        result,
        f"Recorded {counted(capture.n_frames, 'frame')} by {counted(len(capture.sensors), 'sensor')}: {out}",
        as_json=as_json,
    )


@app.command("truth")
def capture_truth(
    capture: Annotated[Path, typer.Argument(help="Folder of a synthetic capture.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of models to make; must be empty or absent.")],
    frames: Annotated[
        str | None, typer.Option(help="A:B for the frames A to B-1, as the runs have them; default: all.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Lay out the true meshes as the approach `truth`, which `render` films like any other."""
    from recon.capture.format import read_capture
    from recon.studio.truth_models import TRUTH, write_truth_models

    written = write_truth_models(read_capture(capture), out, parse_frames(frames))
    result = {"models": str(out), "approach": TRUTH, "frames": written}
    print_result(result, f"Wrote {len(written)} frames of the approach {TRUTH}: {out}", as_json=as_json)


@app.command("import")
@with_settings(CaptureImport)
def capture_import(asked: CaptureImport, *, as_json: bool) -> None:
    """Import a real recording into the capture format, and print the check of it; `capture check` tells its verdict."""
    from recon.capture.checking.check import check_capture
    from recon.capture.importing.colmap import import_colmap
    from recon.capture.importing.json_file import import_json
    from recon.capture.importing.meshroom import import_meshroom
    from recon.capture.importing.middlebury import FPS, import_middlebury
    from recon.capture.importing.nerfstudio import import_nerfstudio
    from recon.capture.importing.opencv import import_opencv
    from recon.capture.importing.sources import GapWarning, ImportOptions, parse_unit

    kind, source, out, pairs = asked.format, asked.source, asked.out, asked.pairs
    if kind not in IMPORTED:
        raise typer.BadParameter(f"{kind!r} is not a format that can be imported; expected {', '.join(IMPORTED)}")
    for option in ("pairs", "units", "up", "shots"):
        value = getattr(asked, option)
        is_so_anyway = kind == "middlebury" and (option, value) in (("units", "m"), ("up", "y"))
        if value is not None and option not in IMPORTED[kind] and not is_so_anyway:
            raise typer.BadParameter(f"{kind} takes no --{option}; leave it out")
    box, unit = parse_bounds(asked.bounds), parse_unit(asked.units) if asked.units else None
    name, n_frames, fps = asked.name, asked.frames, asked.fps
    options = ImportOptions(name=name, n_frames=n_frames, bounds=box, unit_mm=unit, fps=fps, up=asked.up)
    with telling(GapWarning):
        if kind == "middlebury":
            views = parse_pairs(pairs or TEMPLE_PAIRS)
            import_middlebury(source, out, pairs=views, n_frames=n_frames or 3, bounds=box, name=name, fps=fps or FPS)
        elif kind == "opencv":
            import_opencv(source, out, options)
        elif kind in ("colmap", "nerfstudio", "meshroom"):
            importers = {"colmap": import_colmap, "nerfstudio": import_nerfstudio, "meshroom": import_meshroom}
            importers[kind](source, out, parse_pairs(pairs) if pairs else None, options)
        else:
            names = tuple(shot.strip() for shot in asked.shots.split(",")) if asked.shots else None
            import_json(source, out, options, shots=names)
    report = check_capture(out)
    print_result({"capture": str(out), **report.as_json()}, _check_sentences(out, report), as_json=as_json)


@app.command("export")
def capture_export(
    kind: Annotated[str, typer.Argument(help="Format to write: nerfstudio or colmap.")],
    capture: Annotated[Path, typer.Argument(help="Folder of the capture.")],
    out: Annotated[Path, typer.Argument(help="Folder to make; must be empty or absent.")],
    frame: Annotated[int, typer.Option(min=0, help="Number of the frame to export.")] = 0,
    points: Annotated[
        list[Path] | None,
        typer.Option(
            help="PLY cloud in mm for splats to start from, such as RUN/clouds/pm/S1/0000.ply; may be repeated."
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Write a frame of a capture for other programs: images, cameras in metres, masks, depth maps, points."""
    from recon.capture.exporting.colmap import export_colmap
    from recon.capture.exporting.nerfstudio import export_nerfstudio
    from recon.capture.format import read_capture
    from recon.cloud import merge_clouds
    from recon.geometry.mesh_files import read_cloud

    exporters = {"nerfstudio": export_nerfstudio, "colmap": export_colmap}
    if kind not in exporters:
        raise typer.BadParameter(f"{kind!r} is not a format that can be written; expected {' or '.join(exporters)}")
    cloud = merge_clouds([read_cloud(path) for path in points]) if points else None
    exporters[kind](read_capture(capture), out, frame=frame, points=cloud)
    result = {"out": str(out), "kind": kind, "frame": frame}
    print_result(result, f"Wrote frame {frame} of {capture} for {kind}: {out}", as_json=as_json)


@app.command("board")
def capture_board(
    board: Annotated[str, typer.Argument(help="As `capture calibrate` takes it, for example charuco:14x10:50:37.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="SVG file to write; it has the board's true size.")],
    as_json: JsonOption = False,
) -> None:
    """Draw a calibration board for printing."""
    from recon.capture.calibration.board import parse_board
    from recon.storage.files import write_bytes

    if out.suffix.lower() != ".svg":
        raise typer.BadParameter(f"{out} ends in {out.suffix!r}, expected .svg")
    chosen = parse_board(board)
    write_bytes(out, chosen.drawing().encode())
    advice = f"Print it at 100 % of its size, and measure: ten squares are {10 * chosen.square_mm:g} mm."
    print_result({"board": board, "file": str(out)}, f"Drew {board}: {out}\n{advice}", as_json=as_json)


@app.command("calibrate")
@with_settings(CaptureCalibrate)
def capture_calibrate(asked: CaptureCalibrate, *, as_json: bool) -> None:
    """Calibrate cameras, stereo pairs and the sensors' places from pictures of a board."""
    from recon.capture.calibration.board import parse_board
    from recon.capture.calibration.run import calibrate_folders

    progress = ProgressLine()
    board = parse_board(asked.board)
    report = calibrate_folders(asked.images, board, asked.out, replaces=asked.replace, progress=progress)
    progress.close()
    result = {"calibration": str(asked.out), **report.as_json()}
    print_result(
        result, f"{report.as_text()}\nCalibrated {counted(len(report.pairs), 'sensor')}: {asked.out}", as_json=as_json
    )


@app.command("segment")
@with_settings(CaptureSegment)
def capture_segment(asked: CaptureSegment, *, as_json: bool) -> None:
    """Write foreground masks: by clean plate, by threshold against a dark background, or from scribbles."""
    from recon.capture.masks.segment import segment_capture

    progress, capture = ProgressLine(), asked.capture
    made = segment_capture(
        capture, method=asked.method, threshold=asked.threshold, scribbles=asked.scribbles, progress=progress
    )
    progress.close()
    result = {"capture": str(capture), "sensors": len(made.sensors), "frames": made.n_frames}
    print_result(
        result,
        f"Wrote masks of {counted(made.n_frames, 'frame')} by {counted(len(made.sensors), 'sensor')}: {capture}",
        as_json=as_json,
    )


@app.command("mask")
def capture_mask(
    capture: Annotated[Path, typer.Argument(help="Folder of the capture.")],
    scribbles: Annotated[Path, typer.Option(help="Folder of pictures, or JSON, with strokes on the picture.")],
    sensor: Annotated[str, typer.Option(help="Sensor of the picture, such as S1.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Where to write the mask, a PNG file.")],
    side: Annotated[str, typer.Option(help="Camera of the picture, left or right.")] = "left",
    frame: Annotated[int, typer.Option(min=0, help="Frame of the picture.")] = 0,
    as_json: JsonOption = False,
) -> None:
    """Write the mask of one picture from the strokes on it, to try them before `segment` follows them in time."""
    from recon.capture.masks.segment import try_strokes

    mask = try_strokes(capture, scribbles, (sensor, side, frame), out)
    result = {"mask": str(out), "foreground": round(float(mask.mean()), 4)}
    print_result(result, f"Wrote a mask of {100 * mask.mean():.1f} % foreground: {out}", as_json=as_json)


@app.command("check")
@with_settings(CaptureCheck)
def capture_check(asked: CaptureCheck, *, as_json: bool) -> None:
    """List everything that is wrong with a capture; exit with 1 if it cannot be used."""
    from recon.capture.checking.check import check_capture
    from recon.capture.checking.page import check_place, write_check

    if asked.report is not None:
        check_place(asked.report)
    report = check_capture(asked.capture)
    written = "" if asked.report is None else f"\nReport: {write_check(report, asked.report)}"
    print_result(report.as_json(), _check_sentences(asked.capture, report) + written, as_json=as_json)
    if report.problems:
        raise typer.Exit(1)


def _check_sentences(folder: Path, report: CheckReport) -> str:
    frames = counted(report.n_frames, "frame") if report.n_frames else "no frames"
    lines = [
        f"{folder}: {frames}, {counted(len(report.sensors), 'sensor')}",
        report.as_text(),
        *(f"problem: {problem}" for problem in report.problems),
        *(f"warning: {warning}" for warning in report.warnings),
        _verdict(report),
    ]
    return "\n".join(lines)


def _verdict(report: CheckReport) -> str:
    if report.problems:
        return "The capture cannot be used as it is."
    return "The capture can be used; mind the warnings." if report.warnings else "Nothing is wrong."
