"""Check the entries of a study file's tables, each by its key: what was given, and what is expected instead."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any


def is_list(value: object) -> bool:
    """Is a value a list, rather than a text?"""
    return isinstance(value, Sequence) and not isinstance(value, str)


@dataclass(frozen=True)
class Entries:
    """The entries of a table; every method raises ValueError with key and value.

    Parameters
    ----------
    content : key -> value
    table : name of the table, for messages; empty: the options themselves
    """

    content: Mapping[str, Any]
    table: str = ""

    @classmethod
    def of_table(cls, content: Any, table: str, known: Iterable[str]) -> Entries:
        """Take a table of which all keys are known.

        Parameters
        ----------
        content : what stands in place of the table
        table : its name
        known : keys
        """
        if not isinstance(content, Mapping):
            raise ValueError(f"{table} is {content!r:.120}, expected a table of its own")
        if unknown := sorted(set(content) - set(known)):
            raise ValueError(f"{table}: {unknown[0]!r} is not known; expected some of {', '.join(known)}")
        return cls(content, table)

    def flag(self, key: str, *, default: bool = False) -> bool:
        """Return true or false."""
        value = self.content.get(key, default)
        if not isinstance(value, bool):
            raise self.refusal(key, "true or false")
        return value

    def count(self, key: str, most: int, default: int = 0) -> int:
        """Return a whole number.

        Parameters
        ----------
        key : of the entry
        most : allowed; the least is 0
        default : without the entry
        """
        value = self.content.get(key, default)
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= most:
            raise self.refusal(key, f"a whole number from 0 to {most}")
        return value

    def number(self, key: str, bounds: tuple[float, float], default: float) -> float:
        """Return a number.

        Parameters
        ----------
        key : of the entry
        bounds : the least and the most allowed
        default : without the entry
        """
        value = self.content.get(key, default)
        if isinstance(value, bool) or not isinstance(value, int | float) or not bounds[0] <= value <= bounds[1]:
            raise self.refusal(key, f"a number from {bounds[0]:g} to {bounds[1]:g}")
        return float(value)

    def text(self, key: str, longest: int) -> str:
        """Return a text without spaces around it; empty by default."""
        value = self.content.get(key, "")
        if not isinstance(value, str) or len(value) > longest:
            raise self.refusal(key, f"a text of at most {longest} characters")
        return value.strip()

    def match(self, key: str, pattern: re.Pattern[str], expected: str) -> str:
        """Return a text that a pattern matches as a whole, or nothing.

        Parameters
        ----------
        key : of the entry
        pattern : of the whole text
        expected : what the pattern matches, in words
        """
        value = self.content.get(key, "")
        if not isinstance(value, str) or not (value == "" or pattern.fullmatch(value)):
            raise self.refusal(key, f"{expected}, or nothing")
        return value

    def one_of(self, key: str, known: Sequence[Any], default: Any = "") -> Any:
        """Return one of the known values.

        Parameters
        ----------
        key : of the entry
        known : values; an empty one among them stands for nothing
        default : without the entry
        """
        value = self.content.get(key, default)
        if value not in known:
            raise self.refusal(key, f"one of {', '.join(filter(None, known))}{', or nothing' if '' in known else ''}")
        return value

    def names(self, key: str) -> tuple[str, ...]:
        """Return a list of names, each once; empty by default."""
        value = self.content.get(key, ())
        if not is_list(value) or not all(isinstance(name, str) for name in value):
            raise self.refusal(key, "a list of names")
        return tuple(dict.fromkeys(value))

    def refusal(self, key: str, expected: str) -> ValueError:
        """Return the error that tells what stands at a key, and what is expected."""
        value = repr(self.content[key])
        shown = value if len(value) <= 120 else f"{value[:120]}…"
        return ValueError(f"{self.table}{': ' if self.table else ''}{key} is {shown}, expected {expected}")
