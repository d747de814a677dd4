"""A report that cannot be attached is refused with what is wrong in it."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.intake.reports import read_report


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        ('{"measures": [{"dataset": "a", "value": "x"}]}', "measures.0.approach is missing"),
        ('{"kind": "X1", "measures": []}', "kind is 'X1', expected 1 to 20 letters from a to z"),
        ("[]", r"the file is \[\], expected an object with keys"),
        ("{", "the file is no JSON"),
    ],
)
def test_a_damaged_report_is_refused_in_the_words_of_all_files(tmp_path: Path, content: str, fault: str) -> None:
    (tmp_path / "report.json").write_text(content)
    with pytest.raises(ValueError, match=fault):
        read_report(tmp_path / "report.json")
