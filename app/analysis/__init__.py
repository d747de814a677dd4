"""From votes to conclusions: a votes table in, triads, scores, errors and tests out. Pure: no files but at the edges,
no clock, no chance.
"""

from app.analysis.analyse import analyse
from app.analysis.reading import read_votes, votes_from_rows
from app.analysis.report import analyse_file, write_analysis
from app.analysis.settings import AnalysisSettings
from app.analysis.votes_table import VotesError, VotesTable

__all__ = [
    "AnalysisSettings",
    "VotesError",
    "VotesTable",
    "analyse",
    "analyse_file",
    "read_votes",
    "votes_from_rows",
    "write_analysis",
]
