"""Fields that several kinds of jobs share."""

from __future__ import annotations

from typing import Any

from app.intake.captures import CAPTURE_FILE
from app.operations.jobs.fields import Entry, NewName, Text
from app.settings import Settings

NAME_FORM = r"[^\W_][\w .+-]*"  # of datasets and approaches
NAMES_FORM = rf"{NAME_FORM}(?:, *{NAME_FORM})*"


class FrameRange(Text):
    """A range of frames, of which there is at least one."""

    def checked(self, given: Any, settings: Settings) -> str:
        """Return the range, whose end comes after its beginning."""
        text = super().checked(given, settings)
        first, _, end = text.partition(":")
        if end and int(end) <= int(first or 0):
            raise self.refuse(given, f"an end after the first frame, for example {self.example}")
        return text


CAPTURE = Entry(
    name="capture",
    label="Capture",
    help="recording in the capture format",
    shelves=("captures",),
    holds=CAPTURE_FILE,
    is_required=True,
)
FRAMES = FrameRange(
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
