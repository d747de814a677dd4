"""Read and check the fields of a job's form, and write them as arguments of a command.

A job stores names, numbers and choices. Paths are made from them where the job runs: below the server's own folders, of
entries that lie there. No text from outside becomes a path, an option or a command.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Literal

from app.errors import InvalidError
from app.intake.shelves import LONGEST_NAME, checked_name, is_plain, shelf
from app.intake.summaries import CLOUDS, clouds_among, is_readable
from app.settings import Settings

SETS = "sets"  # the stimulus sets' folder, beside the shelves of the intake folder
MOST_ENTRIES = 50
LONGEST_TEXT = 200
LONGEST_MADE = 80  # characters of a name that is made from others

Values = Mapping[str, Any]


def place(settings: Settings, kind: str) -> Path:
    """Return the folder of a shelf or of the stimulus sets, absolute."""
    return (settings.sets_dir if kind == SETS else shelf(settings.intake_dir, kind)).absolute()


@dataclass(frozen=True, kw_only=True)
class Field:
    """A field of a job's form.

    Parameters
    ----------
    name : in forms and over REST
    label, help : as people read them
    option : of the command, such as "--depth"; empty: an argument by its place; None: the kind writes it
    is_required : whether it must be given
    default : the value where none is given; None: the command's own
    """

    name: str
    label: str
    help: str = ""
    option: str | None = ""
    is_required: bool = False
    default: Any = None

    def read(self, given: Any, settings: Settings) -> Any:
        """Return the checked value of what a form or a client gave; None: nothing.

        Raises
        ------
        InvalidError
            If it is missing or not as the field expects.
        """
        empty = given is None or given == [] or (isinstance(given, str) and not given.strip())
        if empty and self.is_required:
            raise InvalidError(f"{self.label}: is missing.")
        return self.default if empty else self.checked(given, settings)

    def checked(self, given: Any, settings: Settings) -> Any:
        """Return the value, of the field's type."""
        raise NotImplementedError

    def made_from(self, values: Values, settings: Settings) -> Any:  # noqa: ARG002 (some fields need them)
        """Return the value that follows from those of other fields where none is given; None: none does."""
        return None

    def words(self, value: Any, settings: Settings) -> list[str]:  # noqa: ARG002 (entries need the settings)
        """Return the command's arguments for a value."""
        return [f"{self.option}={value}" if self.option else str(value)]

    def refuse(self, given: Any, expected: str) -> InvalidError:
        """Return the error of a value that does not fit."""
        return InvalidError(f"{self.label}: {str(given)[:80]!r} was given, expected {expected}.")


