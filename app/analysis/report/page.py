"""Write the report of an analysis as a page, HTML or Markdown: findings first, then scores, sections and methods."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np
import scipy
from jinja2 import Environment

from app.analysis.comparisons.result_rows import PERCENTILES, WIDER_INTERVAL
from app.analysis.findings.ranking import overall, preferred_share
from app.analysis.model.contrasts import FEWEST_PARTICIPANTS
from app.analysis.model.scales import LOG_ODDS_PER_JOD
from app.analysis.reading.phrases import TIES, counted
from app.analysis.reading.votes_table import ALL
from app.analysis.report.figures import Figure
from app.analysis.report.sections import sections
from app.analysis.report.tables import best_share, ranks
from app.files import page_templates

ITEMS_IN_A_TABLE = 60
PAGES = ("report.html", "report.md")


def report_page(name: str, analysis: Mapping[str, Any], figures: Sequence[Figure], source: str) -> str:
    """Return the report as a page.

    Parameters
    ----------
    name : report.html or report.md
    analysis : the content of analysis.json
    figures : those that were drawn
    source : name of what was analysed, for the title
    """
    return _environment(name).get_template(name).render(_content(analysis, figures, source))


def _environment(name: str) -> Environment:
    is_html = name.endswith(".html")
    spaces = {"trim_blocks": False, "lstrip_blocks": False, "keep_trailing_newline": True}
    finalize = None if is_html else _within_cell
    environment = page_templates("templates/analysis", autoescape=is_html, finalize=finalize, **spaces)
    environment.filters["number"] = _number
    environment.filters["unbroken"] = _unbroken
    environment.filters |= {"ranks": ranks, "best_share": best_share}
    environment.globals["is_name"] = _is_name
    return environment


def _number(value: Any) -> str:
    """Format a number for reading: three decimals, None as a dash."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{round(value, 3) + 0.0:.3f}"  # + 0.0: no negative zero
    return str(value)


def _within_cell(value: Any) -> Any:
    """Escape what would end a cell of a Markdown table, such as a mark in a condition's name."""
    return value.replace("|", "\\|") if isinstance(value, str) else value


def _unbroken(text: str) -> str:
    """Return a sentence whose percentages and p-values stay on one line."""
    return text.replace(" %", "\u00a0%").replace("p = ", "p\u00a0=\u00a0").replace("p < ", "p\u00a0<\u00a0")


def _is_name(cell: Any) -> bool:
    """Is a cell of a table text, which stands at the left, rather than a number?"""
    return isinstance(cell, str) and any(map(str.isalpha, cell))


def _content(analysis: Mapping[str, Any], figures: Sequence[Figure], source: str) -> dict[str, Any]:
    by_name = {figure.name: figure for figure in figures}
    has_votes = analysis["votes"] is not None
    return {
        "analysis": analysis,
        "title": f"{'Pair comparison' if has_votes else 'Ratings'}: {source}",
        "summary": _summary(analysis) if has_votes else "",
        "findings": [row["text"] for row in analysis["findings"] if row["about"] != "settings"],
        "settings": [row["text"] for row in analysis["findings"] if row["about"] == "settings"],
        "score_figures": [figure for name, figure in by_name.items() if name == "scores" or name.startswith("levels_")],
        "score_tables": _score_tables(analysis),
        "scores_note": _scores_note(analysis) if has_votes else "",
        "sections": list(sections(analysis, by_name)),
        "methods": [*(_methods(analysis) if has_votes else ()), _software()],
    }


def _summary(analysis: Mapping[str, Any]) -> str:
    votes = analysis["votes"]
    people = "unknown participants" if votes["participants"] is None else counted(votes["participants"], "participant")
    datasets = f" on {counted(len(votes['datasets']), 'dataset')}" if votes["datasets"] else ""
    checks = f"{counted(votes['checks'], 'attention check')}, " if votes["checks"] else ""
    return (
        f"{counted(votes['votes'], 'vote')} read: {votes['analysed']} analysed ({votes['ties']} without preference), "
        f"{votes['practice']} practice, {checks}{votes['excluded']} excluded. "
        f"{people.capitalize()}, {counted(len(votes['items']), 'condition')}{datasets}."
    )


def _scores_note(analysis: Mapping[str, Any]) -> str:
    methods = dict.fromkeys(row["ci_method"] for row in analysis["scores"] if row["ci_method"])
    return (
        "A condition is what people compare. Scores are log-odds with sum zero in each panel: a difference of 1.1 "
        f"(one JOD) means that one condition is preferred {_times_of_one_jod(analysis)} as often as the other. "
        f"Intervals: {'95 %, ' + ' or '.join(methods) if methods else 'none'}. Overlapping intervals are no test of a "
        "difference: conditions of one panel that share a letter in the column group are not told apart (5 %, all "
        "pairs, on single datasets of all of them, Holm). Best is the probability to have the highest true score, by "
        "these votes alone; ranks are those that the tests leave open. "
        f"{'Datasets stand in alphabetical order.' if len(analysis['votes']['datasets']) > 1 else ''}"
    ).rstrip()


