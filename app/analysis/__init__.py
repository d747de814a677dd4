"""Analyse votes and ratings: read a table; compute triads, scores, errors and tests; write the report. Nothing here
reads a clock or draws unseeded random numbers; only reading and writing touch files.
"""

from app.analysis.analyse import analyse
from app.analysis.reading import read_votes, votes_from_rows
from app.analysis.report import analyse_file, analyse_ratings_file, write_analysis
from app.analysis.settings import AnalysisSettings
from app.analysis.votes_table import VotesError, VotesTable

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
