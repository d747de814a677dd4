"""Say which films a study's participants practise with, as the study's options name them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from app.study.option_fields import is_list

MOST_PRACTICE = 10  # pairs; more are a study of their own
LONGEST_NAME = 200  # characters of a dataset or condition, as in a stimulus set


@dataclass(frozen=True)
class PracticeFilms:
    """Two films of the same dataset that are shown for practice.

    Parameters
    ----------
    dataset : of both
    a, b : their conditions
    """

    dataset: str
    a: str
    b: str


def parse_practice_pairs(content: Any) -> tuple[PracticeFilms, ...]:
    """Read the option `practice_pairs`: a list of tables with the keys of `PracticeFilms`.

    Raises
    ------
    ValueError
        Naming the entry that is not as described.
    """
    if not is_list(content) or len(content) > MOST_PRACTICE:
        raise ValueError(
            f"practice_pairs is {content!r:.120}, expected a list of at most {MOST_PRACTICE} like "
            '{dataset = "ball", a = "good", b = "coarse"}'
        )
    return tuple(_films(entry) for entry in content)


def _films(entry: object) -> PracticeFilms:
    if isinstance(entry, PracticeFilms):
        return entry
    names = [field.name for field in fields(PracticeFilms)]
    if not isinstance(entry, Mapping) or set(entry) != set(names) or not all(map(_is_name, entry.values())):
        raise ValueError(f"practice_pairs has {entry!r:.120}, expected texts for {', '.join(names)}")
    films = PracticeFilms(**entry)
    if films.a == films.b:
        raise ValueError(
            f"practice_pairs names {films.a!r} twice, expected two different conditions of {films.dataset}"
        )
    return films


def _is_name(value: object) -> bool:
    return isinstance(value, str) and 0 < len(value) <= LONGEST_NAME
