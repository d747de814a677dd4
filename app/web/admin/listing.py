"""Show a long table page by page, in an order of the reader's choice, by links that work without JavaScript.

An address says both: `?page=2&sort=-votes` is the second page, most votes first. Where a page shows several tables, a
prefix tells theirs apart: `?triads_page=2`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any
from urllib.parse import urlencode

from fastapi import Request

ROWS_ON_A_PAGE = 50
AROUND = 2  # pages linked on either side of the one that is shown
DESCENDING = "-"
POLLED = "seen"  # what a page that is looked at again sends; no link keeps it
LONGEST_NUMBER = 10  # digits of a page that anybody may ask for


@dataclass(frozen=True)
class Listing:
    """A page of a table.

    Parameters
    ----------
    n_rows : of the whole table
    size : rows on a page
    page : from 1
    sort : a sortable column, with "-" before it for descending; empty: the table's usual order
    prefix : of this table's parameters in the address
    others : the address's other parameters, which links keep
    rows : those of this page
    """

    n_rows: int
    size: int
    page: int = 1
    sort: str = ""
    prefix: str = ""
    others: tuple[tuple[str, str], ...] = ()
    rows: Sequence[Any] = ()

    @property
    def is_asked(self) -> bool:
        """Whether the address asks for another page or order than the usual."""
        return self.page > 1 or bool(self.sort)

    @property
    def n_pages(self) -> int:
        return max(1, -(-self.n_rows // self.size))

    @property
    def offset(self) -> int:
        return (self.page - 1) * self.size

    @property
    def first(self) -> int:
        """Number of the page's first row, from 1; 0 in an empty table."""
        return min(self.offset + 1, self.n_rows)

    @property
    def last(self) -> int:
        return min(self.offset + self.size, self.n_rows)

    @property
    def anchor(self) -> str:
        """Id of the table's element, to which its links lead."""
        return f"{self.prefix}rows"

    @property
    def near_pages(self) -> Sequence[int | None]:
        """Numbers of the pages to link: the first, the last and those around this one; None where some are left out."""
        numbers: list[int | None] = []
        before = 0
        for number in range(1, self.n_pages + 1):
            if number not in (1, self.n_pages) and abs(number - self.page) > AROUND:
                continue
            numbers += [None, number] if number > before + 1 else [number]
            before = number
        return numbers

    def order_of(self, column: str) -> str | None:
        """Return "ascending" or "descending" if the table is sorted by a column (values of `aria-sort`)."""
        if self.sort.removeprefix(DESCENDING) != column:
            return None
        return "descending" if self.sort.startswith(DESCENDING) else "ascending"

    def link_to(self, page: int) -> str:
        return self._link(page, self.sort)

    def link_by(self, column: str) -> str:
        """Return the link that sorts by a column; the other way round if the table is sorted by it already."""
        return self._link(1, DESCENDING + column if self.order_of(column) == "ascending" else column)

    def _link(self, page: int, sort: str) -> str:
        mine = {f"{self.prefix}sort": sort, f"{self.prefix}page": str(page) if page > 1 else ""}
        query = [*self.others, *((name, value) for name, value in mine.items() if value)]
        return f"?{urlencode(query)}#{self.anchor}"


def listing(request: Request, n_rows: int, sortable: Iterable[str] = (), *, prefix: str = "") -> Listing:
    """Return the page that an address asks for, still without rows; a page beyond the end is the last one.

    Parameters
    ----------
    n_rows : of the whole table
    sortable : columns by which it may be sorted
    prefix : of the table's parameters, where a page shows several tables
    """
    asked, mine = request.query_params, (f"{prefix}page", f"{prefix}sort")
    number, sort = (asked.get(name, "") for name in mine)
    shown = Listing(
        n_rows,
        ROWS_ON_A_PAGE,
        page=int(number) if number.isdecimal() and len(number) < LONGEST_NUMBER else 1,
        sort=sort if sort.removeprefix(DESCENDING) in set(sortable) else "",
        prefix=prefix,
        others=tuple((name, value) for name, value in asked.multi_items() if name not in (*mine, POLLED)),
    )
    return replace(shown, page=min(max(1, shown.page), shown.n_pages))


def listed(
    request: Request, rows: Sequence[Mapping[str, Any]], sortable: Iterable[str] = (), *, prefix: str = ""
) -> Listing:
    """Return the page that an address asks for, of rows in memory; the other parameters are as in `listing`.

    Parameters
    ----------
    rows : of the whole table, in its usual order; missing values are sorted last
    """
    shown = listing(request, len(rows), sortable, prefix=prefix)
    if shown.sort:
        column = shown.sort.removeprefix(DESCENDING)
        there = [row for row in rows if row[column] is not None]
        there.sort(key=lambda row: _rank(row[column]), reverse=shown.sort.startswith(DESCENDING))
        rows = [*there, *(row for row in rows if row[column] is None)]
    return replace(shown, rows=rows[shown.offset : shown.last])


def _rank(value: Any) -> Any:
    """Return what orders a value among those of its column: letters without regard to case."""
    return value.casefold() if isinstance(value, str) else value
