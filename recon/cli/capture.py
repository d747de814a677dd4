"""The commands on recordings, mounted as `capture`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from recon.cli.commands.recordings import (
    IMPORTED,
    CaptureBoard,
    CaptureCalibrate,
    CaptureCheck,
    CaptureExport,
    CaptureImport,
    CaptureMask,
    CaptureSegment,
    CaptureSynth,
    CaptureTruth,
)
from recon.cli.console import ProgressLine, counted, print_result
from recon.cli.flags import with_settings
from recon.cli.kernels import STUDIO, tell_of_compiling
from recon.cli.options import (
    parse_bounds,
    parse_by_sensor,
    parse_frames,
    parse_pairs,
    parse_position,
    parse_size,
    split_names,
)

if TYPE_CHECKING:
    from recon.capture.checking.check import CheckReport

app = typer.Typer(no_args_is_help=True, help="Make, import, export, calibrate, segment and check recordings.")


@app.command("synth")
@with_settings(CaptureSynth)
def capture_synth(asked: CaptureSynth, *, as_json: bool) -> None:
    """Record a synthetic scene, with its true depth, masks and mesh."""
    from recon.studio import SynthParameters, synthesise

    with ProgressLine() as progress:
        tell_of_compiling(progress, STUDIO)
        parameters = asked.filled_in(
            SynthParameters,
            n_sensors=asked.sensors,
            n_frames=asked.frames,
            size=parse_size(asked.size),
            position=parse_position(asked.position),
            late=parse_by_sensor(asked.late or (), "--late", "FRAMES"),
            calibration_error_px=asked.calibration_error,
            shutter_ms=asked.shutter,
            defocus=parse_by_sensor(asked.defocus or (), "--defocus", "PIXELS"),
        )
        capture = synthesise(asked.out, parameters, progress=progress)
    result = {
        "capture": str(asked.out),
        "name": capture.name,
        "sensors": len(capture.sensors),
        "frames": capture.n_frames,
    }
    print_result(
        result,
        f"Recorded {counted(capture.n_frames, 'frame')} by {counted(len(capture.sensors), 'sensor')}: {asked.out}",
        as_json=as_json,
    )


@app.command("truth")
@with_settings(CaptureTruth)
def capture_truth(asked: CaptureTruth, *, as_json: bool) -> None:
    """Lay out the true meshes as the approach `truth`, which `render` films like any other."""
    from recon.capture.format import read_capture
    from recon.studio.truth_models import TRUTH, write_truth_models

    with ProgressLine():
        written = write_truth_models(read_capture(asked.capture), asked.out, parse_frames(asked.frames))
    result = {"models": str(asked.out), "approach": TRUTH, "frames": written}
    frames = counted(len(written), "frame")
    print_result(result, f"Wrote {frames} of the approach {TRUTH}: {asked.out}", as_json=as_json)


@app.command("import")
@with_settings(CaptureImport)
def capture_import(asked: CaptureImport, *, as_json: bool) -> None:
    """Import a real recording into the capture format, and print the check of it; `capture check` tells its verdict."""
    from recon.capture.checking.check import check_capture
    from recon.capture.importing.formats import AUTO, FORMATS, find_format, import_recording
    from recon.capture.importing.sources import ImportOptions, parse_unit

    kind, source, out = asked.format, asked.source, asked.out
    if kind not in (AUTO, *FORMATS):
        raise typer.BadParameter(
            f"{kind!r} is not a format that can be imported; expected {', '.join((AUTO, *FORMATS))}"
        )
    kind = find_format(source) if kind == AUTO else kind
    for option in ("pairs", "units", "up", "shots"):
        value = getattr(asked, option)
        is_so_anyway = kind == "middlebury" and (option, value) in (("units", "m"), ("up", "y"))
        if value is not None and option not in FORMATS[kind].takes and not is_so_anyway:
            raise typer.BadParameter(f"{kind} takes no --{option}; leave it out")
    options = asked.filled_in(
        ImportOptions,
        n_frames=asked.frames,
        bounds=parse_bounds(asked.bounds),
        unit_mm=parse_unit(asked.units) if asked.units else None,
        pairs=parse_pairs(asked.pairs) if asked.pairs else None,
        shots=split_names(asked.shots or "") or None,
    )
    with ProgressLine():
        import_recording(kind, source, out, options)
        report = check_capture(out)
    sentences = f"Read {source} as {kind}: {IMPORTED[kind]}\n{_check_sentences(out, report)}"
    print_result({"capture": str(out), "format": kind, **report.as_json()}, sentences, as_json=as_json)


@app.command("export")
@with_settings(CaptureExport)
def capture_export(asked: CaptureExport, *, as_json: bool) -> None:
    """Write a frame of a capture for other programs: images, cameras in metres, masks, depth maps, points."""
    from recon.capture.exporting.colmap import export_colmap
    from recon.capture.exporting.nerfstudio import export_nerfstudio
    from recon.capture.format import read_capture
    from recon.cloud import merge_clouds
    from recon.geometry.mesh_files import read_cloud

    exporters = {"nerfstudio": export_nerfstudio, "colmap": export_colmap}
    if asked.kind not in exporters:
        raise typer.BadParameter(
            f"{asked.kind!r} is not a format that can be written; expected {' or '.join(exporters)}"
        )
    with ProgressLine():
        cloud = merge_clouds([read_cloud(path) for path in asked.points]) if asked.points else None
        exporters[asked.kind](read_capture(asked.capture), asked.out, frame=asked.frame, points=cloud)
    result = {"out": str(asked.out), "kind": asked.kind, "frame": asked.frame}
    print_result(result, f"Wrote frame {asked.frame} of {asked.capture} for {asked.kind}: {asked.out}", as_json=as_json)


@app.command("board")
@with_settings(CaptureBoard)
def capture_board(asked: CaptureBoard, *, as_json: bool) -> None:
    """Draw a calibration board for printing."""
    from recon.capture.calibration.board import parse_board
    from recon.runtime.files import write_bytes

    if asked.out.suffix.lower() != ".svg":
        raise typer.BadParameter(f"{asked.out} ends in {asked.out.suffix!r}, expected .svg")
    chosen = parse_board(asked.board)
    write_bytes(asked.out, chosen.drawing().encode())
    advice = f"Print it at 100 % of its size, and measure: ten squares are {10 * chosen.square_mm:g} mm."
    print_result(
        {"board": asked.board, "file": str(asked.out)}, f"Drew {asked.board}: {asked.out}\n{advice}", as_json=as_json
    )


@app.command("calibrate")
@with_settings(CaptureCalibrate)
def capture_calibrate(asked: CaptureCalibrate, *, as_json: bool) -> None:
    """Calibrate cameras, stereo pairs and the sensors' places from pictures of a board."""
    from recon.capture.calibration.board import parse_board
    from recon.capture.calibration.run import calibrate_folders

    with ProgressLine() as progress:
        board = parse_board(asked.board)
        report = calibrate_folders(asked.images, board, asked.out, replaces=asked.replace, progress=progress)
    result = {"calibration": str(asked.out), **report.as_json()}
    print_result(
        result, f"{report.as_text()}\nCalibrated {counted(len(report.pairs), 'sensor')}: {asked.out}", as_json=as_json
    )


