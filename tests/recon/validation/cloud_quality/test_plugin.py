"""Measures of installed packages, and the contract that they keep."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from recon.contract import check_measure
from recon.validation.cloud_quality import PointSet, Value
from tests.command_line import Command
from tests.installed_package import install
from tests.recon.validation.cloud_quality.clouds import ball, table, validate, write

CENTROID = """
import numpy as np
from recon.validation.cloud_quality import Value

def centroid(reference, distorted):
    print("this is no JSON")
    shift = distorted.points.mean(axis=0, dtype=float) - reference.points.mean(axis=0, dtype=float)
    return [Value("centroid_shift", float(np.linalg.norm(shift)), "mm", "lower")]

def broken(reference, distorted):
    return 3

def stumbling(reference, distorted):
    return {}["colours"]
"""


def test_an_installed_measure_stands_beside_ours(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    entries = "[reconstudy.measures]\n" + "".join(
        f"{name} = their_centroid:{name}\n" for name in ("centroid", "broken", "stumbling")
    )
    install(tmp_path, "their_centroid", CENTROID, entries)
    reference = write(tmp_path / "reference.ply", ball())
    moved = PointSet("moved", ball().points + np.float32([3, 0, 4]))
    cloud = write(tmp_path / "moved.ply", moved)
    out = tmp_path / "report"
    report = validate(command, out, cloud, "--reference", reference, "--measures", "centroid,broken,stumbling")
    (row,) = table(out)
    assert row["measure"] == "centroid_shift"
    assert float(row["value"]) == pytest.approx(5, rel=1e-5)
    assert row["source"] == "plug-in centroid of their_centroid 1.0"
    assert {skipped["measure"]: skipped["reason"] for skipped in report["skipped"]} == {
        name: f"plug-in {name} of their_centroid 1.0 failed: {error}"
        for name, error in (
            ("broken", "TypeError('it returned 3, expected a list of Value')"),
            ("stumbling", "KeyError('colours')"),
        )
    }


def mean_distance(reference: PointSet, distorted: PointSet) -> list[Value]:
    differences = distorted.points.mean(axis=0) - reference.points.mean(axis=0)
    return [Value("shift", float(np.linalg.norm(differences)), "mm", "lower")]


def needs_colours(reference: PointSet, distorted: PointSet) -> list[Value]:
    if reference.colours is None or distorted.colours is None:
        raise ValueError("there are no colours")
    return [Value("brightness", float(-abs(int(reference.colours.sum()) - int(distorted.colours.sum()))), "", "higher")]


@pytest.mark.parametrize("measure", [mean_distance, needs_colours])
def test_a_sound_measure_keeps_the_contract(measure: Callable[[PointSet, PointSet], list[Value]]) -> None:
    check_measure(measure)


def changes_its_input(_reference: PointSet, distorted: PointSet) -> list[Value]:
    distorted.points[0] += 1
    return [Value("x", 1.0, "", "lower")]


def rewards_noise(reference: PointSet, distorted: PointSet) -> list[Value]:
    return [Value("x", value.value, "", "higher") for value in mean_distance(reference, distorted)]


def stumbles(reference: PointSet, _distorted: PointSet) -> list[Value]:
    assert reference.colours is not None
    return [Value("x", float(reference.colours[0, 0]), "", "lower")]


def draws_lots(_reference: PointSet, _distorted: PointSet) -> list[Value]:
    return [Value("x", float(np.random.default_rng().random()), "", "lower")]


@pytest.mark.parametrize(
    ("measure", "message"),
    [
        (lambda _reference, _distorted: [], "no value"),
        (lambda _reference, _distorted: 1.5, "expected a list of Value"),
        (lambda _reference, _distorted: [Value("x", float("nan"), "", "lower")], "expected a number"),
        (lambda _reference, _distorted: [Value("x", 1.0, "", "less")], "better lower or higher"),
        (lambda _reference, _distorted: [Value("x", 1.0, "", "lower")] * 2, "comes twice"),
        (changes_its_input, "changed the points"),
        (rewards_noise, "where higher is better"),
        (stumbles, "raised AssertionError"),
        (draws_lots, "other values for the same clouds"),
    ],
)
def test_a_measure_that_breaks_the_contract_is_told_how(
    measure: Callable[[PointSet, PointSet], Sequence[Value]], message: str
) -> None:
    with pytest.raises(AssertionError, match=message):
        check_measure(measure)