@dataclass(frozen=True, kw_only=True)
class Entry(Field):
    """One entry of a shelf, by name; by "SHELF/NAME" where several shelves may be chosen from.

    Parameters
    ----------
    shelves : where it may lie
    holds : a file that it has, which tells it from other entries of the shelf; empty: any
    lacks : a file that it does not have; empty: any
    takes : a folder, a file, either, or files: one, or all clouds of a folder
    otherwise : the entry that other fields' values name, where none is chosen
    """

    shelves: tuple[str, ...]
    holds: str = ""
    lacks: str = ""
    takes: Literal["folder", "file", "either", "files"] = "folder"
    otherwise: Callable[[Values, Settings], str | None] = lambda _values, _settings: None

    def names(self, settings: Settings) -> list[str]:
        """Return the names that can be chosen, in order."""
        names: list[str] = []
        for kind in self.shelves:
            folder = place(settings, kind)
            paths = sorted(folder.iterdir()) if folder.is_dir() and is_readable(folder) else []
            names += [self._name(kind, path.name) for path in paths if self._is_fit(path)]
        return names

    def checked(self, given: Any, settings: Settings) -> str:
        """Return the name of an entry that is there."""
        if not isinstance(given, str):
            raise self.refuse(given, "a name")
        self.path(given, settings)
        return given

    def made_from(self, values: Values, settings: Settings) -> str | None:
        """Return the entry that is used where none is chosen."""
        return self.otherwise(values, settings)

    def path(self, name: str, settings: Settings) -> Path:
        """Return where an entry lies.

        Raises
        ------
        InvalidError
            If it is not there, or not an entry to choose here.
        """
        kind, _, plain = name.rpartition("/") if len(self.shelves) > 1 else (self.shelves[0], "", name)
        path = place(settings, kind) / plain if kind in self.shelves and is_plain(plain) else None
        if path is None or not self._is_fit(path):
            needed = f" with a {self.holds}" if self.holds else f" without a {self.lacks}" if self.lacks else ""
            needed = " that is or holds clouds" if self.takes == "files" else needed
            raise self.refuse(name, f"the name of something{needed} in {' or '.join(self.shelves)}")
        return path

    def words(self, value: Any, settings: Settings) -> list[str]:
        """Return the entry's path, or those of the files in it."""
        path = self.path(value, settings)
        paths = _clouds_in(path) if self.takes == "files" and path.is_dir() else [path]
        return [f"{self.option}={path}" if self.option else str(path) for path in paths]

    def places(self, value: Any) -> set[str]:
        """Return the entries that a value names, as "SHELF/NAME"."""
        return {value if "/" in value else f"{self.shelves[0]}/{value}"}

    def value_for(self, settings: Settings, kind: str, name: str) -> str | None:
        """Return the value that chooses an entry; None where this field does not take it."""
        is_taken = kind in self.shelves and self._is_fit(place(settings, kind) / name)
        return self._name(kind, name) if is_taken else None

    def _name(self, kind: str, name: str) -> str:
        return f"{kind}/{name}" if len(self.shelves) > 1 else name

    def _is_fit(self, path: Path) -> bool:
        if not is_plain(path.name) or not is_readable(path) or path.is_symlink():
            return False
        is_taken = (path.is_dir() and self.takes != "file") or (path.is_file() and self.takes != "folder")
        is_other = bool(self.lacks) and (path / self.lacks).is_file()
        if self.takes == "files" and path.is_dir() and not _clouds_in(path):
            return False
        return is_taken and not is_other and (not self.holds or (path / self.holds).is_file())


def _clouds_in(folder: Path) -> list[Path]:
    return clouds_among(sorted(path for path in folder.iterdir() if path.is_file()))


@dataclass(frozen=True, kw_only=True)
class Entries(Entry):
    """Some entries of shelves, as `Entry` each."""

    def checked(self, given: Any, settings: Settings) -> Any:
        """Return the names of entries that are there."""
        names = [given] if isinstance(given, str) else given
        if not isinstance(names, list) or len(names) > MOST_ENTRIES:
            raise self.refuse(given, f"1 to {MOST_ENTRIES} names")
        return list(dict.fromkeys(super(Entries, self).checked(name, settings) for name in names))

    def words(self, value: Any, settings: Settings) -> list[str]:
        """Return the entries' paths."""
        return [word for name in value for word in super(Entries, self).words(name, settings)]

    def places(self, value: Any) -> set[str]:
        """Return the entries that the values name, as "SHELF/NAME"."""
        return {place for name in value for place in super(Entries, self).places(name)}


@dataclass(frozen=True, kw_only=True)
class NewName(Field):
    """A name for what the job makes; without one it is made from another field's value.

    Parameters
    ----------
    shelf : where it will lie
    pattern : of the name, with other fields' values, such as "{capture}-check"
    """

    option: str | None = None
    shelf: str
    pattern: str = ""

    def checked(self, given: Any, settings: Settings) -> str:
        """Return a name that nothing has yet."""
        if not isinstance(given, str):
            raise self.refuse(given, "a name")
        name = checked_name("runs", given.strip())
        if (place(settings, self.shelf) / name).exists():
            raise InvalidError(f"{self.label}: there is {name!r} already; choose another name.")
        return name

    def made_from(self, values: Values, settings: Settings) -> str:
        """Return the name by the pattern, with a number where it is taken."""
        name = self.by_pattern(values)
        numbered = (f"{name}-{number}" if number > 1 else name for number in range(1, 10_000))
        return checked_name(
            "runs", next(free for free in numbered if not (place(settings, self.shelf) / free).exists())
        )

    def by_pattern(self, values: Values) -> str:
        """Return the name by the pattern, taken or not."""
        parts = {name: _plain(value) for name, value in values.items() if value is not None}
        name = self.pattern.format(**parts)[:LONGEST_MADE].encode()[: LONGEST_NAME - len("-9999")]
        return name.decode(errors="ignore").rstrip(" .")  # what was cut may end within a letter


