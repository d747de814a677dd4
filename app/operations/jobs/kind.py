"""A kind of job: its form, and the command that its values become."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from app.errors import InvalidError
from app.operations.jobs.fields import Entry, Field, NewName, Values, place
from app.operations.jobs.forms import fields_of, out_option
from app.operations.jobs.shared_fields import chain_fields
from app.settings import Settings
from app.store.queue import NewJob


@dataclass(frozen=True, kw_only=True)
class JobKind:
    """What a job of a kind does.

    Parameters
    ----------
    name : in addresses and over REST
    title, help : as people read them
    command : as `COMMANDS` names it
    places : by the name of a setting, the field of the entry or of the name that it takes as a path
    out_file : the file in the output that the command writes; empty: the output itself
    changes : the shelf and name of what the job changes; without it, it makes what its form has a name for
    more : further arguments that follow from the values
    needs_recon : whether it takes the extra `recon`
    then : the kinds of jobs that can follow by themselves, a study at their end; None: nothing can
    """

    name: str
    title: str
    help: str
    command: str
    places: Mapping[str, Field]
    changes: Callable[[Values], tuple[str, str]] | None = None
    out_file: str = ""
    more: Callable[[Values, Settings], list[str]] = lambda _values, _settings: []
    needs_recon: bool = True
    then: tuple[str, ...] | None = None

    @cached_property
    def fields(self) -> tuple[Field, ...]:
        """In the order of the form, which is that of the command's help."""
        chained = () if self.then is None else chain_fields(self.then)
        return (*fields_of(self.command, self.places), *chained)

    @property
    def first_entry(self) -> Entry:
        """The field of the entry that the job begins with."""
        return next(field for field in self.fields if isinstance(field, Entry))

    @cached_property
    def out_option(self) -> str | None:
        """Of the command for the output; empty: its last argument; None: it has none, as it changes an entry."""
        return out_option(self.command, self.places)

    def output(self, values: Values) -> tuple[str, str]:
        """Return the shelf and name of what the job makes or changes."""
        if self.changes is not None:
            return self.changes(values)
        new = next(field for field in self.fields if isinstance(field, NewName))
        return new.shelf, values[new.name]

    @property
    def makes_new(self) -> bool:
        """Whether its output is new; else it changes an entry, or adds to one."""
        return any(isinstance(field, NewName) for field in self.fields)

    def read(self, given: Mapping[str, Any], settings: Settings) -> NewJob:
        """Check what a form or a client gave.

        Raises
        ------
        InvalidError
            If a field is missing, unknown or not as expected: names it.
        """
        known = {field.name for field in self.fields}
        if unknown := sorted(given.keys() - known):
            raise InvalidError(f"There is no field {unknown[0][:40]!r}; expected some of {', '.join(sorted(known))}.")
        values = {field.name: field.read(given.get(field.name), settings) for field in self.fields}
        for field in self.fields:
            if values[field.name] is None:
                values[field.name] = field.made_from(values, settings)
        self.more(values, settings)  # which refuses what it cannot use
        return NewJob(self.name, values, "/".join(self.output(values)))

    def reads(self, values: Values) -> set[str]:
        """Return the entries that the values name, as "SHELF/NAME"."""
        fields = [field for field in self.fields if isinstance(field, Entry) and values.get(field.name) is not None]
        return {place for field in fields for place in field.places(values[field.name])}

    def argv(self, values: Values, settings: Settings) -> list[str]:
        """Return the arguments of the command line.

        Raises
        ------
        InvalidError
            If an entry is not there any more.
        """
        words = self.command.split()
        for field in self.fields:
            if field.option is not None and values.get(field.name) is not None:
                words += field.words(values[field.name], settings)
        words += self.more(values, settings)
        if self.out_option is not None:
            shelf, name = self.output(values)
            out = place(settings, shelf) / name / self.out_file
            words.append(f"{self.out_option}={out}" if self.out_option else str(out))
        return words
