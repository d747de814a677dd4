"""What makes an item good: each factor by itself, all factors together, and whether they act together.

As in the paper, a factor is studied alone by the pairs that differ in nothing else. The additive model uses every
pair and needs half to a third of the votes for the same precision; the interaction test says whether it may be trusted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from app.analysis.votes import VotesError, VotesTable

Array = NDArray[np.float64]
Factors = Mapping[str, Mapping[str, str]]  # factor -> item -> level


def check_factors(votes: VotesTable, factors: Factors) -> None:
    """Raise if an item of the votes has no level.

    Raises
    ------
    VotesError
        Naming the item and the factor.
    """
    for factor, levels in factors.items():
        missing = [item for item in votes.items if item not in levels]
        if missing:
            raise VotesError(
                f"the item {missing[0]!r} has no level of the factor {factor!r}; name it in the items file"
            )


def level_names(factors: Factors, factor: str, items: tuple[str, ...]) -> tuple[str, ...]:
    """Return the levels of a factor among these items, in order of appearance."""
    return tuple(dict.fromkeys(factors[factor][item] for item in items))


def votes_on_factor(votes: VotesTable, factors: Factors, factor: str) -> VotesTable:
    """Return the votes on pairs that differ in this factor and in no other, with its levels as the items."""
    codes = {name: _codes(votes, factors, name) for name in factors}
    differs = codes[factor][votes.item_a] != codes[factor][votes.item_b]
    for other in factors:
        if other != factor:
            differs &= codes[other][votes.item_a] == codes[other][votes.item_b]
    kept = votes.where(differs)
    return replace(
        kept,
        items=level_names(factors, factor, votes.items),
        item_a=codes[factor][kept.item_a],
        item_b=codes[factor][kept.item_b],
    )


def _codes(votes: VotesTable, factors: Factors, factor: str) -> NDArray[np.int32]:
    names = level_names(factors, factor, votes.items)
    return np.array([names.index(factors[factor][item]) for item in votes.items], np.int32)
