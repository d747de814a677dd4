"""Fields that several kinds of jobs share."""

from __future__ import annotations

from app.intake.captures import CAPTURE_FILE
from app.operations.jobs.fields import Entry, NewName

CAPTURE = Entry(
    name="capture",
    label="Capture",
    help="recording in the capture format",
    shelves=("captures",),
    holds=CAPTURE_FILE,
)


def report_name(pattern: str) -> NewName:
    """Return the field of a report's name."""
    return NewName(name="name", label="Name", help="of the report's folder", shelf="runs", pattern=pattern)
