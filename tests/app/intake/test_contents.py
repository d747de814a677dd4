"""What an entry of the intake folder shows."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from app.intake.contents import read_contents


def test_a_figure_in_several_forms_is_shown_once(tmp_path: Path) -> None:
    for name in ("curve.svg", "curve.png", "curve.pdf", "cells.png", "below/curve.png"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.touch()
    contents = read_contents(tmp_path)
    assert contents.pictures == ["below/curve.png", "cells.png", "curve.svg"]
    assert "curve.png" in contents.sizes


def test_a_file_that_the_server_may_not_read_is_not_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("closed.ply", "closed.csv", "open.csv"):
        (tmp_path / name).touch()
    monkeypatch.setattr(os, "access", lambda path, _: Path(path).stem != "closed")
    contents = read_contents(tmp_path)
    assert contents.tables == list(contents.sizes) == ["open.csv"]
