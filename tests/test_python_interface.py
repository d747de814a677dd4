"""The Python interface is what its page says, and its notebook runs."""

from __future__ import annotations

import importlib
import inspect
import json
import re
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

DOCS = Path(__file__).parent.parent / "docs"


def listed() -> list[tuple[str, list[str]]]:
    """Each package of the page's table with its names."""
    rows = re.findall(r"^\| `([\w.]+)` \| (.*) \|$", (DOCS / "python.md").read_text(encoding="utf-8"), re.MULTILINE)
    return [(package, re.findall(r"`(\w+)`", names)) for package, names in rows]


@pytest.mark.parametrize(("package", "names"), listed(), ids=lambda value: value if isinstance(value, str) else "")
def test_the_page_lists_the_public_names_and_each_is_described(package: str, names: list[str]) -> None:
    module = importlib.import_module(package)
    assert sorted(names) == sorted(module.__all__)
    described = [getattr(module, name) for name in names]
    described = [value for value in described if inspect.isfunction(value) or inspect.isclass(value)]
    assert described
    assert [value.__name__ for value in described if not value.__doc__] == []


@pytest.mark.slow
def test_the_notebook_goes_from_a_recording_to_scores(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    cells = json.loads((DOCS / "python.ipynb").read_text(encoding="utf-8"))["cells"]
    assert [cell for cell in cells if cell.get("outputs")] == []
    names: dict[str, Any] = {}
    for cell in cells:
        if cell["cell_type"] == "code":
            assert len(cell["source"]) <= 15
            exec("".join(cell["source"]), names)  # the reader's own steps
    assert np.median(np.abs(names["errors"])) < 4
    assert (names["film"].n_frames, names["film"].width) == (25, 480)
    assert names["run"]["approaches"] == ["id_fa", "id_fb", "dr_fa", "dr_fb"]
    best_first = names["scores"].query("comparison == 'all' and dataset == 'all'").sort_values("score", ascending=False)
    assert best_first["item"].tolist() == ["dr_fb", "dr_fa", "id_fb"]
    assert "vertices" in capsys.readouterr().out
