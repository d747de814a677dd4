"""Hold votes as integer columns that point into lists of names: the input of every analysis."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

CHOICES = ("a", "b", "none")
A, B, NONE = range(3)
CHOICE_CODES = {choice: code for code, choice in enumerate(CHOICES)}
ROLES = ("main", "repeat", "identical")
MAIN, REPEAT, IDENTICAL = range(3)
ROLE_CODES = {"": MAIN} | {role: code for code, role in enumerate(ROLES)}  # an empty cell is a vote to score
ALL = "all"  # in results: all datasets together, or the comparison of all items
WITHDRAWN = "withdrawn"  # reason of the participant's own exclusion, which an experimenter cannot undo


class VotesError(ValueError):
    """A table is not a votes table; the message names the row and the value."""

    def at(self, place: Path | str) -> VotesError:
        """Return the refusal of a file."""
        return VotesError(f"{place}: {self}")


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Name the file in what is refused of it."""
    try:
        yield
    except FileNotFoundError as error:
        raise VotesError(f"{path}: there is no such file") from error
    except VotesError as error:
        raise error.at(path) from error


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
    shown_smoothly : int8 (N,), 1 = the frames support the viewing, 0 = they do not, -1 = not recorded
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
    shown_smoothly: NDArray[np.int8]
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
    def n_voters(self) -> int:
        """Number of participants with rows in the table."""
        return len(numbered(self.participant, len(self.participants))[0])

    @property
    def has_datasets(self) -> bool:
        """Are the votes divided into named datasets?"""
        return self.datasets != ("",)

    @property
    def is_used(self) -> NDArray[np.bool_]:
        """Which rows are to be scored, bool (N,): not practice, excluded or attention checks, nor rows of no vote."""
        return np.asarray(~(self.practice | self.excluded) & (self.role == MAIN) & (self.count > 0))

    @property
    def pair(self) -> NDArray[np.int64]:
        """Number of each row's pair of items in either order, int64 (N,): lower index times n plus higher index."""
        low, high = np.minimum(self.item_a, self.item_b), np.maximum(self.item_a, self.item_b)
        return low.astype(np.int64) * len(self.items) + high

    @property
    def prefers_lower(self) -> NDArray[np.bool_]:
        """Is the item of the pair's lower index preferred? bool (N,); without meaning for no preference."""
        return np.asarray((self.choice == A) == (self.item_a < self.item_b))

    def where(self, rows: NDArray[np.bool_] | NDArray[np.integer[Any]] | slice) -> VotesTable:
        """Return the table with only these rows, bool (N,), int (M,) or a slice; the lists of names stay."""
        if isinstance(rows, np.ndarray) and rows.dtype == bool:
            rows = np.flatnonzero(rows)  # looked up once, not for each column
        columns = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in NAMES}
        size = len(columns["choice"][rows])
        kept: dict[str, Any] = {name: _rows_of(column, rows, size) for name, column in columns.items()}
        return replace(self, **kept)

    def by_participant(self) -> dict[int, VotesTable]:
        """Return the rows of each participant, by index."""
        is_sorted = bool((np.diff(self.participant) >= 0).all())
        ordered = self if is_sorted else self.where(order_of(self.participant, len(self.participants)))
        bounds = bounds_of(ordered.participant)
        return {int(ordered.participant[start]): ordered.where(slice(start, end)) for start, end in pairwise(bounds)}

    def used(self) -> VotesTable:
        """Return the rows to score."""
        is_used = self.is_used
        return self if is_used.all() else self.where(is_used)

    def with_items(self, is_kept: NDArray[np.bool_]) -> VotesTable:
        """Return the table without the other items, of which no row may be; bool (n,)."""
        if is_kept.all():
            return self
        index = np.cumsum(is_kept).astype(np.int32) - np.int32(1)
        items = tuple(name for name, kept in zip(self.items, is_kept, strict=True) if kept)
        return replace(self, items=items, item_a=index[self.item_a], item_b=index[self.item_b])


def _rows_of(column: NDArray[Any], rows: Any, size: int) -> NDArray[Any]:
    """Return rows of a column; a single value that stands for all rows stays one, and takes no memory."""
    return np.broadcast_to(column[:1], size) if len(column) and column.strides == (0,) else column[rows]


