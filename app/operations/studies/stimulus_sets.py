"""Look after the server's stimulus sets: list them, name their factors, rename and delete them.

The sets are those in the server's folder, and those elsewhere that a study was made of, such as the demo's. A manifest
that changes has another digest; the studies made of the set then note the new one, so that they still know it.
"""

from __future__ import annotations

import json
import secrets
import shutil
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.errors import ConflictError, InvalidError, NotFoundError, StimuliError, said_on_page
from app.files import read_json, whole_file
from app.intake.stimuli import MANIFEST, TOGETHER, StimulusSet, level_notes, read_manifest
from app.operations.jobs.fields import SETS
from app.operations.jobs.queueing import refuse_while_used, uses
from app.operations.studies.create import slugify
from app.settings import Settings
from app.store.database.engine import Database, Transaction
from app.store.queue import OPEN, list_jobs
from app.store.studies.audit import Actor
from app.store.studies.studies import Study, all_studies, edit_set
from app.store.trials.designs import change_levels
from app.study.options.options import parse_options

LONGEST_LEVEL = 100  # characters of a factor's name, or of a level
MOST_FACTORS = 20


@dataclass(frozen=True)
class KnownSet:
    """A stimulus set that this server can read.

    Parameters
    ----------
    name : in addresses
    content : of its manifest
    is_here : does it lie in the server's folder of stimulus sets?
    """

    name: str
    content: StimulusSet
    is_here: bool

    @property
    def title(self) -> str:
        return self.content.name

    @property
    def folder(self) -> Path:
        return self.content.folder

    @property
    def datasets(self) -> tuple[str, ...]:
        return self.content.datasets

    @property
    def conditions(self) -> tuple[str, ...]:
        return self.content.conditions

    @property
    def size(self) -> str:
        """Size of the first film, others may differ, and the lengths of the shortest and the longest."""
        films = self.content.stimuli
        seconds = sorted(film.n_frames / film.fps for film in films)
        lengths = dict.fromkeys(f"{length:.3g}" for length in (seconds[0], seconds[-1]))
        return f"{films[0].width}×{films[0].height}, {' to '.join(lengths)} s"

    @property
    def levels(self) -> dict[str, dict[str, str]]:
        """Level by factor, by condition."""
        return {stimulus.approach: stimulus.levels for stimulus in self.content.stimuli}

    @property
    def notes(self) -> list[str]:
        """Sentences on what a comparison by factor leaves out."""
        return level_notes(self.content) if self.content.factors else []


class ChangedSetError(ConflictError):
    """Somebody else has changed a set since its editor saw it; `now`: as it is."""

    def __init__(self, now: KnownSet) -> None:
        super().__init__(f"Nothing was changed: somebody else has changed {now.title} meanwhile. Look at it again.")
        self.now = now


def known_sets(settings: Settings, connection: Transaction) -> list[KnownSet]:
    """Return the stimulus sets that can be read: those in the server's folder, then those of its studies elsewhere."""
    known = {
        folder.resolve(): KnownSet(folder.name, content, is_here=True)
        for folder in _folders_here(settings)
        if (content := _content(folder)) is not None
    }
    for study in all_studies(connection)[::-1]:
        folder = Path(study.set_folder) if study.set_folder else None
        if folder is not None and folder not in known and (content := _content(folder)) is not None:
            taken = {known_set.name for known_set in known.values()}
            name = slugify(content.name) if any(map(str.isalnum, content.name)) else "set"
            name = name if name not in taken else f"{name}-{content.sha256[:8]}"
            known[folder] = KnownSet(name, content, is_here=False)
    return list(known.values())


