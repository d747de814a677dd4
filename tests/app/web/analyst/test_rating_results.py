"""Results of studies in which participants rate: over REST, in the archive, on the dashboard, from exported votes."""

from __future__ import annotations

import io
import json
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from statistics import mean
from typing import Any
from uuid import uuid4

import httpx
import pytest

from app.analysis import analyse_ratings_file
from app.analysis.warnings import NOTHING_LEFT
from app.operations.studies.create import create_study
from app.operations.studies.manage import add_token, attach_results
from app.settings import Settings
from app.simulation.participants import simulate
from app.study.options.options import parse_options
from app.web.admin.results.scores_view import decimal
from app.web.analyst.columns import OBSERVERS, OBSERVERS_OF_RATINGS
from tests.app.web.admin.dashboard_client import Dashboard

pytestmark = pytest.mark.slow

QUALITIES = {"id_fa": -1.0, "id_fb": 0.0, "pm_fb": 1.5}
Rated = Callable[..., tuple[str, list[dict[str, Any]]]]


@pytest.fixture
def rated(settings: Settings, stimulus_set: Path, server: str, token: str, analyst: httpx.Client) -> Rated:
    """Creates a study that five simulated participants take; its path and votes."""

    def make(**options: Any) -> tuple[str, list[dict[str, Any]]]:
        chosen = parse_options(options)
        study = create_study(settings, stimulus_set, f"Study {uuid4()}", exposure_s=0.4, seed=1, options=chosen)
        simulate(server, study["slug"], study["invitation"], token, 5, QUALITIES, seed=2)
        path = f"/api/v1/studies/{study['slug']}"
        return path, analyst.get(f"{path}/votes").json()

    return make


def test_mean_opinion_scores_are_means_of_the_votes_and_are_compared_with_measures_everywhere(
    rated: Rated, analyst: httpx.Client, experimenter: Dashboard, settings: Settings, tmp_path: Path
) -> None:
    path, votes = rated(protocol="ACR-HR", reference="pm_fb", repeated_pairs=1)
    rows = analyst.get(f"{path}/ratings").json()
    assert len(rows) == 6
    for row in rows:
        counted = [
            vote["rating"]
            for vote in votes
            if (vote["dataset"], vote["item_b"], vote["role"]) == (row["dataset"], row["condition"], "main")
        ]
        assert row["mos"] == pytest.approx(mean(counted))
        assert row["is_reference"] == (row["condition"] == "pm_fb")
    observers = analyst.get(f"{path}/observers").json()
    assert [row["participant"] for row in observers] == [f"P00{n}" for n in range(1, 6)]
    assert list(observers[0]) == [*OBSERVERS, *OBSERVERS_OF_RATINGS]
    assert analyst.get(f"{path}/scores").json() == []
    with zipfile.ZipFile(io.BytesIO(analyst.get(f"{path}/archive.zip").content)) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith("/analysis.json"))
        assert json.loads(archive.read(name))["rating_items"] == rows
        exported = tmp_path / "votes.csv"
        exported.write_bytes(archive.read(name.replace("analysis.json", "votes.csv")))
    from_file = analyse_ratings_file(exported, tmp_path / "out")
    assert [(row["condition"], row["mos"], row["dmos"]) for row in from_file["rating_items"]] == [
        (row["condition"], row["mos"], row["dmos"]) for row in rows
    ]
    page = path.replace("/api/v1", "/admin")
    attached = tmp_path / "measures.csv"
    values = [
        f"{dataset},{item},{name},{sign * value},higher"
        for name, sign in (("noise", -1), ("sharpness", 1))
        for dataset in ("ball", "box")
        for item, value in QUALITIES.items()
    ]
    attached.write_text("\n".join(["dataset,approach,measure,value,better", *values, ""]), encoding="utf-8")
    attach_results(settings, [attached], path.rsplit("/", 1)[1])
    for tab in ("", "/results", "/votes", "/design?participants=6", "/stimuli", "/participants", "/objective", "/edit"):
        assert experimenter.get(f"{page}{tab}").status_code == 200, tab
    results = experimenter.get(f"{page}/results").text
    assert "pm_fb (reference)" in results
    overall = results.partition("<caption>all datasets</caption>")[2].partition("</table>")[0]
    means = {name: mean(row["mos"] for row in rows if row["condition"] == name) for name in QUALITIES}
    shown = re.findall(r">(\w+)</th><td>5</td><td>([\d.]+)<", overall)
    assert shown == [(name, decimal(means[name])) for name in sorted(means, key=means.__getitem__, reverse=True)]
    assert "DMOS" in results
    assert experimenter.get(f"{page}/figures/opinion_scores.svg").text.startswith("<svg")
    assert len(experimenter.get(f"{page}/figures/opinion_scores.csv").text.splitlines()) == 1 + len(rows)
    from_server = analyst.get(f"{path}/analysis").json()
    measured = analyse_ratings_file(exported, tmp_path / "measured", measures=attached)
    assert from_server["measures"] == measured["measures"]
    assert [row["n"] for row in measured["measures"]] == [3, 3, 6] * 2
    against = experimenter.get(f"{page}/objective/scores").text
    assert "its error in grades" in against
    side_by_side = against.partition("Side by side")[2]
    assert side_by_side.index("sharpness") < side_by_side.index("noise"), "the best predictor first"
    assert f"<td>{decimal(rows[0]['mos'])}</td>" in against
    assert "score (grades)" in experimenter.get(f"{page}/figures/measure_sharpness.svg").text


def test_comparisons_have_scores_by_strength_beside_those_by_choice(
    rated: Rated, analyst: httpx.Client, experimenter: Dashboard
) -> None:
    path, votes = rated(protocol="CCR")
    assert all(
        (vote["rating"] > 0) - (vote["rating"] < 0) == {"b": 1, "a": -1, "none": 0}[vote["choice"]] for vote in votes
    )
    strengths = analyst.get(f"{path}/comparisons").json()
    for dataset in ("ball", "box", "all"):
        scores = {row["condition"]: row["score"] for row in strengths if row["dataset"] == dataset}
        assert sorted(scores, key=scores.__getitem__) == sorted(QUALITIES, key=QUALITIES.__getitem__)
    choices = analyst.get(f"{path}/scores").json()
    assert {row["item"] for row in choices if row["comparison"] == "all"} == set(QUALITIES)
    assert "How much better" in experimenter.get(f"{path.replace('/api/v1', '/admin')}/results").text


def test_ratings_that_are_all_excluded_are_told_from_none(
    rated: Rated, analyst: httpx.Client, server: str, settings: Settings
) -> None:
    path, votes = rated(protocol="ACR")
    header = {"Authorization": f"Bearer {add_token(settings, f'manager {uuid4()}', ('participants:write',))['token']}"}
    for label in {vote["participant"] for vote in votes}:
        body = {"reason": "the screen was off"}
        answer = httpx.put(f"{server}{path}/participants/{label}/exclusion", json=body, headers=header, timeout=60)
        assert answer.status_code == 200
    assert analyst.get(f"{path}/ratings").json() == []
    assert analyst.get(f"{path}/analysis").json()["warnings"] == [NOTHING_LEFT]
