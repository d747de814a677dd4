"""The check of a capture as one page that needs no other file, and as JSON beside it."""

from __future__ import annotations

import re
from base64 import b64encode
from collections.abc import Iterator, Mapping
from pathlib import Path

import cv2
import numpy as np

from recon.capture.checking.check import CheckReport
from recon.capture.checking.continuity import Glance
from recon.capture.recording import evenly_chosen
from recon.runtime.files import check_replaceable, write_bytes, write_json
from recon.runtime.pages import report_page

REPORT, PAGE = "report.json", "report.html"
MAX_THUMBNAILS = 12  # of a camera, evenly over its frames
FRAME = re.compile(r"\{frame[^}]*\}")  # in a camera's pattern of images


def check_place(out: Path) -> None:
    """Raise a ValueError if a folder holds files of something else that the report of a check would overwrite."""
    check_replaceable(out, (REPORT, PAGE), ("verdicts", "problems"), "check of a capture")


def write_check(report: CheckReport, out: Path) -> Path:
    """Write `report.html` and `report.json` into a folder and return the page's path; a ValueError as `check_place`."""
    check_place(out)
    write_json(out / REPORT, report.as_json())
    return write_bytes(out / PAGE, check_page(report))


def check_page(report: CheckReport) -> bytes:
    """Render the page as HTML, with its pictures inside."""
    cameras = [(FRAME.sub("…", image), list(_thumbnails(by_frame))) for image, by_frame in report.glances.items()]
    content = {"report": report, "name": Path(report.folder).name, "cameras": cameras}
    return report_page("recon.capture.checking", content)


def _thumbnails(by_frame: Mapping[int, Glance]) -> Iterator[tuple[int, str]]:
    """Yield frames of a camera, evenly chosen, each with its picture as JPEG in base64."""
    frames = sorted(by_frame)
    for frame in (frames[index] for index in evenly_chosen(len(frames), MAX_THUMBNAILS)):
        jpeg = cv2.imencode(".jpg", by_frame[frame].thumbnail.astype(np.uint8))[1].tobytes()
        yield frame, b64encode(jpeg).decode()