@dataclass(frozen=True, kw_only=True)
class Choice(Field):
    """One of several values.

    Parameters
    ----------
    choices : what each value means, by value
    """

    choices: Mapping[str, str]

    def checked(self, given: Any, settings: Settings) -> str:  # noqa: ARG002
        """Return the value, which is one of the choices."""
        if given not in tuple(self.choices):
            raise self.refuse(given, f"one of {', '.join(self.choices)}")
        return str(given)


@dataclass(frozen=True, kw_only=True)
class Choices(Field):
    """Some of several values, joined by commas.

    Parameters
    ----------
    choices : what each value means, by value
    """

    choices: Mapping[str, str]

    def checked(self, given: Any, settings: Settings) -> list[str]:  # noqa: ARG002
        """Return the values, in the order of the choices."""
        values = given.split(",") if isinstance(given, str) else given
        if not isinstance(values, list) or not all(value in tuple(self.choices) for value in values):
            raise self.refuse(given, f"some of {', '.join(self.choices)}")
        return [choice for choice in self.choices if choice in values]

    def words(self, value: Any, settings: Settings) -> list[str]:  # noqa: ARG002
        """Return the values with commas."""
        return [f"{self.option}={','.join(value)}"]


@dataclass(frozen=True, kw_only=True)
class Number(Field):
    """A number within bounds.

    Parameters
    ----------
    low, high : bounds, which are allowed
    is_whole : whether it counts something
    """

    low: float
    high: float
    is_whole: bool = False

    def checked(self, given: Any, settings: Settings) -> float | int:  # noqa: ARG002
        """Return the number."""
        try:
            value = float(given) if isinstance(given, str | int | float) and not isinstance(given, bool) else math.nan
        except (ValueError, OverflowError):  # the latter: a whole number of hundreds of digits
            value = math.nan
        if not self.low <= value <= self.high or (self.is_whole and value != int(value)):
            raise self.refuse(given, f"a {'whole ' * self.is_whole}number from {self.low:g} to {self.high:g}")
        return int(value) if self.is_whole else value


@dataclass(frozen=True, kw_only=True)
class Text(Field):
    """A short text of a stated form.

    Parameters
    ----------
    form : regular expression of the whole text
    example : what it looks like
    """

    form: str
    example: str

    def checked(self, given: Any, settings: Settings) -> str:  # noqa: ARG002
        """Return the text."""
        text = given.strip() if isinstance(given, str) else ""
        if len(text) > LONGEST_TEXT or not re.fullmatch(self.form, text):
            raise self.refuse(given, f"for example {self.example}")
        return text


@dataclass(frozen=True, kw_only=True)
class FrameRange(Text):
    """A range of frames, of which there is at least one."""

    def checked(self, given: Any, settings: Settings) -> str:
        """Return the range, whose end comes after its beginning."""
        text = super().checked(given, settings)
        first, _, end = text.partition(":")
        if end and int(end) <= int(first or 0):
            raise self.refuse(given, f"an end after the first frame, for example {self.example}")
        return text


@dataclass(frozen=True, kw_only=True)
class Names(Text):
    """Names with commas between; the command gets its option once for each."""

    def words(self, value: Any, settings: Settings) -> list[str]:  # noqa: ARG002
        """Return the option for each name, in order."""
        return [f"{self.option}={name.strip()}" for name in value.split(",")]


@dataclass(frozen=True, kw_only=True)
class Switch(Field):
    """Yes or no.

    Parameters
    ----------
    off_option : of the command for no; `option` is that for yes. Empty: nothing is said
    """

    off_option: str = ""
    default: Any = False

    def checked(self, given: Any, settings: Settings) -> bool:  # noqa: ARG002
        """Return the answer."""
        known = {"yes": True, "no": False, True: True, False: False}
        if not isinstance(given, str | bool) or given not in known:
            raise self.refuse(given, "yes or no")
        return known[given]

    def words(self, value: Any, settings: Settings) -> list[str]:  # noqa: ARG002
        """Return the option for the answer, if there is one."""
        option = self.option if value else self.off_option
        return [option] if option else []


def _plain(value: Any) -> str:
    """Return what a name is made from: of several entries the first, without its shelf and file's ending."""
    first: Any = value[0] if isinstance(value, Sequence) and not isinstance(value, str) and value else value
    name = PurePosixPath(str(first).rpartition("/")[2])
    return name.stem if name.suffix.lower() in CLOUDS else name.name