def _times_of_one_jod(analysis: Mapping[str, Any]) -> str:
    """Say how much more often the better of two conditions is preferred; with Rao and Kupper's ties it is not e^d."""
    log_theta = next((row.get("log_theta") for row in overall(analysis["models"])), None)
    if not log_theta:
        return "three times"
    share = preferred_share(LOG_ODDS_PER_JOD, log_theta)
    return f"about {share / (1 - share):.1f} times"


def _score_tables(analysis: Mapping[str, Any]) -> list[dict[str, Any]]:
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for row in analysis["scores"]:
        shown = dict(row) | {"error": _error(row)}
        groups.setdefault((row["comparison"], row["dataset"]), []).append(shown)
    tables = []
    for (comparison, dataset), rows in sorted(groups.items(), key=lambda group: group[0][1] != ALL):
        rows.sort(key=lambda row: -(row["score"] or 0.0))
        what = "All conditions" if comparison == ALL else f"Factor {comparison}"
        where = dataset if dataset != ALL else "all datasets" if analysis["votes"]["datasets"] else "all votes"
        rest = (
            f"; the first {ITEMS_IN_A_TABLE} of {len(rows)}, all in scores.csv" if len(rows) > ITEMS_IN_A_TABLE else ""
        )
        has_letters = any(row.get("letters") for row in rows)
        title = f"{what}, {where}{rest}"
        shown = {"title": title, "rows": rows[:ITEMS_IN_A_TABLE], "has_letters": has_letters}
        tables.append(shown | {"is_folded": dataset != ALL})
    return tables


def _error(row: Mapping[str, Any]) -> float | None:
    """Return the error that a score's interval is made of."""
    known = [error for error in (row["se_participant"], row["se"]) if error is not None]
    if row["ci_method"] == WIDER_INTERVAL:
        return float(max(known))
    return known[0] if known else None


def _methods(analysis: Mapping[str, Any]) -> list[str]:
    settings, votes = analysis["settings"], analysis["votes"]
    texts = [
        f"Conditions were compared in pairs{' with a no-preference option' if votes['ties'] else ''}. "
        f"Scores were estimated with the Bradley-Terry model (Bradley and Terry 1952) by maximum likelihood, ties "
        f"{TIES[settings['ties']]}.",
        "Before each fit, Ford's condition (1957) and its extensions were checked; where no finite maximum exists, a "
        "penalised estimate is shown and marked, Firth's (1993) unless another is named.",
    ]
    if any(model["order_effect"] is not None for model in analysis["models"]):
        texts.append(
            "An advantage of the condition shown first was estimated with the scores (Davidson and Beaver 1977)."
        )
    if votes["participants"] is not None and any(row["ci_method"] for row in analysis["scores"]):
        texts.append(
            "The participant is the independent unit: standard errors come from the sandwich estimator clustered by "
            f"participant with the factor J / (J - 1), intervals from {_interval_in_words(analysis)}. With fewer than "
            f"{FEWEST_PARTICIPANTS} participants, or no more than free parameters, no interval is narrower than the "
            "normal one on the errors of the votes."
        )
        if len(votes["datasets"]) > 1:
            texts.append(
                "Results over all datasets hold for these datasets, which are not taken as a sample of others: "
                "intervals say how other people would vote on the same ones."
            )
    if votes["participants"] is not None:
        texts.append(
            "Contradictory votes were counted as circular triads (Kendall and Babington Smith 1940); ties enter by the "
            "expectation over all ways of breaking them. P-values hold for random votes on the pairs that a "
            "participant compared, with the ties where they are."
        )
    return texts


def _software() -> str:
    return (
        f"Software: reconstudy {version('reconstudy')}, Python {platform.python_version()}, "
        f"numpy {np.__version__}, scipy {scipy.__version__}."
    )


def _interval_in_words(analysis: Mapping[str, Any]) -> str:
    """Say what the intervals rest on; those of few participants are not percentiles, whatever was asked for."""
    settings, used = analysis["settings"], {row["ci_method"] for row in analysis["scores"]} - {None}
    ways = []
    if PERCENTILES in used:
        ways.append(
            f"expanded percentiles (Hesterberg 2015) of {settings['bootstrap']} bootstrap samples of participants "
            f"(seed {settings['seed']})"
        )
    if used != {PERCENTILES}:
        ways.append("the t distribution with J - 1 degrees of freedom")
    return " or ".join(ways)
