"""Edit a study, by a form, a file or a program: every setting takes effect, or is refused with the reason.

Which setting may change when stands in `CHANGES`. Some need the study's films made again; that takes minutes, so it is
a step of its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.errors import ConflictError, InvalidError, said_on_page
from app.ffmpeg import Progress
from app.operations.studies.check_films import check_films, damage_of, films_of
from app.operations.studies.manage import study_file_of
from app.operations.studies.prepare import prepare_study, prepared_columns
from app.operations.studies.stimulus_sets import set_of_study
from app.operations.tasks import start_task
from app.settings import Settings
from app.store.database.engine import Database, Transaction
from app.store.database.keys import utc_now
from app.store.participants.recruits import renew_codes
from app.store.studies.audit import Actor
from app.store.studies.images import image_digests, keep_image, remove_image
from app.store.studies.studies import Study, edit_study, lock_study, progress_of
from app.store.trials.deletion import delete_previews
from app.store.trials.designs import (
    ShownFilm,
    conditions_of,
    datasets_of,
    practice_pairs,
    replace_design,
    stimulus_records,
)
from app.study.design.adaptive import check_adaptive
from app.study.design.groups import check_groups
from app.study.languages.language_pack import LanguagePack, reviewed_languages
from app.study.languages.text import is_one_line
from app.study.option_fields import WITH_FILMS, SettingError
from app.study.options.neutral_words import neutral_words
from app.study.options.option_table import CHANGES, SETTINGS_BY_NAME, why_fixed
from app.study.options.options import check_minimum_viewing, parse_options, without_effect
from app.study.options.own_texts import LONGEST_NAME
from app.study.options.privacy import check_days_left, forgets_at
from app.study.options.study_file import StudyFile
from app.study.options.wording import check_languages
from app.study.stages import PRACTICE
from app.study.trial.image import MOST_IMAGES, check_image

LONGEST_NOTE = 200  # characters of a value in the audit log


@dataclass(frozen=True)
class Edit:
    """A change of a study that may be made.

    Parameters
    ----------
    study : as its editor saw it
    wanted : all settings as they are to be
    changes : the new values by name
    folder : of the stimulus set of which the films are made again; None: they stay as they are
    """

    study: Study
    wanted: StudyFile
    changes: Mapping[str, Any]
    folder: Path | None


def check_edit(
    settings: Settings,
    database: Database,
    study: Study,
    wanted: StudyFile,
    packs: Mapping[str, LanguagePack],
) -> Edit:
    """Check that a study may be changed as wanted; what the file leaves out besides options stays.

    Parameters
    ----------
    settings, database : of the server
    study : as it is
    wanted : as it is to be
    packs : the server's languages

    Raises
    ------
    InvalidError
        If a value is out of bounds, has no effect, or the study would be complete in no language.
    ConflictError
        If a setting cannot change any more, or the films cannot be made again.
    """
    now = study_file_of(study)
    with database.reading() as connection:
        try:
            wanted = _worded(connection, study, now, _complete(now, wanted))
            changes = _changes(now, wanted)
            check_languages(wanted.options, packs)
            if forgets_at(wanted.options, study.closed_at) != forgets_at(now.options, study.closed_at):
                check_days_left(wanted.options, study.closed_at, utc_now())
            for name, refusal in without_effect(wanted.options).items():
                if name in changes or "protocol" in changes:
                    raise refusal
            needs_films = _needs_films(connection, study, wanted, changes)
            if not needs_films:
                if wanted.options.adaptive_pairs:
                    check_adaptive(wanted.options.adaptive_pairs, len(conditions_of(connection, study.id)))
                check_groups(wanted.options.groups, datasets_of(connection, study.id))
        except ValueError as error:
            raise InvalidError(f"Nothing was changed: {error}.") from error
        known = set_of_study(settings, connection, study) if needs_films else None
        has_begun = progress_of(connection, study.id).n_started > 0
    for name in changes:
        change = WITH_FILMS if name in needs_films else CHANGES[name]
        if reason := why_fixed(change, has_begun=has_begun, has_stimuli=known is not None or not needs_films):
            raise ConflictError(f"Nothing was changed: {_called(name)} cannot change, because {reason}.")
    return Edit(study, wanted, changes, known.folder if known else None)


def _worded(connection: Transaction, study: Study, now: StudyFile, wanted: StudyFile) -> StudyFile:
    """Give languages that are added to a study of imported films the neutral words that it got when it was made."""
    before = {*(now.options.languages or reviewed_languages()), *now.options.texts}
    added = [tag for tag in wanted.options.languages if tag not in before]
    if not added or any(row["renderer"] for row in stimulus_records(connection, study.id)):
        return wanted
    return wanted.but(options=neutral_words(wanted.options, added))


def save_edit(database: Database, edit: Edit, revision: int, actor: Actor) -> None:
    """Save a change that needs no other films.

    Parameters
    ----------
    database : of the server
    edit : as `check_edit` returned it
    revision : of the study, as its editor saw it
    actor : who changes it

    Raises
    ------
    ConflictError
        If somebody else has changed the study meanwhile, or a participant has begun.
    """
    wanted = edit.wanted
    with database.writing() as connection:
        _lock_unless_begun(connection, edit)
        values: dict[str, Any] = {"name": wanted.name, "exposure_s": wanted.exposure_s, "seed": wanted.seed}
        edit_study(connection, edit.study.id, revision, {**values, "options": wanted.options.as_json()})
        if "outside" in edit.changes:
            renew_codes(connection, edit.study.id, wanted.options.outside)
        actor.note(connection, "study edited", edit.study, edit.study.slug, **edit.changes)


def remake_films(
    settings: Settings, database: Database, edit: Edit, revision: int, actor: Actor, progress: Progress
) -> None:
    """Save a change that needs other films, once they are made; films that are there are not made again.

    Parameters
    ----------
    settings, database : of the server
    edit : as `check_edit` returned it, with a folder
    revision : of the study, as its editor saw it
    actor : who changes it
    progress : called after each video

    Raises
    ------
    InvalidError
        If an option does not fit the stimulus set, or the set cannot be used.
    ConflictError
        If somebody else has changed the study meanwhile, or a participant has begun.
    """
    assert edit.folder is not None, "the films are to be made again"
    wanted, study = edit.wanted, edit.study
    try:
        made = prepare_study(settings, edit.folder, wanted.options, wanted.exposure_s, progress)
    except ValueError as error:
        raise InvalidError(f"Nothing was changed: {said_on_page(error).rstrip('.')}.") from error
    with database.writing() as connection:
        _lock_unless_begun(connection, edit)
        edit_study(connection, study.id, revision, {"name": wanted.name, "seed": wanted.seed, **prepared_columns(made)})
        delete_previews(connection, study.id)
        replace_design(connection, study.id, made.shown, made.pairs, made.practice)
        notes = {"notes": list(made.notes)} if made.notes else {}
        actor.note(connection, "study edited", study, study.slug, **edit.changes, films="made again", **notes)


def start_mending(settings: Settings, database: Database, study: Study, actor: Actor) -> str:
    """Begin to make a study's damaged films again and to check all of them; return the task's id."""

    def work(progress: Progress) -> str:
        mended = mend_films(settings, database, study, progress)
        with database.writing() as connection:
            actor.note(connection, "damaged films made again", study, study.slug, films=len(mended))
            films = films_of(connection, study)
        check_films(settings, study, films, actor.now, progress=progress)
        return f"/admin/studies/{study.slug}/stimuli"

    return start_task(database, actor, f"Making films of {study.name} again", work, subject=f"films of {study.slug}")


def mend_films(settings: Settings, database: Database, study: Study, progress: Progress) -> list[ShownFilm]:
    """Make the films again whose files are missing or changed, exactly as they were; return them.

    Raises
    ------
    InvalidError
        If no file is damaged, the set cannot be used, or a film comes out otherwise than when the study was made.
    ConflictError
        If the stimulus set is not there any more.
    """
    with database.reading() as connection:
        films, known = films_of(connection, study), set_of_study(settings, connection, study)
    damaged = [film for film in films if damage_of(settings, film)]
    if not damaged:
        raise InvalidError("The films are as they were when the study was made; made again, they would be the same.")
    if known is None:
        raise ConflictError("The study's stimulus set is not on this server any more, or has changed: upload it again.")
    for film in damaged:
        (settings.media_dir / film.file).unlink(missing_ok=True)  # else they would be taken for whole by their names
    try:
        prepare_study(settings, known.folder, parse_options(study.options), study.exposure_s, progress)
    except ValueError as error:
        raise InvalidError(f"The films could not be made again: {said_on_page(error).rstrip('.')}.") from error
    if n := sum(bool(damage_of(settings, film)) for film in damaged):
        raise InvalidError(
            f"Films that came out otherwise than when the study was made: {n}, as this server encodes otherwise now. "
            "Bring the files back from a backup, or duplicate the study."
        )
    return damaged


def _complete(now: StudyFile, wanted: StudyFile) -> StudyFile:
    """Fill what a file leaves out with the present settings; the stimulus set cannot change.

    Raises
    ------
    ValueError
        If the stimulus set changes, or a value is out of bounds.
    """
    if wanted.stimuli is not None or wanted.manifest_sha256 not in (None, now.manifest_sha256):
        raise ValueError("the stimuli of a study do not change; create a new study of the other stimulus set")
    exposure_s = float(now.exposure_s or 0) if wanted.exposure_s is None else float(wanted.exposure_s)
    check_minimum_viewing(wanted.options, exposure_s)
    name = wanted.name.strip()
    if not 1 <= len(name) <= LONGEST_NAME or not is_one_line(name):
        raise SettingError("name", f"is {name!r:.240}, expected 1 to {LONGEST_NAME} characters in one line")
    seed = now.seed if wanted.seed is None else wanted.seed
    before, options = now.options, wanted.options
    if options.practice_dataset != before.practice_dataset and options.practice_pairs == before.practice_pairs:
        options = options.but(practice_pairs=())  # they were chosen for the other dataset
    return now.but(name=name, stimuli=None, exposure_s=exposure_s, seed=seed, options=options)


def _needs_films(
    connection: Transaction, study: Study, wanted: StudyFile, changes: Mapping[str, Any]
) -> frozenset[str]:
    """Return the changed settings for which films are made again."""
    needed = {name for name in changes if CHANGES[name] == WITH_FILMS}
    if PRACTICE in wanted.options.way and not practice_pairs(connection, study.id):
        needed.add("optional_stages")
    return frozenset(needed & changes.keys())


def _lock_unless_begun(connection: Transaction, edit: Edit) -> None:
    lock_study(connection, edit.study.id)  # nobody begins between the check and the change
    if progress_of(connection, edit.study.id).n_started:
        for name in edit.changes:
            if reason := why_fixed(CHANGES[name], has_begun=True, has_stimuli=True):
                raise ConflictError(f"Nothing was changed: {_called(name)} cannot change, because {reason}.")


def _called(name: str) -> str:
    """Return what forms call a setting, with its name in files; the name alone where it is a table of several."""
    return f"{SETTINGS_BY_NAME[name].label} ({name})" if name in SETTINGS_BY_NAME else name


def _changes(before: StudyFile, after: StudyFile) -> dict[str, Any]:
    """Return the changed settings with their new values; long texts by their length, a platform's codes not at all."""
    old, new = _flat(before), _flat(after)
    shown = new | {"outside": after.options.outside.without_codes.as_json()}
    return {key: _short(shown[key]) for key, value in new.items() if value != old[key]}


