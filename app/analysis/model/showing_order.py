"""Tell whether votes can say how much being shown first helps, apart from the scores."""

from __future__ import annotations

import numpy as np

from app.analysis.model.likelihood.counts import outcome_index
from app.analysis.reading.phrases import part
from app.analysis.reading.votes_table import VotesTable

MOST_CONFOUNDED = 0.5  # share of the order effect's information; above, its variance is more than doubled


def why_no_order_effect(votes: VotesTable) -> str | None:
    """Return why these votes cannot tell an order effect from the scores; None if they can.

    If no vote records the order, `item_a` counts as shown first in all.
    """
    unknown = int(votes.count[votes.first_shown < 0].sum())
    if 0 < unknown < votes.n_votes:
        verb = "does" if unknown == 1 else "do"
        return f"{part(unknown, votes.n_votes, 'vote')} {verb} not record which condition was shown first (first_shown)"
    share = confounded_share(votes)
    if share > MOST_CONFOUNDED:
        return (
            "the orders are unbalanced: some conditions were shown first much more often than others, which explains "
            f"{100 * share:.0f} % of what the votes say about the order"
        )
    return None


def confounded_share(votes: VotesTable) -> float:
    """Return the share of the order effect's information that differences of scores explain.

    It is the squared multiple correlation, between pairs of equal conditions, of "shown first" with the differences of
    scores: 0 if every condition was shown first as often as second, 1 if the places follow from the conditions.
    """
    n = len(votes.items)
    first, second, _ = outcome_index(votes, is_ordered=True)
    shown = np.bincount(first * n + second, votes.count, n * n).reshape(n, n)
    both = shown + shown.T
    laplacian = np.diag(both.sum(axis=1)) - both
    surplus = shown.sum(axis=1) - shown.sum(axis=0)  # times shown first less times shown second
    explained = surplus @ np.linalg.lstsq(laplacian, surplus, rcond=None)[0]
    return float(explained / max(shown.sum(), 1))
