"""Make the parts of a report: a section with its table, and the headings of columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from app.analysis.reading.phrases import LOWEST_P, percent
from app.analysis.report.figures import Figure

Analysis = Mapping[str, Any]
Figures = Mapping[str, Figure]
Row = Mapping[str, Any]

ROWS = 80  # rows of a table; the CSV files hold the rest
P_VALUES = {"p_value", "p_holm", "p_participant", "p_votes", "spearman_p", "auc_p", "auc_p_holm"}
HEADINGS = {  # of columns; others have their name in analysis.json
    "auc_a": "AUC of it",
    "auc_b": "of the other",
    "auc_better_worse": "AUC better/worse",
    "auc_different_similar": "AUC different/similar",
    "auc_p": "p, AUC",
    "auc_p_holm": "p, AUC (Holm)",
    "ci_high": "to",
    "ci_low": "from",
    "difference": "difference (log-odds)",
    "circular_expected_ties": "expected with ties broken",
    "cmos": "mean rating",
    "dataset_a": "dataset",
    "dataset_b": "and",
    "careless_false_alarms": "false alarms",
    "careless_log_ratio": "careless",
    "failed_checks": "checks failed",
    "flags": "unusual",
    "g2": "G2",
    "jod": "JOD",
    "kendall": "KRCC",
    "lapse_rate": "lapse rate",
    "log_nu": "tie parameter",
    "log_theta": "tie parameter",
    "loglik": "log-likelihood",
    "measure_a": "measure",
    "measure_b": "and",
    "model": "in the model of",
    "moderate": "moderate violated",
    "n": "points",
    "n_datasets": "datasets",
    "n_first_better": "first better",
    "item": "condition",
    "item_a": "condition",
    "item_b": "and",
    "n_items": "conditions",
    "sd": "spread",
    "sd_high": "to",
    "sd_low": "from",
    "se": "error",
    "n_participants": "participants",
    "n_ratings": "ratings",
    "n_second_better": "second better",
    "n_triples": "triples",
    "n_votes": "votes",
    "name": "test",
    "order_effect": "order effect",
    "order_se": "its error",
    "outlier_ratio": "outliers",
    "p_holm": "p (Holm)",
    "p_participant": "p (participants)",
    "p_value": "p",
    "p_votes": "p (votes)",
    "people_preferring": "people",
    "pairs_correct": "in order",
    "pairs_different": "pairs that differ",
    "pairs_similar": "pairs alike",
    "pearson": "Pearson",
    "pearson_a": "Pearson of it",
    "pearson_b": "of the other",
    "pearson_logistic": "PLCC",
    "pearson_logistic5": "PLCC5",
    "pearson_monotone": "monotone",
    "pearson_x2": "Pearson X2",
    "rmse": "RMSE",
    "rmse_epsilon": "RMSE*",
    "scored": "score",
    "spearman": "SROCC",
    "spearman_p": "p, SROCC",
    "strong": "strong violated",
    "tie_rate": "tie rate",
    "weak": "weak violated",
}


def section(
    title: str, text: str, columns: Sequence[str], rows: Sequence[Row], figures: Sequence[Figure] = ()
) -> dict[str, Any]:
    """Return a section with one table.

    Parameters
    ----------
    title, text : heading and paragraph
    columns : of the rows, in this order
    figures : to show before the table
    """
    rest = f" The first {ROWS} of {len(rows)} rows." if len(rows) > ROWS else ""
    return {"title": title, "paragraphs": [text + rest], "figures": figures, "tables": [table("", columns, rows)]}


def table(title: str, columns: Sequence[str], rows: Sequence[Row], *, is_folded: bool = False) -> dict[str, Any]:
    """Return a table with the headings of these columns, and as many rows as a report shows.

    Parameters
    ----------
    title : may be empty
    columns : of the rows, in this order
    is_folded : hide the rows behind the title until somebody opens them; the title cannot be empty then
    """
    headings = [HEADINGS.get(column, column) for column in columns]
    cells = [[_cell(column, row[column]) for column in columns] for row in rows[:ROWS]]
    return {"title": title, "columns": headings, "rows": cells, "is_folded": is_folded}


def ranks(row: Mapping[str, Any]) -> str:
    """Return the ranks that the tests of pairs leave a condition, a dash where nothing is known."""
    low, high = row.get("rank_low"), row.get("rank_high")
    return "–" if low is None else str(low) if low == high else f"{low} to {high}"


def best_share(row: Mapping[str, Any]) -> str:
    """Return the probability that a condition is the best, in percent, a dash where it is not known."""
    return "–" if row.get("p_best") is None else percent(row["p_best"])


def _cell(column: str, value: Any) -> Any:
    """Return a value, a p-value as text: small ones as a bound, because their tails are not to be trusted."""
    is_p = column in P_VALUES and isinstance(value, float)
    return value if not is_p else f"< {LOWEST_P}" if value < LOWEST_P else f"{value:.3f}"