def unreadable_sets(settings: Settings, connection: Transaction, known: Sequence[KnownSet]) -> dict[str, str]:
    """Return why folders among the server's stimulus sets cannot be used, by name; what a job still makes is none.

    Parameters
    ----------
    known : the sets that can be read, which are not read again
    """
    reasons: dict[str, str] = {}
    passed = {each.name for each in known if each.is_here}
    passed |= {place.removeprefix(f"{SETS}/") for job in list_jobs(connection, states=OPEN) for place in uses(job)}
    for folder in _folders_here(settings):
        if folder.name in passed:
            continue
        try:
            read_manifest(folder)
        except StimuliError as error:
            reasons[folder.name] = said_on_page(error).replace(f"{folder}/", "")
    return reasons


def _folders_here(settings: Settings) -> Iterator[Path]:
    """Yield the folders in that of the server's stimulus sets by name, but hidden ones."""
    for folder in sorted(settings.sets_dir.iterdir()) if settings.sets_dir.is_dir() else ():
        if folder.is_dir() and not folder.name.startswith("."):
            yield folder


def set_called(settings: Settings, connection: Transaction, name: str) -> KnownSet:
    """Return a known set by its name in addresses, which never becomes a path.

    Raises
    ------
    NotFoundError
        If no set has this name.
    """
    for known in known_sets(settings, connection):
        if known.name == name:
            return known
    raise NotFoundError("There is no stimulus set of this name on the server.")


def set_of_study(settings: Settings, connection: Transaction, study: Study) -> KnownSet | None:
    """Return the set that a study was made of; None where it is not on this server any more, or has changed."""
    known = known_sets(settings, connection)
    return next((each for each in known if each.content.sha256 == study.manifest_sha256), None)


def studies_of(connection: Transaction, known: KnownSet) -> list[Study]:
    """Return the studies that were made of a set."""
    return [study for study in all_studies(connection) if study.manifest_sha256 == known.content.sha256]


def change_stimulus_set(
    settings: Settings,
    database: Database,
    name: str,
    actor: Actor,
    *,
    title: str | None = None,
    levels: Mapping[str, Mapping[str, str]] | None = None,
    seen: str = "",
) -> None:
    """Give a set another name, its address stays; give its conditions their levels of factors, in its studies, too.

    Parameters
    ----------
    settings, database : of the server
    name : the set's, in addresses
    actor : who changes it
    title : the new name; None: it stays
    levels : level by factor, by condition; a condition without a level is left out where factors are compared; None:
        they stay
    seen : digest of the set as its editor saw it; empty: not known

    Raises
    ------
    ChangedSetError
        If it has changed since.
    InvalidError
        If the name is empty, too long or that of another set, the conditions are others than the set's, or a factor or
        level has an unusable name. Then nothing is changed.
    """
    with database.writing() as connection:
        known = set_called(settings, connection, name)
        if seen not in ("", known.content.sha256):
            raise ChangedSetError(known)
        manifest = read_json(known.folder / MANIFEST)
        if title is not None:
            title = title.strip()
            _check_title(title, {each.title for each in known_sets(settings, connection) if each.name != name})
            manifest["name"] = title
        if levels is not None:
            _check_levels(known.conditions, levels)
            factors = _factors(known.content.factors, [levels[condition] for condition in known.conditions])
            stimuli = [{**entry, "levels": dict(levels[entry["approach"]])} for entry in manifest["stimuli"]]
            manifest |= {"stimuli": stimuli, "factors": factors}
        _rewrite(connection, known, manifest)
        if title is not None:
            actor.note(connection, "stimulus set renamed", None, known.name, before=known.title, after=title)
        if levels is not None:
            changed = [
                f"{condition}: {_in_words(known.levels[condition])} → {_in_words(levels[condition])}"
                for condition in known.conditions
                if dict(levels[condition]) != known.levels[condition]
            ]
            actor.note(connection, "factors changed", None, known.name, levels=changed, factors=list(factors))


def _check_title(title: str, others: Set[str]) -> None:
    if not 1 <= len(title) <= 200 or title in others:
        reason = "another set has it" if title in others else "expected 1 to 200 characters"
        raise InvalidError(f"Nothing was changed: the name is {title[:40]!r}; {reason}.")


