from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from app.files import packaged
from app.study.languages.language_pack import SHIPPED
from tests.command_line import Command


def test_packs_are_listed_with_those_of_the_data_folder_and_the_reason_of_a_refusal(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RECONSTUDY_DATA_DIR", str(tmp_path))
    (tmp_path / "languages").mkdir()
    shutil.copy(packaged(SHIPPED) / "ar.json", tmp_path / "languages/ar.json")
    (tmp_path / "languages/pl.json").write_text("{", encoding="utf-8")
    outcome = command("languages", "--json")
    assert outcome.code == 0
    rows = {(row["tag"], row["in_use"]): row for row in json.loads(outcome.out)["languages"]}
    assert rows["ar", True]["path"] == str(tmp_path / "languages/ar.json")
    assert rows["ar", False]["direction"] == "rtl"
    assert rows["en", True]["status"] == "reviewed"
    assert "pl.json: it cannot be read as JSON" in rows["pl", False]["refusal"]


def test_a_check_names_every_fault_and_ends_with_1(command: Command, tmp_path: Path) -> None:
    content = json.loads((packaged(SHIPPED) / "fr.json").read_text(encoding="utf-8"))
    content["trial"] |= {"question": "", "label": "Paire {n}"}
    path = tmp_path / "fr.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    outcome = command("languages", "check", path)
    assert outcome.code == 1
    assert outcome.out.splitlines() == [
        f"{path}: trial.label has the placeholders {{n}}, expected {{number}}, {{total}}",
        f"{path}: trial.question is empty, expected a text",
    ]


def test_a_whole_pack_passes_its_check(command: Command) -> None:
    outcome = command("languages", "check", packaged(SHIPPED) / "zh.json")
    assert (outcome.code, outcome.out.endswith("zh.json: complete\n")) == (0, True)
