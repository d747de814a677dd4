"""Resuming: what is finished is not made again, and what is not finished is."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.experiment.reconstruction.folder import MEASURING
from app.experiment.reconstruction.scenes import RECORDING
from recon.runtime.artefacts import Artefacts, code_version, file_digest


def write_text(text: str):  # type: ignore[no-untyped-def]
    return lambda path: (path.parent.mkdir(exist_ok=True, parents=True), path.write_text(text))


def test_an_artefact_is_made_once(tmp_path: Path) -> None:
    artefacts = Artefacts(tmp_path)
    assert artefacts.make("a/b.txt", {"input": 1}, write_text("one"))
    assert not artefacts.make("a/b.txt", {"input": 1}, write_text("two"))
    assert (tmp_path / "a/b.txt").read_text() == "one"
    assert artefacts.digest("a/b.txt") == file_digest(tmp_path / "a/b.txt")


def test_another_input_makes_it_again(tmp_path: Path) -> None:
    artefacts = Artefacts(tmp_path)
    artefacts.make("b.txt", {"input": 1}, write_text("one"))
    assert artefacts.make("b.txt", {"input": 2}, write_text("two"))
    assert (tmp_path / "b.txt").read_text() == "two"


@pytest.mark.parametrize("damage", [lambda path: path.write_text("changed"), lambda path: path.unlink()])
def test_a_damaged_or_missing_artefact_is_made_again(tmp_path: Path, damage) -> None:  # type: ignore[no-untyped-def]
    artefacts = Artefacts(tmp_path)
    artefacts.make("b.txt", {}, write_text("one"))
    damage(tmp_path / "b.txt")
    assert artefacts.make("b.txt", {}, write_text("one"))
    assert (tmp_path / "b.txt").read_text() == "one"


@pytest.mark.parametrize("note", ["", "[]", "\0" * 99])
def test_an_artefact_with_a_damaged_note_is_made_again(tmp_path: Path, note: str) -> None:
    artefacts = Artefacts(tmp_path)
    artefacts.make("b.txt", {}, write_text("one"))
    (tmp_path / ".finished/b.txt.json").write_text(note)
    assert artefacts.make("b.txt", {}, write_text("two")) == ["b.txt"]
    assert artefacts.digest("b.txt") == file_digest(tmp_path / "b.txt")


def test_a_folder_that_was_copied_without_its_hidden_ones_is_told_so(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"says how b\.txt was made: copy a folder with its hidden ones"):
        Artefacts(tmp_path).digest("b.txt")


def test_an_artefact_whose_making_failed_does_not_count(tmp_path: Path) -> None:
    artefacts = Artefacts(tmp_path)
    artefacts.make("b.txt", {"input": 1}, write_text("one"))

    def fail(path: Path) -> None:
        path.write_text("half")
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        artefacts.make("b.txt", {"input": 2}, fail)
    assert artefacts.make("b.txt", {"input": 1}, write_text("one"))


def test_the_order_of_a_keys_entries_does_not_matter(tmp_path: Path) -> None:
    artefacts = Artefacts(tmp_path)
    artefacts.make("b.txt", {"x": 1, "y": [2]}, write_text("one"))
    assert not artefacts.make("b.txt", {"y": [2], "x": 1}, write_text("one"))


def test_the_code_version_tells_modules_apart() -> None:
    assert code_version("depth") != code_version("cloud.py")


@pytest.mark.parametrize("sources", [RECORDING, MEASURING])
def test_the_modules_that_the_experiments_results_depend_on_are_there(sources: tuple[str, ...]) -> None:
    assert code_version(*sources)
