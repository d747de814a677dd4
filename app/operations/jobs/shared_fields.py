"""Fields that several kinds of jobs share."""

from __future__ import annotations

from app.intake.captures import CAPTURE_FILE
from app.operations.jobs.fields import Entry, NewName, Text

NAME_FORM = r"[^\W_][\w .+-]*"  # of datasets and approaches

CAPTURE = Entry(
    name="capture",
    label="Capture",
    help="recording in the capture format",
    shelves=("captures",),
    holds=CAPTURE_FILE,
    is_required=True,
)
FRAMES = Text(
    name="frames",
    label="Frames",
    help="A:B for the frames A to B-1; empty: all",
    option="--frames",
    form=r"\d*:\d*",
    example="0:25",
)
PRACTICE = Text(
    name="practice",
    label="Scene for practice",
    help="one with two films; empty: none",
    option="--practice",
    form=NAME_FORM,
    example="box",
)


def report_name(pattern: str) -> NewName:
    """Return the field of a report's name."""
    return NewName(name="name", label="Name", help="of the report's folder", shelf="runs", pattern=pattern)
