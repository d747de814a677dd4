"""Hold ratings as columns that point into lists of names: the input of the analysis of ratings."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Table = TypeVar("Table", "RatingTable", "ComparisonTable")

PROTOCOLS = {
    "acr": "absolute category rating (ITU-T P.910)",
    "acr-hr": "absolute category rating with hidden reference (ITU-T P.910)",
    "dcr": "degradation category rating (ITU-T P.910; double-stimulus impairment scale of ITU-R BT.500)",
}


def item_name(dataset: str, condition: str) -> str:
    """Return "condition of dataset", or the condition where no dataset has a name."""
    return f"{condition} of {dataset}" if dataset else condition


@dataclass(frozen=True)
class RatingTable:
    """Ratings of single stimuli; the analysis takes them as they are, so leave practice and exclusions out.

    Parameters
    ----------
    participants : the P participants' names
    items : the I items, each (dataset, condition)
    person : intp (N,), index of the participant of each rating
    item : intp (N,), index of the item of each rating
    rating : float64 (N,), between `low` and `high`; more is better
    is_reference : bool (I,), the item is a dataset's (hidden) reference; at most one for each dataset
    protocol : one of `PROTOCOLS`
    low, high : ends of the scale, such as 1 and 5
    """

    participants: tuple[str, ...]
    items: tuple[tuple[str, str], ...]
    person: NDArray[np.intp]
    item: NDArray[np.intp]
    rating: NDArray[np.float64]
    is_reference: NDArray[np.bool_]
    protocol: str
    low: float
    high: float

    def __post_init__(self) -> None:
        if self.protocol not in PROTOCOLS:
            raise ValueError(f"the protocol is {self.protocol!r}, expected one of {', '.join(PROTOCOLS)}")
        if not self.low < self.high:
            raise ValueError(f"the scale goes from {self.low:g} to {self.high:g}, expected its low end first")
        lengths = {name: len(getattr(self, name)) for name in ("person", "item", "rating")}
        if len(set(lengths.values())) > 1 or len(self.is_reference) != len(self.items):
            raise ValueError(
                f"columns have lengths {lengths}, references {len(self.is_reference)} for {len(self.items)} items; "
                "expected equal lengths"
            )
        is_bad = ~((self.rating >= self.low) & (self.rating <= self.high))  # NaN too
        if is_bad.any():
            row = int(np.flatnonzero(is_bad)[0])
            raise ValueError(
                f"{self.participants[self.person[row]]} rated {item_name(*self.items[self.item[row]])} with "
                f"{self.rating[row]:g}, expected {self.low:g} to {self.high:g}"
            )
        referenced = [dataset for (dataset, _), is_it in zip(self.items, self.is_reference, strict=True) if is_it]
        if len(set(referenced)) < len(referenced):
            raise ValueError(
                f"the dataset {max(referenced, key=referenced.count)!r} has several references, expected 1"
            )

    def __len__(self) -> int:
        return len(self.rating)

    def without(self, names: Collection[str]) -> RatingTable:
        """Return the ratings of the other participants."""
        return _without(self, names, ("item", "rating"))


@dataclass(frozen=True)
class ComparisonTable:
    """Comparison category ratings (CCR): how much better the second stimulus of a pair is than the first.

    Parameters
    ----------
    participants, items : as in `RatingTable`
    person : intp (N,), index of the participant
    item_a, item_b : intp (N,), the two items, of one dataset
    rating : float64 (N,), between -`high` and `high`; above 0 where `item_b` is better than `item_a`
    a_first : bool (N,), was `item_a` shown first?
    high : end of the scale, 3 on the 7-point scale
    has_order : is the order recorded in all rows? Else `a_first` says nothing
    """

    participants: tuple[str, ...]
    items: tuple[tuple[str, str], ...]
    person: NDArray[np.intp]
    item_a: NDArray[np.intp]
    item_b: NDArray[np.intp]
    rating: NDArray[np.float64]
    a_first: NDArray[np.bool_]
    high: float = 3.0
    has_order: bool = True

    def __post_init__(self) -> None:
        is_bad = ~(np.abs(self.rating) <= self.high)  # NaN too
        if is_bad.any():
            row = int(np.flatnonzero(is_bad)[0])
            raise ValueError(
                f"{self.participants[self.person[row]]} compared {self.items[self.item_a[row]][1]} and "
                f"{self.items[self.item_b[row]][1]} with {self.rating[row]:g}, expected {-self.high:g} to {self.high:g}"
            )
        dataset = np.array([dataset for dataset, _ in self.items], object)
        is_foreign = (dataset[self.item_a] != dataset[self.item_b]) | (self.item_a == self.item_b)
        if is_foreign.any():
            row = int(np.flatnonzero(is_foreign)[0])
            a, b = (item_name(*self.items[item[row]]) for item in (self.item_a, self.item_b))
            raise ValueError(f"{a} is compared with {b}, expected two items of a dataset")

    def __len__(self) -> int:
        return len(self.rating)

    def without(self, names: Collection[str]) -> ComparisonTable:
        """Return the comparisons of the other participants."""
        return _without(self, names, ("item_a", "item_b", "rating", "a_first"))


def _without(table: Table, names: Collection[str], columns: Sequence[str]) -> Table:
    """Leave participants out of a table, and their rows out of its columns besides `person`."""
    kept = [index for index, name in enumerate(table.participants) if name not in names]
    rows = np.isin(table.person, kept)
    return replace(
        table,
        participants=tuple(table.participants[index] for index in kept),
        person=np.searchsorted(kept, table.person[rows]),
        **{column: getattr(table, column)[rows] for column in columns},
    )
