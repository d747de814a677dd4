"""Name the claims that a study is planned for, and what is assumed of its people before they come."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from app.study.protocols import RATED, Protocol

TYPICAL_INCONSISTENCY = 0.7  # grades of five: standard deviation of somebody's ratings around the qualities
TYPICAL_SPREAD = 0.4  # log-odds, of people; makes clustered errors about 1.4 times the naive ones, as on real panels
TYPICAL_TIE_RATE = 0.2
MOST_PLACES = 100_000  # of an invitation
MOST_PARTICIPANTS = 512  # among whom a number that suffices is looked for

MEASURE_CORRELATION = 0.9  # of a good measure with the true scores

Claim = Literal["told apart", "pair", "best", "factor", "measure", "datasets"]
REPORTED: Claim = "told apart"  # what a report says of two conditions
CLAIMS: Mapping[Claim, str] = {
    "told apart": "two conditions are told apart (all pairs, Holm)",
    "pair": "two conditions fixed before the study differ",
    "best": "one condition is best: it differs from every other",
    "factor": "a factor of two levels has an effect",
    "measure": f"a measure (correlation {MEASURE_CORRELATION}) goes with the scores",
    "datasets": "two conditions fixed before differ for datasets like these",
}


def usual_spread(protocol: Protocol) -> float:
    """Return how far people differ where nobody says so: log-odds, or grades of ratings."""
    return 0.0 if protocol in RATED else TYPICAL_SPREAD