def numbered(codes: NDArray[np.integer[Any]], size: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return which codes are there, and each row's place among them: `numpy.unique` without sorting.

    Parameters
    ----------
    codes : int (N,), from 0
    size : more than the largest code

    Returns
    -------
    codes, ascending, intp (M,), and places, intp (N,)
    """
    is_there = np.zeros(size, bool)
    is_there[codes] = True
    return np.flatnonzero(is_there), (np.cumsum(is_there) - 1)[codes]


def order_of(codes: NDArray[np.integer[Any]], size: int) -> NDArray[np.intp]:
    """Return the order that sorts codes below `size`, int (N,), stably, intp (N,); numpy is fast with 16 bits."""
    return np.argsort(codes.astype(np.uint16) if size <= SIXTEEN_BITS else codes, kind="stable")


def bounds_of(ordered: NDArray[np.integer[Any]]) -> list[int]:
    """Return where each run of equal codes starts in sorted codes, int (N,), and N at the end."""
    return [0, *(np.flatnonzero(np.diff(ordered)) + 1).tolist(), len(ordered)] if len(ordered) else [0]


SIXTEEN_BITS = 2**16
UNRECORDED: dict[str, Any] = {  # what a column holds, and as what, where nothing is known; any other is false
    **dict.fromkeys(("participant", "dataset", "item_a", "item_b"), np.int32(0)),
    **dict.fromkeys(("choice", "role"), np.int8(MAIN)),
    **dict.fromkeys(("first_shown", "both_seen", "shown_smoothly"), np.int8(-1)),
    **dict.fromkeys(("response_ms", "press_to_picture_ms"), np.float64(np.nan)),
    **dict.fromkeys(("practice", "excluded"), np.False_),
    "count": np.int64(1),
    "reason": np.array("", np.object_),
}
NAMES = ("participants", "datasets", "items")
NAMES_OF = {"participant": "participants", "dataset": "datasets", "item_a": "items", "item_b": "items"}


def joined(tables: Sequence[VotesTable]) -> VotesTable:
    """Return several tables as one; the same name means the same participant, dataset or item.

    Raises
    ------
    VotesError
        If only some of the tables name participants, or datasets.
    """
    for what in ("participants", "datasets"):
        are_named = [getattr(table, what) != ("",) for table in tables]
        if any(are_named) and not all(are_named):
            raise VotesError(f"some of the {len(tables)} files name {what} and others do not; name them in all or none")
    names: dict[str, Any] = {
        what: tuple(dict.fromkeys(n for table in tables for n in getattr(table, what))) for what in NAMES
    }
    places = {what: {name: place for place, name in enumerate(names[what])} for what in NAMES}
    columns: dict[str, Any] = {}
    for column in (f.name for f in fields(VotesTable) if f.name not in NAMES):
        parts = [getattr(table, column) for table in tables]
        if column in NAMES_OF:
            what = NAMES_OF[column]
            maps = [np.array([places[what][name] for name in getattr(table, what)], np.int32) for table in tables]
            parts = [codes[part] for codes, part in zip(maps, parts, strict=True)]
        columns[column] = np.concatenate(parts)
    return VotesTable(**names, **columns)


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
    columns = {"participant": participant, "dataset": dataset, "item_a": item_a, "item_b": item_b, "choice": choice}
    columns |= {} if count is None else {"count": count}
    columns |= {} if first_shown is None else {"first_shown": first_shown}
    made: dict[str, Any] = {name: column.astype(UNRECORDED[name].dtype, copy=False) for name, column in columns.items()}
    made |= {name: unrecorded(name, len(choice)) for name in UNRECORDED.keys() - made.keys()}
    participants, datasets, items = map(tuple, names)
    return VotesTable(participants, datasets, items, **made)


def unrecorded(role: str, n: int) -> NDArray[Any]:
    """Return a column (N,) of what is not recorded, or not so: read-only, and it takes the memory of one value.

    Parameters
    ----------
    role : name of the column
    n : N
    """
    return np.broadcast_to(UNRECORDED.get(role, np.False_), n)


def only_compared(votes: VotesTable) -> VotesTable:
    """Return the table without the items that no row compares."""
    seen = np.zeros(len(votes.items), bool)
    seen[votes.item_a] = seen[votes.item_b] = True
    return votes.with_items(seen)
