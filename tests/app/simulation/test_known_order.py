"""What artificial people prefer is known, and comes back from their votes."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.analysis import votes_from_rows
from app.analysis.model.bradley_terry import fit_pairs
from app.experiment.demo import TIE_RATE
from app.simulation.known_order import STEP, came_back, came_out, came_out_sentence, known_order
from app.simulation.preference import choose
from recon.cli.commands.experiments import Demo

README = Path(__file__).parents[3] / "README.md"
FIVE_MINUTES = re.search(
    r"reconstruct .* --depth (\S+) --fusion fb(?s:.*)simulate .* --participants (\d+)", README.read_text()
)
SIX = [f"{depth}_{fusion}" for depth in ("id", "dr", "pm") for fusion in ("fa", "fb")]


def study_of(items: list[str], datasets: tuple[str, ...] = ("ball",), **others: Any) -> dict[str, Any]:
    levels = [dict(zip(("depth", "fusion"), item.split("_"), strict=False)) for item in items]
    return {
        "conditions": [{"item": item, "levels": level} for item, level in zip(items, levels, strict=True)],
        "stimuli": [{"dataset": dataset, "item": item} for dataset in datasets for item in items],
        "protocol": "PC",
        "reference": "",
    } | others


def measured(measure: str, values: Mapping[str, float], dataset: str = "ball") -> list[dict[str, Any]]:
    return [
        {"dataset": dataset, "approach": item, "measure": measure, "value": value, "better": "higher"}
        for item, value in values.items()
    ]


def voted_scores(abilities: Mapping[str, float], participants: int, tie_rate: float, seed: int) -> dict[str, float]:
    rng = np.random.default_rng(seed)
    votes = [
        {"participant": f"p{person}", "dataset": "ball", "item_a": a, "item_b": b}
        | {"choice": choose(abilities[a], abilities[b], tie_rate, rng)}
        for person in range(participants)
        for a, b in combinations(abilities, 2)
    ]
    fit = fit_pairs(votes_from_rows(votes))
    return dict(zip(fit.items, fit.theta[: len(fit.items)].tolist(), strict=True)) if fit.theta is not None else {}


@pytest.mark.slow
@pytest.mark.parametrize("place", ["demo", "README", "simulate"])
def test_the_known_order_comes_back_in_95_of_100_seeds(place: str) -> None:
    assert FIVE_MINUTES is not None
    depths, readers = FIVE_MINUTES.groups()
    items, participants = {
        "demo": (SIX, Demo.model_fields["participants"].default),
        "README": ([f"{depth}_fb" for depth in depths.split(",")], int(readers)),
        "simulate": (SIX, 22),
    }[place]
    abilities = known_order(study_of(items), []).abilities
    returns = [came_back(abilities, voted_scores(abilities, participants, TIE_RATE, seed)) for seed in range(100)]
    assert sum(returns) >= 95


def test_people_follow_what_was_measured_of_all_films() -> None:
    values = {"id_fa": 0.9, "id_fb": 0.8, "pm_fb": 0.7}
    partly = {"id_fa": 0.1, "id_fb": 0.2}
    order = known_order(study_of([*values]), measured("vmaf", values) + measured("ssim_actor", partly))
    assert order.abilities == {"id_fa": STEP, "id_fb": 0.0, "pm_fb": -STEP}
    assert "vmaf" in order.reason


def test_a_dataset_with_higher_values_favours_nobody_who_is_only_there() -> None:
    study = study_of(["x", "y"], ("ball",))
    study["stimuli"] += [{"dataset": "box", "item": "y"}, {"dataset": "box", "item": "z"}]
    rows = measured("ssim_actor", {"x": 0.5, "y": 0.4}) + measured("ssim_actor", {"y": 0.9, "z": 0.8}, "box")
    assert sorted(known_order(study, rows).abilities, key=known_order(study, rows).abilities.__getitem__) == [
        "z",
        "y",
        "x",
    ]


def test_films_that_measure_alike_are_liked_alike() -> None:
    abilities = known_order(study_of(["x", "y", "z"]), measured("vmaf", {"x": 9.0, "y": 9.0, "z": 1.0})).abilities
    assert abilities["x"] == abilities["y"] > abilities["z"]
    assert came_back(abilities, {"x": 0.1, "y": 0.4, "z": -0.5})


def test_where_nothing_was_measured_the_order_is_the_papers() -> None:
    order = known_order(study_of(SIX), [])
    assert sorted(SIX, key=order.abilities.__getitem__) == ["id_fa", "id_fb", "dr_fa", "pm_fa", "dr_fb", "pm_fb"]
    assert "the paper's" in order.reason


def test_other_methods_follow_their_names_and_it_is_said() -> None:
    order = known_order(study_of(["splats", "mine", "theirs"]), [])
    assert sorted(order.abilities, key=order.abilities.__getitem__) == ["theirs", "splats", "mine"]
    assert "names" in order.reason


def test_a_hidden_reference_is_above_all() -> None:
    order = known_order(study_of(["x", "y", "truth"], reference="truth"), measured("vmaf", {"x": 1.0, "y": 2.0}))
    assert max(order.abilities, key=order.abilities.__getitem__) == "truth"
    assert order.abilities["y"] > order.abilities["x"]


@pytest.mark.parametrize("protocol", ["ACR", "DCR", "CCR"])
def test_ratings_of_many_films_stay_within_their_scale(protocol: str) -> None:
    abilities = known_order(study_of([f"m{n:02}" for n in range(12)], protocol=protocol), []).abilities
    assert max(abilities.values()) - min(abilities.values()) < 4.0
    assert len(set(abilities.values())) == 12


@pytest.mark.parametrize(
    ("scores", "is_back"), [([2, 1, 0], True), ([1, 2, 0], False), ([2, 2, 0], False), ([2, 1], False)]
)
def test_an_order_comes_back_whole_or_not(scores: list[float], is_back: bool) -> None:
    came = dict(zip(("x", "y", "z"), scores, strict=False))
    assert came_back({"x": 1.0, "y": 0.0, "z": -1.0}, came) == is_back


def test_what_came_out_is_the_score_over_all_datasets_of_votes_or_ratings() -> None:
    rows = [
        {"comparison": "all", "dataset": dataset, "item": "x", "score": score}
        for dataset, score in (("ball", 1.0), ("all", 2.0))
    ]
    assert came_out({"scores": [*rows, {"comparison": "depth", "dataset": "all", "item": "id", "score": 0.0}]}) == {
        "x": 2.0
    }
    assert came_out({"scores": [], "rating_conditions": [{"condition": "x", "mos": 3.5}]}) == {"x": 3.5}


def test_who_prefers_nothing_brings_no_order_back() -> None:
    scores = {"id": 0.4, "dr": -0.4}
    assert came_out_sentence({"id": 0.0, "dr": 0.0}, scores).endswith("by chance: no order was put in.")
    assert came_out_sentence({"id": 1.0, "dr": 0.0}, scores).endswith("the order that was put in.")


def test_a_score_of_nothing_has_no_minus_before_it() -> None:
    assert "b +0.00, c -1.00" in came_out_sentence({"a": 1.0, "b": 0.0, "c": -1.0}, {"a": 1.0, "b": -0.001, "c": -1.0})
