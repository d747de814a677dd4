"""Understand tables of votes or ratings that were collected elsewhere, and analyse them.

Both are done in a process of its own with an end to its memory and time, as for everything that comes from outside.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.files import whole_folder
from app.intake.bounds import in_bounds

if TYPE_CHECKING:
    from app.analysis.reading.description import Told

Scale = tuple[float, float] | None
MOST_COLUMNS = 200  # that a page shows


@dataclass(frozen=True)
class Understood:
    """How a table is read, or what has to be said before it can be.

    Parameters
    ----------
    holds : votes, ratings or comparisons; empty: it is not read yet
    columns : each column of the file with its role; an empty role: it is not used
    lists : sentences: how it was read, the columns used and not used, who and what is in it
    warnings : sentences on what may have been meant otherwise
    question : what is to be chosen between; empty: nothing
    readings : the ways to read it, each in words, with what to tell for it
    refusal : why it cannot be read; empty: it can be, or is to be chosen
    """

    holds: str = ""
    columns: tuple[tuple[str, str], ...] = ()
    lists: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    question: str = ""
    readings: tuple[tuple[str, Mapping[str, str]], ...] = ()
    refusal: str = ""


def understand(path: Path, told: Told, scale: Scale = None) -> Understood:
    """Say how a table is read, as `reconstudy analyse --dry-run` does.

    Parameters
    ----------
    path : the table
    told : edits of its description
    scale : ends of the scale of ratings; None: the usual ones
    """
    return in_bounds(_understand, path, told, scale)


def analyse_table(path: Path, told: Told, out: Path, scale: Scale = None) -> None:
    """Analyse a table of votes or ratings into a new folder, as `reconstudy analyse` does.

    Raises
    ------
    ValueError
        If it cannot be read, is to be asked about, or holds nothing that counts: without the server's paths.
    """
    with whole_folder(out) as temporary:
        in_bounds(_analyse, path, told, temporary, scale)


def analysed(path: Path, told: Told, out: Path, scale: Scale = None) -> dict[str, Any]:
    """Analyse a table as `analyse_table`, and return the content of analysis.json."""
    return in_bounds(_analyse, path, told, out, scale)


def _understand(path: Path, told: Told, scale: Scale) -> Understood:
    from app.analysis.ratings.reading import understand_ratings
    from app.analysis.reading.description import QuestionError, written
    from app.analysis.reading.read_votes import understand_votes
    from app.analysis.reading.sources import WARNING, recognise_file

    columns: tuple[tuple[str, str], ...] = ()
    try:
        source = recognise_file(path, told)
        columns = _roles(source)
        _, said = understand_votes([source]) if source.holds_votes else understand_ratings(source, scale)
    except QuestionError as question:
        readings = [
            (reading.text, {"columns": written(reading.told.columns), "choices": written(reading.told.choices),
                            "format": reading.told.format})
            for reading in question.readings
        ]  # fmt: skip
        about = _without(path, question.about)
        return Understood(columns=_names(path, told), question=about, readings=tuple(readings))
    except ValueError as error:
        return Understood(columns=columns or _names(path, told), refusal=_without(path, str(error)))
    warnings = tuple(text.removeprefix(WARNING) for text in said if text.startswith(WARNING))
    lists = tuple(part for text in said if not text.startswith(WARNING) for part in text.split("\n- "))
    return Understood(source.description.holds, columns, lists, warnings)


def _analyse(path: Path, told: Told, out: Path, scale: Scale) -> dict[str, Any]:
    from app.analysis import analyse_file, analyse_ratings_file
    from app.analysis.reading.description import QuestionError
    from app.analysis.reading.sources import recognise_file

    try:
        source = recognise_file(path, told)
        if source.holds_votes:
            return analyse_file([source], out)
        return analyse_ratings_file(source, out, scale)
    except QuestionError as question:
        raise ValueError(_without(path, str(question))) from None
    except ValueError as error:
        raise ValueError(_without(path, str(error))) from None


def _roles(source: Any) -> tuple[tuple[str, str], ...]:
    """Return each column with its role."""
    roles = {name: role for role, names in source.description.columns.items() for name in names}
    roles |= dict.fromkeys(source.description.spread, f"a {source.description.spread_role}")
    return tuple((name, roles.get(name, "")) for name in source.table.names[:MOST_COLUMNS])


def _names(path: Path, told: Told) -> tuple[tuple[str, str], ...]:
    """Return the columns of a table that is not understood yet; none where it cannot be read at all."""
    from app.analysis.reading.files.tabular import read_table
    from app.analysis.reading.programs import restated

    try:
        table = restated(read_table(path, told), told.format, told.sheet)
    except ValueError:
        return ()
    roles = {theirs: role for role, names in told.columns.items() for theirs in names.split("+")}
    return tuple((name, roles.get(name, "")) for name in table.names[:MOST_COLUMNS])


def _without(path: Path, told: str) -> str:
    """Return a sentence without the place on the server that it names."""
    return told.replace(f"{path}: ", "").replace(str(path), path.name)
