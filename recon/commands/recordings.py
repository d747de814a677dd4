"""The settings of the commands on recordings that jobs run, too."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field

from recon.commands.setting import NUMBER, Argument, Command, Setting
from recon.commands.shared import out

TEMPLE_PAIRS = "13-14,20-21,27-28"  # three sensors on one joint spot in Middlebury's templeRing


class CaptureImport(Command):
    """Of `capture import`."""

    format: Annotated[
        str,
        Argument(
            "Format of the source: middlebury, opencv, colmap, nerfstudio, meshroom or json.",
            label="Format",
            note="what the recording comes with",
            choices={
                "opencv": "pictures or videos with a calibration.yml",
                "colmap": "COLMAP's model",
                "nerfstudio": "nerfstudio's transforms.json",
                "meshroom": "Meshroom's cameras",
                "middlebury": "Middlebury's multi-view data sets",
                "json": "a JSON file of cameras",
            },
        ),
    ]
    source: Annotated[Path, Argument("Folder of the recording, or its calibration or JSON file.")]
    out: Annotated[Path, Argument("Folder to make; must be empty or absent.")]
    pairs: Annotated[
        str | None,
        Setting(
            "LEFT-RIGHT view numbers of each stereo sensor, comma-separated: IMAGE_IDs of colmap, viewIds of "
            f"meshroom, places in nerfstudio's frames from 1. Default for middlebury: {TEMPLE_PAIRS}.",
            label="Pairs",
            note="view numbers LEFT-RIGHT of each stereo sensor; colmap, nerfstudio, meshroom, middlebury",
            form=r"\d+-\d+(?:,\d+-\d+)*",
            example="13-14,20-21",
        ),
    ] = None
    frames: Annotated[
        int | None,
        Setting(
            "Frames to take; default: all (middlebury: 3).",
            label="Number of frames",
            note="to take; empty: all",
            high=1e6,
        ),
    ] = Field(None, ge=1)
    bounds: Annotated[
        str | None,
        Setting(
            "x0,y0,z0,x1,y1,z1 in mm; default: the source's own bounding box.",
            label="Bounds",
            note="x0,y0,z0,x1,y1,z1 in mm; empty: the source's own",
            form=rf"{NUMBER}(?:,{NUMBER}){{5}}",
            example="-500,0,-500,500,2000,500",
        ),
    ] = None
    units: Annotated[
        str | None,
        Setting(
            "Unit of the source's lengths: mm, cm, m, in, or a number of mm.",
            label="Unit of lengths",
            note="mm, cm, m, in, or a number of mm; empty: as the source says",
            form=r"mm|cm|m|in|\d+(?:\.\d+)?",
            example="m",
        ),
    ] = None
    up: Annotated[
        str | None,
        Setting(
            "Which axis of the source points upwards: x, -x, y, -y, z or -z. Default: as the source says, else y.",
            label="Upwards",
            note="axis of the source; empty: as the source says, else y",
            choices={axis: axis for axis in ("x", "-x", "y", "-y", "z", "-z")},
        ),
    ] = None
    fps: Annotated[
        float | None,
        Setting(
            "Frames a second; default: as the videos, else 25.",
            label="Frames a second",
            note="empty: as the videos, else 25",
            high=1000,
        ),
    ] = Field(None, ge=0.01)
    name: Annotated[str | None, Setting("The scene's name; default: the source's.")] = None
    shots: Annotated[str | None, Setting("For json: names of the shots to take as frames, comma-separated.")] = None


class CaptureCalibrate(Command):
    """Of `capture calibrate`."""

    images: Annotated[
        list[Path],
        Argument("A folder with left and right (folders or videos), one such folder per sensor, or one per camera."),
    ]
    board: Annotated[
        str,
        Setting(
            "chessboard:9x6:25 (inner corners, square in mm) or charuco:11x8:30:22 (squares; square, marker: mm).",
            label="Board",
            note="chessboard:COLUMNSxROWS:SQUARE with inner corners and mm, or charuco:COLUMNSxROWS:SQUARE:MARKER "
            "with squares and mm",
            form=r"chessboard:\d{1,3}x\d{1,3}:\d+(?:\.\d+)?|charuco:\d{1,3}x\d{1,3}:\d+(?:\.\d+)?:\d+(?:\.\d+)?",
            example="chessboard:9x6:25 or charuco:11x8:30:22",
        ),
    ]
    out: Annotated[Path, out("Where to write calibration.yml; its report goes beside it.")]
    replace: Annotated[
        bool,
        Setting(
            "Let an earlier calibration of that name, and its report, give way.",
            label="Replace",
            note="an earlier calibration there, with its report",
            flags=("--replace",),
        ),
    ] = False


class CaptureSegment(Command):
    """Of `capture segment`."""

    capture: Annotated[Path, Argument("Folder of the capture.")]
    method: Annotated[
        str | None, Setting("plate or threshold; default: plate if the capture has one, else threshold.")
    ] = None
    threshold: Annotated[
        int | None,
        Setting(
            "Grey levels by which the object differs from the plate, or its least brightness without one.",
            label="Threshold",
            note="grey levels of difference from the clean plate, of brightness without one; empty: chosen",
        ),
    ] = Field(None, ge=1, le=254)
    scribbles: Annotated[
        Path | None, Setting("Folder of pictures, or JSON, with strokes on key frames; replaces the method.")
    ] = None


class CaptureCheck(Command):
    """Of `capture check`."""

    capture: Annotated[Path, Argument("Folder of the capture.")]
    report: Annotated[Path | None, Setting("Folder for report.html (with thumbnails) and report.json.")] = None
