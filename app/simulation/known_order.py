"""Say what artificial people prefer unless told, and whether it came back from their votes.

They follow what was measured of the films against the truth or photographs; where nothing was, the paper's order.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from app.simulation.rating import LOG_ODDS_OF_SCALE
from app.study.protocols import PC

# Likeness of a film to that of the true model, of a model to photographs, and of a film again: the first that is
# attached for all that a study shows.
MEASURES = ("ssim_actor", "novel view SSIM", "vmaf")
STEP = 1.5  # log-odds between neighbours, 4.5 : 1: twelve people bring six back in 98 of 100 studies
WITHIN_SCALE = 0.8  # of a rating scale's length, so that few ratings are cut off at its ends
# The paper's order (figures 7 and 8), natural log-odds.
LEVELS: Mapping[str, Mapping[str, float]] = {
    "depth": {"id": -0.8, "dr": 0.1, "pm": 0.7},
    "fusion": {"fa": -0.4, "fb": 0.4},
}
PAPERS = "in the paper's order, as no measure of likeness to the truth is attached for every film"
BY_NAME = "in the order of their names, as no measure of likeness to the truth is attached for every film"


@dataclass(frozen=True)
class KnownOrder:
    """What artificial people prefer.

    Parameters
    ----------
    abilities : natural log-odds by item
    reason : says where the order comes from, and follows "they prefer"
    """

    abilities: Mapping[str, float]
    reason: str


def known_order(study: Mapping[str, Any], measured: Sequence[Mapping[str, Any]]) -> KnownOrder:
    """Choose what people prefer in a study: neighbours in the order are as far apart as a few people can tell.

    Parameters
    ----------
    study : as the analyst's route of it answers
    measured : rows of the analyst's route `validation`
    """
    stimuli = {(row["dataset"], row["item"]) for row in study["stimuli"] if row["item"] != study["reference"]}
    quality, reason = _quality(study, stimuli, measured)
    qualities, ranks = np.unique(list(quality.values()), return_inverse=True)
    places = dict(zip(quality, ranks.tolist(), strict=True))
    if study["reference"]:
        places[study["reference"]] = len(qualities)
    middle, last = max(places.values()) / 2, max(1, *places.values())
    step = STEP if study["protocol"] == PC else min(STEP, WITHIN_SCALE * LOG_ODDS_OF_SCALE / last)
    return KnownOrder({item: round(step * (place - middle), 3) for item, place in places.items()}, reason)


def _quality(
    study: Mapping[str, Any], stimuli: Collection[tuple[str, str]], measured: Sequence[Mapping[str, Any]]
) -> tuple[dict[str, float], str]:
    """Return each item's quality, higher is better, and where it comes from."""
    for name in MEASURES:
        values = {
            (row["dataset"], row["approach"]): float(row["value"])
            for row in measured
            if row["measure"] == name and row["better"] == "higher"
        }
        if values.keys() >= set(stimuli):
            rounded = {item: round(value, 9) for item, value in _over_datasets(values, stimuli).items()}
            return rounded, f"in the order of {name}, which was measured"
    items = sorted({item for _, item in stimuli})
    levels = {row["item"]: row["levels"] for row in study["conditions"]}
    known = {item: [LEVELS[factor].get(levels[item].get(factor, "")) for factor in LEVELS] for item in items}
    if all(None not in places for places in known.values()):
        return {item: round(sum(place or 0.0 for place in places), 9) for item, places in known.items()}, PAPERS
    return {item: -float(place) for place, item in enumerate(items)}, BY_NAME


def _over_datasets(values: Mapping[tuple[str, str], float], stimuli: Collection[tuple[str, str]]) -> dict[str, float]:
    """Return each item's mean over the datasets where it is, less what is due to the datasets (least squares)."""
    rows = sorted(stimuli)
    datasets, items = (sorted({row[side] for row in rows}) for side in (0, 1))
    design = np.zeros((len(rows), len(items) + len(datasets)))
    for index, (dataset, item) in enumerate(rows):
        design[index, items.index(item)] = design[index, len(items) + datasets.index(dataset)] = 1.0
    effects = np.linalg.lstsq(design, np.array([values[row] for row in rows]), rcond=None)[0]
    return dict(zip(items, effects[: len(items)].tolist(), strict=True))


def came_out(analysis: Mapping[str, Any]) -> dict[str, float]:
    """Return the scores of an analysis over all datasets, or the mean ratings, by item; without those it cannot say."""
    votes = [row for row in analysis["scores"] if row["comparison"] == "all"]
    ratings = analysis.get("rating_conditions") or []
    compared = analysis.get("comparison_items") or []
    if ratings:
        return {row["condition"]: row["mos"] for row in ratings if row["mos"] is not None}
    name, rows = ("item", votes) if votes else ("condition", compared)
    last = "all" if any(row["dataset"] == "all" for row in rows) else None
    return {row[name]: row["score"] for row in rows if last in (None, row["dataset"]) and row["score"] is not None}


def came_back(put_in: Mapping[str, float], scores: Mapping[str, float]) -> bool:
    """Say whether every item that is preferred to another also has the higher score."""
    if not put_in.keys() <= scores.keys():
        return False
    return all(
        scores[better] > scores[worse] for better in put_in for worse in put_in if put_in[better] > put_in[worse]
    )


def put_in_sentence(put_in: Mapping[str, float], reason: str) -> str:
    """Say what artificial people prefer."""
    return f"Put in: artificial people prefer {_best_first(put_in)} (log-odds), {reason}."


def came_out_sentence(put_in: Mapping[str, float], scores: Mapping[str, float]) -> str:
    """Say what the votes came to, and whether it is what was put in."""
    return f"Came out: {_best_first(scores)}, {outcome(put_in, scores)}." if scores else "Came out: no scores yet."


def outcome(put_in: Mapping[str, float], scores: Mapping[str, float]) -> str:
    """Say of which order the scores are."""
    if len(set(put_in.values())) < 2:
        return "by chance: no order was put in"
    if came_back(put_in, scores):
        return "the order that was put in"
    return "not the order that was put in: these votes are too few for it, or other people's are among them"


def _best_first(values: Mapping[str, float]) -> str:
    form = "+z.2f" if min(values.values(), default=0.0) < 0 else ".2f"  # mean ratings are no differences
    return ", ".join(f"{item} {value:{form}}" for item, value in sorted(values.items(), key=lambda pair: -pair[1]))
