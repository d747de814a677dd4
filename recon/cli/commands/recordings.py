"""The settings of the commands on recordings."""

from __future__ import annotations

from pathlib import Path

from recon.cli.commands.setting import NUMBER, OUT, Command, argument, option

TEMPLE_PAIRS = "13-14,20-21,27-28"  # three sensors on one joint spot in Middlebury's templeRing

IMPORTED = {  # what each format is called, for people; `recon.capture.importing.formats` reads them
    "auto": "whatever its files say",
    "opencv": "pictures or videos with a calibration.yml",
    "colmap": "COLMAP's model",
    "nerfstudio": "nerfstudio's transforms.json",
    "meshroom": "Meshroom's cameras",
    "ros": "ROS's camera_info, left.yaml and right.yaml",
    "kalibr": "Kalibr's camchain",
    "euroc": "EuRoC's mav0/cam0/sensor.yaml",
    "matlab": "MATLAB's stereoParameters as a struct",
    "middlebury": "Middlebury's multi-view data sets",
    "middlebury-pair": "Middlebury's and ETH3D's stereo pairs with calib.txt",
    "eth3d": "ETH3D's multi-view data sets",
    "kitti": "KITTI's recordings",
    "strecha": "Strecha's .camera files",
    "mvsnet": "MVSNet's and DTU's cam.txt",
    "miv": "MPEG's MIV content",
    "tum": "TUM's RGB-D benchmark",
    "scannet": "RGB-D folders as those of ScanNet",
    "rosbag": "a bag of ROS 1 or 2, also RealSense's",
    "kinect": "a recording of Azure Kinect or Femto",
    "json": "a JSON file of cameras",
}


class CaptureImport(Command):
    """Of `capture import`."""

    format: str = argument(
        f"Format of the source: {', '.join(IMPORTED)}; auto finds it by its files.",
        label="Format",
        note="found by the files, unless you say it",
        choices=IMPORTED,
    )
    source: Path = argument("Folder of the recording, or its calibration or JSON file.")
    out: Path = argument("Folder to make; must be empty or absent.")
    pairs: str | None = option(
        None,
        "LEFT-RIGHT view numbers of each stereo sensor, comma-separated: IMAGE_IDs of colmap, viewIds of meshroom, "
        f"places in nerfstudio's frames from 1, others as the import lists them. Default for middlebury: "
        f"{TEMPLE_PAIRS}.",
        label="Pairs",
        form=r"\d+-\d+(?:,\d+-\d+)*",
        example="13-14,20-21",
    )
    frames: int | None = option(
        None, "How many, from the first on; default: all (middlebury: 3).", ge=1, label="Number of frames", high=1e6
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
    shots: str | None = option(
        None,
        "For json: names of the shots to take as frames; for tum and scannet: of those that become sensors; for "
        "rosbag: topics. Comma-separated.",
    )


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
    resample: bool = option(
        False,
        "Write the recording anew with late sensors put right: by whole frames, or by pictures made between two; needs "
        "--out.",
        flags=("--resample",),
    )
    correct: bool = option(
        False,
        "Write the recording anew with a small correction of the sensors whose rows are apart; needs --out.",
        flags=("--correct",),
    )
    out: Path | None = option(None, "Folder to make for --resample and --correct; must be empty or absent.", flags=OUT)


class CaptureSynth(Command):
    """Of `capture synth`."""

    out: Path = argument("Folder to make; must be empty or absent.")
    scene: str = option("ball", "Scene: ball, box, people, standing, face, sphere or cuboid.")
    sensors: int = option(3, "How many stereo sensors.", ge=1)
    frames: int = option(25, "How many frames; together they show one period of the motion.", ge=1)
    size: str = option("1280x720", "WIDTHxHEIGHT of every camera, pixels.")
    noise: float = option(1.5, "Sensor noise, grey levels (standard deviation).", ge=0)
    fps: float = option(25.0, "Frames a second.", gt=0)
    position: str = option("0,0,0", "Where the sphere or the cuboid is: x,y,z in mm from the centre.")
    exposure_spread: float = option(0.02, "How much the cameras' exposures differ, as a share.", ge=0)
    calibration_error: float = option(0.0, "Error of the calibration, pixels.", ge=0)
    distortion: float = option(0.0, "About the lenses' k1 in OpenCV's model; -0.1 is usual.")
    depth_maps: bool = option(
        False, "Record by single cameras with depth maps instead of by stereo pairs.", flags=("--depth-maps",)
    )
    late: list[str] | None = option(
        None, "SENSOR=FRAMES, such as S3=0.5: its pictures show what was so many frames earlier; may be repeated."
    )
    shutter: float = option(
        0.0, "MS that the shutter is open: what moves is blurred.", ge=0, metavar="MS", flags=("--shutter",)
    )
    rolling_shutter: bool = option(
        False, "Take the rows of a picture one after the other, within 20 ms.", flags=("--rolling-shutter",)
    )
    colour_cast: float = option(0.0, "How much the cameras' red, green and blue differ, as a share; 0.1 shows.", ge=0)
    vignetting: float = option(0.0, "Share of the light that the pictures' corners lack.", ge=0)
    flicker: float = option(0.0, "How much the light flickers, as a share of it.", ge=0)
    compression: int | None = option(None, "Store JPEG of this quality, 1 to 100, instead of PNG.", ge=1, le=100)
    defocus: list[str] | None = option(
        None, "SENSOR=PIXELS, such as S1=1.5: it is out of focus by so much; may be repeated."
    )
    gloss: float = option(1.0, "How many times as much all surfaces shine.", ge=0)
    seed: int = option(1, "Seed; the same seed gives the same bytes.", ge=0)


class CaptureTruth(Command):
    """Of `capture truth`."""

    capture: Path = argument("Folder of a synthetic capture.")
    out: Path = option(..., "Folder of models to make; must be empty or absent.", flags=OUT)
    frames: str | None = option(
        None, "How many, from the first on, or A:B for A to B-1, as the runs have them; default: all."
    )


class CaptureExport(Command):
    """Of `capture export`."""

    kind: str = argument("Format to write: nerfstudio or colmap.", metavar="FORMAT")
    capture: Path = argument("Folder of the capture.")
    out: Path = argument("Folder to make; must be empty or absent.")
    frame: int = option(0, "Number of the frame to export.", ge=0)
    points: list[Path] | None = option(
        None, "PLY cloud in mm for splats to start from, such as RUN/clouds/pm/S1/0000.ply; may be repeated."
    )


class CaptureBoard(Command):
    """Of `capture board`."""

    board: str = argument("As `capture calibrate` takes it, for example charuco:14x10:50:37.")
    out: Path = option(..., "SVG file to write; it has the board's true size.", flags=OUT)


class CaptureMask(Command):
    """Of `capture mask`."""

    capture: Path = argument("Folder of the capture.")
    scribbles: Path = option(..., "Folder of pictures, or JSON, with strokes on the picture.")
    sensor: str = option(..., "Sensor of the picture, such as S1.")
    out: Path = option(..., "Where to write the mask, a PNG file.", flags=OUT)
    side: str = option("left", "Camera of the picture, left or right.")
    frame: int = option(0, "Frame of the picture.", ge=0)