def _in_words(levels: Mapping[str, str]) -> str:
    return " ".join(f"{factor}={level}" for factor, level in levels.items()) or "none"


def delete_set(settings: Settings, database: Database, name: str, again: str, actor: Actor) -> None:
    """Delete a set and its films, unless a study was made of it.

    Parameters
    ----------
    settings, database : of the server
    name : the set's, in addresses
    again : its title, typed again to confirm
    actor : who deletes it

    Raises
    ------
    ConflictError
        If a study was made of it, it lies outside the server's folder of stimulus sets, or a job works on it.
    InvalidError
        If the title is not typed right.
    """
    with database.writing() as connection:
        known = set_called(settings, connection, name)
        if users := studies_of(connection, known):
            names = ", ".join(study.name for study in users)
            raise ConflictError(f"{known.title} is not deleted: these studies were made of it: {names}.")
        if not known.is_here:
            raise ConflictError(f"{known.title} is not deleted: it lies in {known.folder}, which is not the server's.")
        refuse_while_used(connection, f"{SETS}/{known.name}")
        if again.strip() != known.title:
            raise InvalidError(f"Nothing was deleted: type {known.title!r} to delete this set, found {again[:40]!r}.")
        actor.note(connection, "stimulus set deleted", None, known.name, title=known.title)
        dying = settings.sets_dir / f".{known.folder.name}.{secrets.token_hex(4)}.deleted"
        known.folder.rename(dying)  # at once; it is not listed any more
    shutil.rmtree(dying, ignore_errors=True)


def _content(folder: Path) -> StimulusSet | None:
    try:
        return read_manifest(folder) if folder.is_dir() else None
    except StimuliError:
        return None


def _check_levels(conditions: Sequence[str], levels: Mapping[str, Mapping[str, str]]) -> None:
    if set(levels) != set(conditions):
        raise InvalidError("Nothing was changed: the conditions are not those of the set; load the page again.")
    factors = list(dict.fromkeys(factor for by_factor in levels.values() for factor in by_factor))
    if len(factors) > MOST_FACTORS:
        raise InvalidError(f"Nothing was changed: {len(factors)} factors, expected at most {MOST_FACTORS}.")
    for text in [*factors, *(level for by_factor in levels.values() for level in by_factor.values())]:
        if not 1 <= len(text) <= LONGEST_LEVEL or text == TOGETHER:
            raise InvalidError(
                f"Nothing was changed: {text[:40]!r} is no name of a factor or level; expected 1 to {LONGEST_LEVEL} "
                f"characters, and not {TOGETHER!r}, as results call all of them together."
            )


def _factors(before: Mapping[str, Sequence[str]], levels: Sequence[Mapping[str, str]]) -> dict[str, list[str]]:
    """Return the levels of each factor: in the order that they had before, then as they come."""
    factors: dict[str, list[str]] = {}
    for factor in dict.fromkeys(factor for by_factor in levels for factor in by_factor):
        used = list(dict.fromkeys(by_factor[factor] for by_factor in levels if factor in by_factor))
        known = [level for level in before.get(factor, ()) if level in used]
        factors[factor] = known + [level for level in used if level not in known]
    return factors


def _rewrite(connection: Transaction, known: KnownSet, manifest: Mapping[str, Any]) -> None:
    """Write a changed manifest, and let the set's studies follow; all of it or nothing."""
    users = studies_of(connection, known)
    with whole_file(known.folder / MANIFEST) as file:
        file.write_text(json.dumps(manifest, indent=2, allow_nan=False) + "\n", encoding="utf-8")
        changed = read_manifest(file, known.folder / MANIFEST)
        for study in users:
            practice = parse_options(study.options).practice_dataset
            shown = changed.without_dataset(practice) if practice else changed
            edit_set(connection, study.id, changed.sha256, shown.factors)
            change_levels(connection, study.id, {each.approach: each.levels for each in shown.stimuli})
