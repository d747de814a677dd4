"""The settings of the commands on recordings that jobs run, too."""

from __future__ import annotations

from pathlib import Path

from recon.commands.setting import NUMBER, OUT, Command, argument, option

TEMPLE_PAIRS = "13-14,20-21,27-28"  # three sensors on one joint spot in Middlebury's templeRing


class CaptureImport(Command):
    """Of `capture import`."""

    format: str = argument(
        "Format of the source: middlebury, opencv, colmap, nerfstudio, meshroom or json.",
        label="Format",
        choices={
            "opencv": "pictures or videos with a calibration.yml",
            "colmap": "COLMAP's model",
            "nerfstudio": "nerfstudio's transforms.json",
            "meshroom": "Meshroom's cameras",
            "middlebury": "Middlebury's multi-view data sets",
            "json": "a JSON file of cameras",
        },
    )
    source: Path = argument("Folder of the recording, or its calibration or JSON file.")
    out: Path = argument("Folder to make; must be empty or absent.")
    pairs: str | None = option(
        None,
        "LEFT-RIGHT view numbers of each stereo sensor, comma-separated: IMAGE_IDs of colmap, viewIds of meshroom, "
        f"places in nerfstudio's frames from 1. Default for middlebury: {TEMPLE_PAIRS}.",
        label="Pairs",
        form=r"\d+-\d+(?:,\d+-\d+)*",
        example="13-14,20-21",
    )
    frames: int | None = option(
        None, "Frames to take; default: all (middlebury: 3).", ge=1, label="Number of frames", high=1e6
    )
    bounds: str | None = option(
        None,
        "x0,y0,z0,x1,y1,z1 in mm; default: the source's own bounding box.",
        label="Bounds",
        form=f"{NUMBER}(?:,{NUMBER}){{5}}",
        example="-500,0,-500,500,2000,500",
    )
    units: str | None = option(
        None,
        "Unit of the source's lengths: mm, cm, m, in, or a number of mm.",
        label="Unit of lengths",
        form=r"mm|cm|m|in|\d+(?:\.\d+)?",
        example="m",
    )
    up: str | None = option(
        None,
        "Which axis of the source points upwards: x, -x, y, -y, z or -z. Default: as the source says, else y.",
        label="Upwards",
        choices={axis: axis for axis in ("x", "-x", "y", "-y", "z", "-z")},
    )
    fps: float | None = option(
        None, "Frames a second; default: as the videos, else 25.", ge=0.01, label="Frames a second", high=1000
    )
    name: str | None = option(None, "The scene's name; default: the source's.")
    shots: str | None = option(None, "For json: names of the shots to take as frames, comma-separated.")


class CaptureCalibrate(Command):
    """Of `capture calibrate`."""

    images: list[Path] = argument(
        "A folder with left and right (folders or videos), one such folder per sensor, or one per camera."
    )
    board: str = option(
        ...,
        "chessboard:9x6:25 (inner corners, square in mm) or charuco:11x8:30:22 (squares; square, marker: mm).",
        label="Board",
        form=r"chessboard:\d{1,3}x\d{1,3}:\d+(?:\.\d+)?|charuco:\d{1,3}x\d{1,3}:\d+(?:\.\d+)?:\d+(?:\.\d+)?",
        example="chessboard:9x6:25 or charuco:11x8:30:22",
    )
    out: Path = option(..., "Where to write calibration.yml; its report goes beside it.", flags=OUT)
    replace: bool = option(
        False,
        "Let an earlier calibration of that name, and its report, give way.",
        label="Replace",
        flags=("--replace",),
    )


class CaptureSegment(Command):
    """Of `capture segment`."""

    capture: Path = argument("Folder of the capture.")
    method: str | None = option(None, "plate or threshold; default: plate if the capture has one, else threshold.")
    threshold: int | None = option(
        None,
        "Grey levels by which the object differs from the plate, or its least brightness without one.",
        ge=1,
        le=254,
        label="Threshold",
    )
    scribbles: Path | None = option(
        None, "Folder of pictures, or JSON, with strokes on key frames; replaces the method."
    )


class CaptureCheck(Command):
    """Of `capture check`."""

    capture: Path = argument("Folder of the capture.")
    report: Path | None = option(None, "Folder for report.html (with thumbnails) and report.json.")
