"""Write the report's section on scores against the size of models."""

from __future__ import annotations

from typing import Any

from app.analysis.objective.against_scores import score_unit
from app.analysis.reading.phrases import with_interval
from app.analysis.report.tables import Analysis, Figures, table

TEXT = (
    "The size is that of a condition's model files, over all datasets their geometric mean. A condition is on the "
    "front if no other is as small and scores as high. The difference of two methods is that of their scores at equal "
    "size, averaged over the logarithm of the sizes that both have (after Bjontegaard 2001), in {unit}; its interval "
    "holds for other participants where they are known."
)


def rate_section(analysis: Analysis, figures: Figures) -> dict[str, Any]:
    """Return the section; `figures` are those that were drawn, by name."""
    rows = [
        row
        | {"score": with_interval({**row, "score_low": row["ci_low"], "score_high": row["ci_high"]}, "score", "score")}
        for row in analysis["rates"]
    ]
    differences = [
        row | {"difference": with_interval(_ends(row), "difference", "difference")}
        for row in analysis["rate_differences"]
    ]
    columns = ["dataset", "item", "method", "level", "bytes", "score", "is_on_front"]
    compared = ["dataset", "method_a", "method_b", "difference", "bytes_low", "bytes_high"]
    return {
        "title": "What does a better score cost in bytes?",
        "paragraphs": [TEXT.format(unit=score_unit(analysis))],
        "figures": [figures["rates"]] if "rates" in figures else [],
        "tables": [
            table("Scores and sizes", columns, rows),
            *([table("Methods at equal size", compared, differences)] if differences else []),
        ],
    }


def _ends(row: dict[str, Any]) -> dict[str, Any]:
    return {**row, "difference_low": row["ci_low"], "difference_high": row["ci_high"]}
