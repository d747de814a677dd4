"""People who may vote, in a database of their own."""

from __future__ import annotations

from tests.seeded_studies import Voter, seeded_voters


def voters_of(url: str, n_voters: int, n_votes: int) -> list[Voter]:
    """Migrate a database, and insert people who may give so many votes together."""
    n_approaches = next(k for k in range(2, 1000) if n_voters * k * (k - 1) // 2 >= n_votes)
    return seeded_voters(url, n_voters, n_approaches)
