"""Hold votes as integer columns that point into lists of names: the input of every analysis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

CHOICES = ("a", "b", "none")
A, B, NONE = range(3)
ROLES = ("main", "repeat", "identical")
MAIN, REPEAT, IDENTICAL = range(3)
WITHDRAWN = "withdrawn"  # reason of the participant's own exclusion, which an experimenter cannot undo


class VotesError(ValueError):
    """A table is not a votes table; the message names the row and the value."""


@dataclass(frozen=True)
class VotesTable:
    """Votes as integer columns that point into three lists of names.

    Parameters
    ----------
    participants, datasets, items : the names, in order of appearance; a single empty name means "not recorded"
    participant, dataset, item_a, item_b : int32 (N,), index of the name
    choice : int8 (N,), 0 = `item_a` preferred, 1 = `item_b` preferred, 2 = no preference
    first_shown : int8 (N,), 0 = `item_a` was shown first, 1 = `item_b`, -1 = not recorded
    both_seen : int8 (N,), 1 = both items were on screen, 0 = one was not, -1 = not recorded
    count : int64 (N,), number of votes that the row stands for
    response_ms : float64 (N,), NaN where not recorded
    press_to_picture_ms : float64 (N,), median of the vote's switches, NaN where not recorded
    practice, excluded : bool (N,), rows that the table keeps and the analysis leaves out
    reason : object (N,), why a row was excluded, empty if it was not
    role : int8 (N,), 0 = a vote to score, 1 = a pair seen again, 2 = a stimulus against itself; the last two check the
        participant and are not scored
    """

    participants: tuple[str, ...]
    datasets: tuple[str, ...]
    items: tuple[str, ...]
    participant: NDArray[np.int32]
    dataset: NDArray[np.int32]
    item_a: NDArray[np.int32]
    item_b: NDArray[np.int32]
    choice: NDArray[np.int8]
    first_shown: NDArray[np.int8]
    both_seen: NDArray[np.int8]
    count: NDArray[np.int64]
    response_ms: NDArray[np.float64]
    press_to_picture_ms: NDArray[np.float64]
    practice: NDArray[np.bool_]
    excluded: NDArray[np.bool_]
    reason: NDArray[np.object_]
    role: NDArray[np.int8]

    def __len__(self) -> int:
        return len(self.choice)

    @property
    def n_votes(self) -> int:
        """Number of votes, repeated rows counted."""
        return int(self.count.sum())

    @property
    def has_participants(self) -> bool:
        """Are the participants recorded?"""
        return self.participants != ("",)

    @property
    def has_datasets(self) -> bool:
        """Are the votes divided into named datasets?"""
        return self.datasets != ("",)

    def where(self, rows: NDArray[np.bool_] | NDArray[np.integer[Any]]) -> VotesTable:
        """Return the table with only these rows, bool (N,) or int (M,); the lists of names stay."""
        columns = {f.name: getattr(self, f.name)[rows] for f in fields(self) if f.name not in NAMES}
        return replace(self, **columns)

    def used(self) -> VotesTable:
        """Return the rows to score: not practice, not excluded, not attention checks."""
        return self.where(~(self.practice | self.excluded) & (self.role == MAIN))


NAMES = ("participants", "datasets", "items")


def votes_from_indices(
    participant: NDArray[np.integer[Any]],
    dataset: NDArray[np.integer[Any]],
    item_a: NDArray[np.integer[Any]],
    item_b: NDArray[np.integer[Any]],
    choice: NDArray[np.integer[Any]],
    *,
    names: tuple[Sequence[str], Sequence[str], Sequence[str]],
    count: NDArray[np.integer[Any]] | None = None,
    first_shown: NDArray[np.integer[Any]] | None = None,
) -> VotesTable:
    """Make a votes table from columns of indices.

    Parameters
    ----------
    participant, dataset, item_a, item_b : int (N,), index of the name
    choice : int (N,), 0 = `item_a`, 1 = `item_b`, 2 = no preference
    names : those of participants, datasets and items
    count : int (N,), votes of each row; one by default
    first_shown : int (N,), as in `VotesTable`; not recorded by default
    """
    n = len(choice)
    participants, datasets, items = (tuple(part) for part in names)
    return VotesTable(
        participants,
        datasets,
        items,
        participant=participant.astype(np.int32, copy=False),
        dataset=dataset.astype(np.int32, copy=False),
        item_a=item_a.astype(np.int32, copy=False),
        item_b=item_b.astype(np.int32, copy=False),
        choice=choice.astype(np.int8, copy=False),
        first_shown=np.full(n, -1, np.int8) if first_shown is None else first_shown.astype(np.int8, copy=False),
        both_seen=np.full(n, -1, np.int8),
        count=np.broadcast_to(np.int64(1), n) if count is None else count.astype(np.int64, copy=False),
        response_ms=np.full(n, np.nan),
        press_to_picture_ms=np.full(n, np.nan),
        practice=np.zeros(n, bool),
        excluded=np.zeros(n, bool),
        reason=np.full(n, "", object),
        role=np.zeros(n, np.int8),
    )
