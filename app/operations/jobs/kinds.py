"""All kinds of jobs. None of their commands opens the database."""

from __future__ import annotations

import re
from collections.abc import Mapping

from app.errors import InvalidError
from app.operations.jobs.films import FILMS
from app.operations.jobs.kind import JobKind
from app.operations.jobs.recordings import RECORDINGS
from app.operations.jobs.validations import VALIDATIONS
from app.settings import Settings

NAMED = re.compile(r"`(?:reconstudy )?([a-z][^`]*)`")
GROUPS: Mapping[str, tuple[JobKind, ...]] = {
    "Recordings": RECORDINGS,
    "Models and films": FILMS,
    "Measures": VALIDATIONS,
}
KINDS: Mapping[str, JobKind] = {kind.name: kind for kinds in GROUPS.values() for kind in kinds}


def job_kind(name: str) -> JobKind:
    """Find a kind by its name.

    Raises
    ------
    InvalidError
        If there is none.
    """
    if name not in KINDS:
        raise InvalidError(f"There is no kind of job {name[:40]!r}; expected one of {', '.join(KINDS)}.")
    return KINDS[name]


def title_of(name: str) -> str:
    """Return the title of a kind; the name itself of one that is no more."""
    return KINDS[name].title if name in KINDS else name


def in_page_words(said: str) -> str:
    """Name the jobs whose commands a sentence names: who reads it on a page has no command line."""
    titles = {kind.command: kind.title for kind in KINDS.values()}

    def title(named: re.Match[str]) -> str:
        words = named[1].split()
        known = (titles.get(" ".join(words[:n])) for n in (2, 1))
        return next((f"the job “{name}”" for name in known if name), named[0])

    return NAMED.sub(title, said)


def kinds_for(settings: Settings, shelf: str, name: str) -> list[tuple[JobKind, str, str]]:
    """Return the kinds that can begin with an entry: each with the field that takes it, and the value there."""
    starts = []
    for kind in KINDS.values():
        value = kind.first_entry.value_for(settings, shelf, name)
        if value is not None:
            starts.append((kind, kind.first_entry.name, value))
    return starts