@app.command("segment")
@with_settings(CaptureSegment)
def capture_segment(asked: CaptureSegment, *, as_json: bool) -> None:
    """Write foreground masks: by clean plate, by threshold against a dark background, or from scribbles."""
    from recon.capture.masks.segment import segment_capture

    capture, method, threshold, scribbles = asked.capture, asked.method, asked.threshold, asked.scribbles
    with ProgressLine() as progress:
        made = segment_capture(capture, method=method, threshold=threshold, scribbles=scribbles, progress=progress)
    result = {"capture": str(capture), "sensors": len(made.sensors), "frames": made.n_frames}
    print_result(
        result,
        f"Wrote masks of {counted(made.n_frames, 'frame')} by {counted(len(made.sensors), 'sensor')}: {capture}",
        as_json=as_json,
    )


@app.command("mask")
@with_settings(CaptureMask)
def capture_mask(asked: CaptureMask, *, as_json: bool) -> None:
    """Write the mask of one picture from the strokes on it, to try them before `segment` follows them in time."""
    from recon.capture.masks.segment import try_strokes

    mask = try_strokes(asked.capture, asked.scribbles, (asked.sensor, asked.side, asked.frame), asked.out)
    result = {"mask": str(asked.out), "foreground": round(float(mask.mean()), 4)}
    print_result(result, f"Wrote a mask of {100 * mask.mean():.1f} % foreground: {asked.out}", as_json=as_json)


@app.command("check")
@with_settings(CaptureCheck)
def capture_check(asked: CaptureCheck, *, as_json: bool) -> None:
    """List everything that is wrong with a capture; exit with 1 if it cannot be used."""
    from recon.capture.checking.check import check_capture
    from recon.capture.checking.page import check_place, write_check

    if asked.report is not None:
        check_place(asked.report)
    if (asked.resample or asked.correct) is not (asked.out is not None):
        raise typer.BadParameter(
            "--resample or --correct, and --out belong together: what to put right, and the folder to make"
        )
    with ProgressLine():
        report = check_capture(asked.capture)
    written = "" if asked.report is None else f"\nReport: {write_check(report, asked.report)}"
    result, sentences = report.as_json(), _check_sentences(asked.capture, report) + written
    if asked.out is not None:
        moves, report = _mended(asked, report, asked.out)
        result |= {"mended": report.as_json(), "moved": moves}
        sentences += "\n".join(("", *moves, "Wrote it anew, and checked that:", _check_sentences(asked.out, report)))
    print_result(result, sentences, as_json=as_json)
    if report.problems:
        raise typer.Exit(1)


def _mended(asked: CaptureCheck, report: CheckReport, out: Path) -> tuple[list[str], CheckReport]:
    """Write a recording anew with what was asked for put right, say which sensors were moved, and check it."""
    from recon.capture.checking.check import check_capture
    from recon.capture.format import read_capture
    from recon.capture.mending.calibration import corrected
    from recon.capture.mending.files import copied
    from recon.capture.mending.resample import moved, resample

    capture = read_capture(asked.capture)
    if asked.correct:
        capture = corrected(capture, report.corrections)
    with ProgressLine() as progress:
        if asked.resample:
            resample(capture, report.lags, out, progress=progress)
        else:
            copied(capture, out)
        return list(moved(capture, report.lags)) if asked.resample else [], check_capture(out)


def _check_sentences(folder: Path, report: CheckReport) -> str:
    frames = counted(report.n_frames, "frame") if report.n_frames else "no frames"
    lines = [
        f"{folder}: {frames}, {counted(len(report.sensors), 'sensor')}",
        report.as_text(),
        *(f"problem: {problem}" for problem in report.problems),
        *(f"warning: {warning}" for warning in report.warnings),
        report.conclusion,
    ]
    return "\n".join(lines)