def _short(value: Any) -> Any:
    return value if len(str(value)) <= LONGEST_NOTE else f"{len(str(value))} characters"


def _flat(study: StudyFile) -> dict[str, Any]:
    return {"name": study.name, "exposure_s": study.exposure_s, "seed": study.seed, **study.options.as_json()}


def keep_study_image(database: Database, study: Study, name: str, content: bytes, actor: Actor) -> None:
    """Keep an image for a study's texts to show, in place of one of the same name.

    Raises
    ------
    InvalidError
        If it is no image that browsers show, or one too many.
    ConflictError
        If participants have begun.
    """
    try:
        check_image(name, content)
    except ValueError as error:
        raise InvalidError(f"The image was not kept: {error}.") from error
    with database.writing() as connection:
        _refuse_once_begun(connection, study)
        if len({*image_digests(connection, study.id), name}) > MOST_IMAGES:
            raise InvalidError(f"The image was not kept: a study has at most {MOST_IMAGES}.")
        keep_image(connection, study.id, name, content)
        actor.note(connection, "image kept", study, study.slug, image=name)


def remove_study_image(database: Database, study: Study, name: str, actor: Actor) -> None:
    """Remove an image of a study's texts; ConflictError if participants have begun."""
    with database.writing() as connection:
        _refuse_once_begun(connection, study)
        remove_image(connection, study.id, name)
        actor.note(connection, "image removed", study, study.slug, image=name)


def _refuse_once_begun(connection: Transaction, study: Study) -> None:
    lock_study(connection, study.id)  # nobody begins between the check and the change
    if progress_of(connection, study.id).n_started:
        raise ConflictError("Participants have begun, so images cannot change. Duplicate the study instead.")
