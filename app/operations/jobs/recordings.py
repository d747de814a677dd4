"""Jobs on recordings: check, calibrate, import and segment."""

from __future__ import annotations

import re

from app.errors import InvalidError
from app.intake.captures import CAPTURE_FILE
from app.intake.strokes import STROKES_FILE
from app.operations.jobs.fields import Choice, Entry, NewName, Number, Switch, Text, Values, place
from app.operations.jobs.kind import JobKind, named
from app.operations.jobs.shared_fields import CAPTURE, report_name
from app.settings import Settings

CALIBRATION_FILE = "calibration.yml"
CALIBRATED = (CALIBRATION_FILE, "calibration_report")  # what a calibration makes
NUMBER = r"-?\d+(?:\.\d+)?"


CAPTURE_NAME = NewName(
    name="name",
    label="Name",
    help="of the new capture and its scene",
    shelf="captures",
    pattern="{source}-capture",
)


def _scene_name(values: Values, _settings: Settings) -> list[str]:
    """Return the option for the scene's name; without a name in the form, the source tells it."""
    is_made = re.fullmatch(rf"{re.escape(CAPTURE_NAME.by_pattern(values))}(?:-\d+)?", values["name"])
    return [] if is_made else [f"--name={values['name']}"]


def _calibrated(values: Values) -> tuple[str, str]:
    """Return where a calibration goes: to the recording of the same cameras, else beside the pictures."""
    recording = values.get("recording")
    return ("captures", recording) if recording else ("calibration", values["pictures"])


def _refuse_second_calibration(values: Values, settings: Settings) -> list[str]:
    shelf, name = _calibrated(values)
    folder = place(settings, shelf) / name
    if any((folder / made).exists() for made in CALIBRATED) and not values.get("replace"):
        raise InvalidError(f"{shelf}/{name} has a calibration already. Switch on Replace if it is to give way.")
    return []


def _strokes(values: Values, settings: Settings) -> list[str]:
    """Return the option for strokes that were drawn on frames of the capture."""
    if values["method"] != "strokes":
        return [f"--method={values['method']}"] if values["method"] != "auto" else []
    path = place(settings, "captures") / values["capture"] / STROKES_FILE
    if not path.is_file():
        raise InvalidError(f"{values['capture']} has no strokes yet; draw some on its frames first.")
    return [f"--scribbles={path}"]


RECORDINGS = (
    JobKind(
        name="check",
        title="Check a capture",
        help="Lists everything that is wrong with a recording, with pictures of each sensor.",
        command=("capture", "check"),
        fields=(CAPTURE, report_name("{capture}-check")),
        out_option="--report",
        output=named("runs"),
    ),
    JobKind(
        name="calibrate",
        title="Calibrate cameras",
        help="Finds cameras, stereo pairs and the sensors' places from pictures of a board.",
        command=("capture", "calibrate"),
        fields=(
            Entry(
                name="pictures",
                label="Pictures of the board",
                help="a folder with left and right, or with such a folder for every sensor",
                shelves=("calibration",),
                is_required=True,
            ),
            Text(
                name="board",
                label="Board",
                help="chessboard:COLUMNSxROWS:SQUARE with inner corners and mm, or charuco:COLUMNSxROWS:SQUARE:MARKER "
                "with squares and mm",
                option="--board",
                is_required=True,
                form=r"chessboard:\d{1,3}x\d{1,3}:\d+(?:\.\d+)?|charuco:\d{1,3}x\d{1,3}:\d+(?:\.\d+)?:\d+(?:\.\d+)?",
                example="chessboard:9x6:25 or charuco:11x8:30:22",
            ),
            Entry(
                name="recording",
                label="Recording by these cameras",
                help="gets the calibration.yml, with which it can be imported; none: it stays beside the pictures",
                shelves=("captures",),
            ),
            Switch(
                name="replace",
                label="Replace",
                help="an earlier calibration there, with its report",
                option="--replace",
            ),
        ),
        output=_calibrated,
        out_file=CALIBRATION_FILE,
        more=_refuse_second_calibration,
    ),
    JobKind(
        name="import-recording",
        title="Import a recording",
        help="Makes a capture of a recording with a calibration of OpenCV, COLMAP, nerfstudio, Meshroom or others.",
        command=("capture", "import"),
        fields=(
            Choice(
                name="format",
                label="Format",
                help="what the recording comes with",
                is_required=True,
                choices={
                    "opencv": "pictures or videos with a calibration.yml",
                    "colmap": "COLMAP's model",
                    "nerfstudio": "nerfstudio's transforms.json",
                    "meshroom": "Meshroom's cameras",
                    "middlebury": "Middlebury's multi-view data sets",
                    "json": "a JSON file of cameras",
                },
            ),
            Entry(
                name="source",
                label="Recording",
                help="its folder",
                shelves=("captures",),
                lacks=CAPTURE_FILE,
                is_required=True,
            ),
            CAPTURE_NAME,
            Text(
                name="pairs",
                label="Pairs",
                help="view numbers LEFT-RIGHT of each stereo sensor; colmap, nerfstudio, meshroom, middlebury",
                option="--pairs",
                form=r"\d+-\d+(?:,\d+-\d+)*",
                example="13-14,20-21",
            ),
            Number(
                name="frames",
                label="Number of frames",
                help="to take; empty: all",
                option="--frames",
                low=1,
                high=1e6,
                is_whole=True,
            ),
            Text(
                name="bounds",
                label="Bounds",
                help="x0,y0,z0,x1,y1,z1 in mm; empty: the source's own",
                option="--bounds",
                form=rf"{NUMBER}(?:,{NUMBER}){{5}}",
                example="-500,0,-500,500,2000,500",
            ),
            Text(
                name="units",
                label="Unit of lengths",
                help="mm, cm, m, in, or a number of mm; empty: as the source says",
                option="--units",
                form=r"mm|cm|m|in|\d+(?:\.\d+)?",
                example="m",
            ),
            Choice(
                name="up",
                label="Upwards",
                help="axis of the source; empty: as the source says, else y",
                option="--up",
                choices={axis: axis for axis in ("x", "-x", "y", "-y", "z", "-z")},
            ),
            Number(
                name="fps",
                label="Frames a second",
                help="empty: as the videos, else 25",
                option="--fps",
                low=0.01,
                high=1000,
            ),
        ),
        out_option="",
        output=named("captures"),
        more=_scene_name,
    ),
    JobKind(
        name="segment",
        title="Segment a capture",
        help="Writes masks of the foreground into the capture.",
        command=("capture", "segment"),
        fields=(
            CAPTURE,
            Choice(
                name="method",
                label="Method",
                option=None,
                default="auto",
                choices={
                    "auto": "clean plate if the capture has one, else threshold",
                    "plate": "difference from a picture without the object",
                    "threshold": "brighter than a dark background",
                    "strokes": "strokes drawn on some of its frames",
                },
            ),
            Number(
                name="threshold",
                label="Threshold",
                help="grey levels of difference from the clean plate, of brightness without one; empty: chosen",
                option="--threshold",
                low=1,
                high=254,
                is_whole=True,
            ),
        ),
        out_option=None,
        output=lambda values: ("captures", values["capture"]),
        more=_strokes,
    ),
)
