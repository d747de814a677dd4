from __future__ import annotations

import json
from html.parser import HTMLParser
from pathlib import Path

import pytest

from recon.capture.checking.check import check_capture
from recon.capture.checking.page import write_check
from recon.capture.format import image_path
from tests.command_line import Command
from tests.recon.capture.calibration.board_geometry import record_board


class Page(HTMLParser):
    """Counts tags and keeps the text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.mark.slow
def test_the_page_stands_alone_and_tells_what_the_json_tells(tmp_path: Path) -> None:
    board = record_board(tmp_path / "board", n_frames=2)
    image_path(board.folder, board.sensors[0].left.image, 1).unlink()
    report = check_capture(board.folder)
    page = Page(write_check(report, tmp_path / "report").read_text())
    images = [facts for tag, facts in page.tags if tag == "img"]
    assert len(images) == 7  # two sensors, two cameras, two frames, one missing
    assert all(str(facts["src"]).startswith("data:image/jpeg;base64,") and facts["alt"] for facts in images)
    assert "S1/left/….png" in page.text  # the camera, without the pattern of its files
    assert not any(tag in ("link", "script") for tag, _ in page.tags)
    write_check(report, tmp_path / "report")  # in the place of the first
    content = json.loads((tmp_path / "report/report.json").read_text())
    assert len(content["problems"]) == 1
    for sentence in (*content["problems"], *content["verdicts"]):
        assert sentence in page.text


def test_the_report_of_something_else_is_refused_before_anything_is_checked(command: Command, tmp_path: Path) -> None:
    (tmp_path / "report.json").write_text('{"kind": "mesh", "measures": []}', encoding="utf-8")
    told = command("capture", "check", tmp_path / "nowhere", "--report", tmp_path)
    assert f"{tmp_path}: holds report.json that no check of a capture wrote" in told.err
    assert [path.name for path in tmp_path.iterdir()] == ["report.json"]
