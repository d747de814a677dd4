"""A lab sheet keeps what was noted, and nothing else."""

from __future__ import annotations

from typing import Any

import pytest

from app.study.options.options import parse_options
from app.study.options.study_file import StudyFile, parse_study_file, write_study_file

NOTED = {
    "display": "ASUS VG278",
    "size_inch": 27.0,
    "peak_luminance_cd_m2": 250.0,
    "white_point": "5000 K",
    "room_light": "dark, controlled",
    "distance_cm": 90.0,
}


def test_a_lab_sheet_travels_with_the_study_file() -> None:
    options = parse_options({"lab_sheet": NOTED})
    read = parse_study_file(write_study_file(StudyFile(name="Lab", options=options))).options
    assert read.lab_sheet.as_json() == NOTED


def test_what_is_not_known_is_left_out_rather_than_written_as_nothing() -> None:
    sheet = parse_options({"lab_sheet": {"display": "  ", "size_inch": 27}}).lab_sheet
    assert sheet.as_json() == {"size_inch": 27.0}
    assert sheet.rows() == [("Size, inch", "27")]


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ({"colour": "grey"}, "'colour' is not known; expected some of display"),
        ({"size_inch": "27"}, "size_inch is '27', expected a number from 1 to 500"),
        ({"distance_cm": float("nan")}, "distance_cm is nan"),
        ({"peak_luminance_cd_m2": True}, "peak_luminance_cd_m2 is True"),
        ({"room_light": 20}, "room_light is .*, expected a text"),
        ("dark", "lab_sheet is 'dark', expected a table"),
    ],
)
def test_what_no_lab_sheet_can_hold_is_named(content: Any, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        parse_options({"lab_sheet": content})
