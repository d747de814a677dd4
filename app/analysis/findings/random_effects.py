"""Say what scores with participants, and datasets, as random effects show."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from app.analysis.findings.pairs import contrast_between
from app.analysis.findings.ranking import pairs_differ
from app.analysis.model.contrasts import SIGNIFICANT
from app.analysis.reading.phrases import (
    finding,
    interval,
    listed,
    number_with_interval,
    p_phrase,
    percent,
    signed,
)


def random_effect_findings(analysis: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    """Yield for whom, and for which datasets, intervals over all datasets hold, and what those at large would say."""
    spreads, contrasts = analysis["random_effects"], analysis["random_effects_contrasts"]
    levels = [row["level"] for row in spreads]
    n_datasets = len(analysis["votes"]["datasets"])
    has_intervals = any(row["ci_low"] is not None for row in (*analysis["scores"], *analysis["island_scores"]))
    if n_datasets > 1 and "datasets" not in levels and has_intervals:
        yield finding(
            "random effects",
            f"Intervals over all datasets hold for these {n_datasets} datasets. What holds for others like them is "
            "less certain; random effects of participants and datasets would say it.",
        )
    if not spreads:
        return
    ordered = sorted(analysis["random_effects_scores"], key=lambda row: -row["score"])
    best, worst = ordered[0], ordered[-1]
    where = " and other datasets like these" if "datasets" in levels else ""
    values = [number_with_interval(row, "score", show=signed) for row in (best, worst)]
    text = (
        f"With {listed([level for level in levels if level != 'ties'])} as random effects, that is for other people"
        f"{where}: {best['item']} has the highest score, {values[0]}, {worst['item']} the lowest, {values[1]}."
    )
    pair = contrast_between(contrasts, best["item"], worst["item"])
    if pair is not None:
        n_differ = sum(row["p_holm"] < SIGNIFICANT for row in contrasts)
        if pair["p_holm"] < SIGNIFICANT:
            share, low, high = (percent(pair[name]) for name in ("people_preferring", "people_low", "people_high"))
            text += (
                f" The model predicts that {share} of people ({interval(low, high)}) prefer {best['item']} to "
                f"{worst['item']}, {p_phrase(pair['p_holm'])} (Holm)."
            )
        text += f" {n_differ} of {pairs_differ(len(contrasts), n_differ)} (Holm)."
    yield finding("random effects", text)
    apart = [
        f"between {row['level']} by {number_with_interval(row, 'sd', 'sd')}"
        for row in spreads
        if row["level"] != "ties"
    ]
    yield finding("random effects", f"Scores of a condition vary {listed(apart)}: standard deviations in log-odds.")
