"""Jobs on recordings: check, calibrate, import and segment."""

from __future__ import annotations

import re

from app.errors import InvalidError
from app.intake.captures import CAPTURE_FILE
from app.intake.strokes import STROKES_FILE
from app.operations.jobs.fields import Choice, Entry, NewName, Values, place
from app.operations.jobs.kind import JobKind
from app.operations.jobs.shared_fields import CAPTURE, report_name
from app.settings import Settings

CALIBRATION_FILE = "calibration.yml"
CALIBRATED = (CALIBRATION_FILE, "calibration_report")  # what a calibration makes


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
        command="capture check",
        places={"capture": CAPTURE, "report": report_name("{capture}-check")},
    ),
    JobKind(
        name="calibrate",
        title="Calibrate cameras",
        help="Finds cameras, stereo pairs and the sensors' places from pictures of a board.",
        command="capture calibrate",
        places={
            "images": Entry(
                name="pictures",
                label="Pictures of the board",
                help="a folder with left and right, or with such a folder for every sensor",
                shelves=("calibration",),
            ),
            "out": Entry(
                name="recording",
                label="Recording by these cameras",
                help="gets the calibration.yml, with which it can be imported; none: it stays beside the pictures",
                option=None,
                shelves=("captures",),
            ),
        },
        changes=_calibrated,
        out_file=CALIBRATION_FILE,
        more=_refuse_second_calibration,
    ),
    JobKind(
        name="import-recording",
        then=("reconstruct", "render"),
        title="Import a recording",
        help="Makes a capture of a recording whose cameras a program has calibrated or placed, or of a depth camera's.",
        command="capture import",
        places={
            "source": Entry(
                name="source", label="Recording", help="its folder", shelves=("captures",), lacks=CAPTURE_FILE
            ),
            "out": CAPTURE_NAME,
        },
        more=_scene_name,
    ),
    JobKind(
        name="segment",
        then=("reconstruct", "render"),
        title="Segment a capture",
        help="Writes masks of the foreground into the capture.",
        command="capture segment",
        places={
            "capture": CAPTURE,
            "method": Choice(
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
        },
        changes=lambda values: ("captures", values["capture"]),
        more=_strokes,
    ),
)
