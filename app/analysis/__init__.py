"""Analyse votes and ratings: read a table; compute triads, scores, errors and tests; write the report. Nothing here
reads a clock or draws unseeded random numbers; only reading and writing touch files.
"""

from typing import TYPE_CHECKING

from app.analysis.analyse import analyse
from app.analysis.model.settings import AnalysisSettings
from app.analysis.reading.read_votes import read_votes, votes_from_rows
from app.analysis.reading.votes_table import VotesError, VotesTable

if TYPE_CHECKING:
    from app.analysis.analyse_files import analyse_file, analyse_ratings_file
    from app.analysis.report.write import write_analysis
else:

    def __getattr__(name: str) -> object:
        """Import the report when it is asked for: what draws its figures takes a quarter of the time of all imports."""
        if name == "write_analysis":
            from app.analysis.report import write as module
        elif name in ("analyse_file", "analyse_ratings_file"):
            from app.analysis import analyse_files as module
        else:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(module, name)


__all__ = [
    "AnalysisSettings",
    "VotesError",
    "VotesTable",
    "analyse",
    "analyse_file",
    "analyse_ratings_file",
    "read_votes",
    "votes_from_rows",
    "write_analysis",
]
