"""What an entry of the intake folder shows."""

from __future__ import annotations

from pathlib import Path

from app.intake.contents import read_contents


def test_a_figure_in_several_forms_is_shown_once(tmp_path: Path) -> None:
    for name in ("curve.svg", "curve.png", "curve.pdf", "cells.png", "below/curve.png"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.touch()
    contents = read_contents(tmp_path)
    assert contents.pictures == ["below/curve.png", "cells.png", "curve.svg"]
    assert "curve.png" in contents.sizes
