"""Take the keys out of the addresses of films that servers give for a single look, so that a film has one name."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace

from app.analysis.reading.cells import Column, Table, named

ADDRESS = re.compile(r"(https?://[^\s?#]+)\?([^\s#]+)(.*)", re.IGNORECASE)
# Keys of a query that let somebody in for a time; what they are says nothing of the film.
KEYS = re.compile(
    r"(access[_-]?)?token|sig(nature)?|expires?|policy|key-pair-id|x-(amz|goog)-.*|awsaccesskeyid|googleaccessid|"
    r"nonce|hash|cachebuster|session(id)?|sid",
    re.IGNORECASE,
)
FEWEST_LOOKS = 8  # addresses with a value of their own each, which is then that of a look
SHORTEST_KEY = 6  # letters; shorter may number the films


def without_keys(table: Table) -> Table:
    """Leave out of the addresses in a table what differs from look to look, where they still are several films."""
    columns = {name: column for name, column in table.columns.items() if any(map(ADDRESS.fullmatch, column.words))}
    if not columns:
        return table
    keys = {key for column in columns.values() for key in _keys_of_looks(column)}
    before = {word for column in columns.values() for word in column.filled if ADDRESS.fullmatch(word)}
    after = {_shortened(word, keys) for word in before}
    if not 1 < len(after) < len(before):
        return table
    shortened = {
        name: column.mapped(_shortened(word, keys) for word in column.words) for name, column in columns.items()
    }
    note = f"addresses are taken without {named(sorted(keys))}: {len(before)} become {len(after)}"
    return replace(table, columns={**table.columns, **shortened}, notes=(*table.notes, note))


def _keys_of_looks(column: Column) -> Iterator[str]:
    """Yield the keys in a column's addresses that are known as such, or never have the same long value twice."""
    values: dict[str, list[str]] = {}
    for word in column.texts.tolist():
        for key, value in _query(word):
            values.setdefault(key, []).append(value)
    for key, theirs in values.items():
        is_long = min(map(len, theirs)) >= SHORTEST_KEY
        if KEYS.fullmatch(key) or (is_long and len(set(theirs)) == len(theirs) >= FEWEST_LOOKS):
            yield key


def _query(word: str) -> Iterable[tuple[str, str]]:
    match = ADDRESS.fullmatch(word)
    return ((part.partition("=")[0], part.partition("=")[2]) for part in match[2].split("&")) if match else ()


def _shortened(word: str, keys: Collection[str]) -> str:
    match = ADDRESS.fullmatch(word)
    if match is None:
        return word
    kept = "&".join(part for part in match[2].split("&") if part.partition("=")[0] not in keys)
    return f"{match[1]}{'?' if kept else ''}{kept}{match[3]}"
