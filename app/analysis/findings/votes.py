"""Say in sentences what an analysis of pair votes shows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from app.analysis.findings.influences import influence_findings
from app.analysis.findings.people import interim_findings, limit_findings, people_findings
from app.analysis.findings.random_effects import random_effect_findings
from app.analysis.findings.ranking import overall, ranking_findings
from app.analysis.reading.phrases import TIES, finding


def vote_findings(analysis: Mapping[str, Any]) -> list[dict[str, str]]:
    """Return what an analysis of votes shows, the most important first, and its settings last.

    Parameters
    ----------
    analysis : the content of analysis.json

    Returns
    -------
    list of dict, `about` (ranking, best, worst, difference, told apart, equivalent, missing, limits, factors, datasets,
    groups, order, ties, measures, random effects, agreement, fit,
    participants, lapses, settings) and `text`
    """
    if not overall(analysis["models"]):
        return [finding("ranking", "No vote counts, so nothing can be concluded.")]
    return [
        *interim_findings(analysis["votes"]["participants"], analysis["settings"]["planned_participants"]),
        *ranking_findings(analysis),
        *limit_findings(analysis),
        *influence_findings(analysis),
        *random_effect_findings(analysis),
        *people_findings(analysis),
        finding("settings", _settings(analysis)),
    ]


def _settings(analysis: Mapping[str, Any]) -> str:
    settings = analysis["settings"]
    of_all, of_any = (
        dict.fromkeys(row["ci_method"] for row in rows if row["ci_method"])
        for rows in (overall(analysis["scores"]), [*analysis["scores"], *analysis["island_scores"]])
    )
    has_order = overall(analysis["models"])[0]["order_effect"] is not None
    left_out = f"; left out: {', '.join(settings['exclude'])}" if settings["exclude"] else ""
    prior = "; JOD by Thurstone's Case V with pwcmp's prior on distances" if settings["jod_prior"] == "pwcmp" else ""
    return (
        f"Settings: Bradley-Terry model, ties {TIES[settings['ties']]}, order effect "
        f"{'estimated' if has_order else 'not estimated'}, 95 % intervals: "
        f"{' or '.join(of_all or of_any) or 'none'}; all pairs corrected by Holm{prior}{left_out}."
    )
