"""Create studies: from a stimulus set, from a study file, or as a copy of another study."""

from __future__ import annotations

import hashlib
import re
import secrets
import unicodedata
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from app.ffmpeg import Progress, no_progress
from app.files import file_digest, is_reserved
from app.intake.reports import SIZES_FROM, Measure, model_sizes
from app.intake.stimuli import MANIFEST, StimulusSet, read_manifest
from app.operations.database import open_store
from app.operations.studies.check_films import MOST_PLAYED_AT_ONCE, check_films, films_of, in_words
from app.operations.studies.languages import read_languages
from app.operations.studies.play_films import find_browser
from app.operations.studies.prepare import prepare_study, prepared_columns
from app.settings import Settings
from app.store.database.engine import Database
from app.store.database.keys import utc_now
from app.store.participants.invitations import insert_invitation
from app.store.studies import studies
from app.store.studies.audit import COMMAND_LINE, Actor, Entry, record
from app.store.studies.images import copy_images
from app.store.studies.measurements import measurement_records, replace_measurements
from app.store.trials.designs import copy_design, insert_design, insert_practice
from app.store.trials.orders import most_trials
from app.study.kinds import QUICK
from app.study.languages.text import is_one_line
from app.study.option_fields import SettingError
from app.study.options.neutral_words import neutral_words
from app.study.options.options import StudyOptions, parse_options
from app.study.options.own_texts import LONGEST_NAME
from app.study.options.platforms import link_path
from app.study.options.presets import read_preset
from app.study.options.study_file import StudyFile, parse_study_file, read_toml
from app.study.options.wording import beyond_the_study, check_languages, refused_languages

LONGEST_SLUG = 48
RESERVED = ("new",)  # the page that creates a study has this place among the studies
LATIN = {"æ": "ae", "œ": "oe", "ø": "o", "đ": "d", "ð": "d", "ħ": "h", "ı": "i", "ł": "l", "ŋ": "ng", "þ": "th"}


def create_study(
    settings: Settings,
    manifest_path: Path,
    name: str,
    *,
    exposure_s: float | None = None,
    seed: int | None = None,
    options: StudyOptions | None = None,
    progress: Progress = no_progress,
    by: str = COMMAND_LINE,
    is_paused: bool = False,
) -> dict[str, Any]:
    """Create a study of a stimulus set: check it, prepare the pair videos, store the design and an open invitation.

    Parameters
    ----------
    manifest_path : the stimulus set's folder or manifest
    name : shown to participants and experimenters
    exposure_s : how long a pair is shown; None: as long as the shortest video
    seed : of all orders; None: drawn at random
    options : everything besides the votes; None: the shortest study
    by : the creator's name, for the audit log
    is_paused : admit nobody before an experimenter opens it

    Raises
    ------
    ValueError
        If a study has this name, is complete in no language, or a number is out of bounds; StimuliError if the
        stimulus set cannot be used.
    """
    wanted, chosen_seed = options or StudyOptions(), _seed(seed)
    with open_store(settings) as database:
        slug = new_slug(database, name)
        packs = read_languages(settings)
        if shows_anything(read_manifest(manifest_path)):
            wanted = neutral_words(wanted)
        check_languages(wanted, packs)
        made = prepare_study(settings, manifest_path, wanted, exposure_s, progress)
        telling = telling_names(name, made.shown.conditions)
        notes = [
            *made.notes,
            *filter(None, [telling and f"{telling}: its page Settings changes both", beyond_the_study(wanted)]),
        ]
        now = utc_now()
        row = {"slug": slug, "name": name.strip(), "state": "open", "seed": chosen_seed, "created_at": now}
        row |= {"paused_at": now if is_paused else None, **prepared_columns(made)}
        with database.writing() as connection:
            study_id = studies.insert_study(connection, row)
            insert_design(connection, study_id, made.shown, made.pairs)
            insert_practice(connection, study_id, made.practice)
            replace_measurements(connection, study_id, model_sizes(made.shown), now)
            code = insert_invitation(connection, study_id, None, now)
            detail = {"stimulus_set": made.set_name, "seed": chosen_seed, **_noted(notes)}
            record(connection, by, Entry("study created", study_id, slug, detail), now)
        with database.reading() as connection:
            counts = studies.progress_of(connection, study_id)
            study = studies.study_by_id(connection, study_id)
            assert study is not None, "it was just inserted"
            n_trials = most_trials(connection, study)
            films = films_of(connection, study)
        if find_browser(settings.check_browser):  # before anybody is invited
            check = check_films(settings, study, films, now, most_played=MOST_PLAYED_AT_ONCE, progress=progress)
            notes.append(in_words(check).removesuffix("."))
    return {
        "languages": {tag: refusal or "offered" for tag, refusal in refused_languages(wanted, packs).items()},
        "invitation": code,
        "path": f"/s/{code}",
        "link": link_path(code, wanted.outside),
        **{key: row[key] for key in ("slug", "name", "exposure_s", "seed")},
        "protocol": wanted.protocol,
        "n_trials": n_trials,
        **{key: getattr(counts, key) for key in ("n_datasets", "n_conditions", "n_pairs")},
        "without": list(wanted.without),
        **_noted(notes),
    }


def import_study(
    settings: Settings, path: Path, *, stimuli: Path | None = None, progress: Progress = no_progress
) -> dict[str, Any]:
    """Create a study from a study file.

    Parameters
    ----------
    path : the study file
    stimuli : the stimulus set's folder; None: the one that the file names

    Raises
    ------
    ValueError
        If the file is not readable or not as described, or its stimulus set is another one; else as `create_study`.
    """
    text = _read_toml(path, "a study file, as `reconstudy study export` writes it")
    try:
        study = parse_study_file(text)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    if stimuli is None and study.stimuli is None:
        raise ValueError(f'{path}: names no stimuli; add stimuli = "FOLDER", or name the folder by --stimuli')
    folder = stimuli or path.parent / str(study.stimuli)
    manifest = folder / MANIFEST if folder.is_dir() else folder
    if study.manifest_sha256 and manifest.is_file() and file_digest(manifest) != study.manifest_sha256:
        raise ValueError(
            f"{manifest}: its SHA-256 is {file_digest(manifest)}, {path} expects {study.manifest_sha256}: "
            "this is another stimulus set"
        )
    return create_study(
        settings,
        folder,
        study.name,
        exposure_s=study.exposure_s,
        seed=study.seed,
        options=study.options,
        progress=progress,
    )


def duplicate_study(database: Database, original: studies.Study, name: str, actor: Actor) -> str:
    """Create a study with another study's stimuli, pairs and options; it stays paused until opened. Return its slug.

    Raises
    ------
    ValueError
        If a study has this name.
    """
    slug = new_slug(database, name)
    kept = ("exposure_s", "factors", "options", "manifest_sha256", "set_folder")
    row = {key: getattr(original, key) for key in kept}
    changes = {"slug": slug, "name": name.strip(), "state": "open", "seed": secrets.randbits(63)}
    with database.writing() as connection:
        study_id = studies.insert_study(connection, {**row, **changes, "created_at": actor.now, "paused_at": actor.now})
        copy_design(connection, original.id, study_id)
        copy_images(connection, original.id, study_id)
        sizes = [row for row in measurement_records(connection, original.id) if row["source"] == SIZES_FROM]
        replace_measurements(connection, study_id, [Measure.model_validate(row) for row in sizes], actor.now)
        insert_invitation(connection, study_id, None, actor.now)
        record(
            connection, actor.name, Entry("study created", study_id, slug, {"duplicate_of": original.slug}), actor.now
        )
    return slug


def read_options(path: Path | None, given: Mapping[str, Any], preset: str = QUICK) -> StudyOptions:
    """Read a study's options: those given directly override those of a TOML file, and these a preset's.

    Parameters
    ----------
    path : of the TOML file; None: there is none
    given : options by name
    preset : of PRESETS

    Raises
    ------
    ValueError
        If there is no such preset, or the file is not readable or not as described: names it and its fault.
    """
    chosen = read_preset(preset)
    if path is None:
        return parse_options(chosen.overridden_by(given))
    text = _read_toml(path, "a TOML file of a study's options")
    try:
        in_file = read_toml(text)
        if StudyFile.model_fields.keys() & set(in_file):
            raise ValueError(
                "is a study file; make its study by `reconstudy study import FILE --stimuli SET`, or give --options a "
                "file of what its table options holds"
            )
        return parse_options(chosen.overridden_by({**in_file, **given}))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def slugify(name: str) -> str:
    """Return a study's name as it appears in addresses: in Latin letters without accents.

    Names that lose letters of another script end in a digest, so that different names have different addresses.

    Raises
    ------
    ValueError
        If the name is too long, has no letter or digit, or several lines.
    """
    if not any(map(str.isalnum, name)) or len(name) > LONGEST_NAME or not is_one_line(name.strip()):
        raise SettingError(
            "name",
            f"expected a name of 1 to {LONGEST_NAME} characters in one line, with a letter or digit",
            f"{name!r:.240}:",
        )
    letters = "".join(LATIN.get(letter, letter) for letter in unicodedata.normalize("NFKD", name.casefold()))
    plain = letters.encode("ascii", "ignore").decode()
    slug = re.sub(r"[^a-z0-9]+", "-", plain).strip("-")[:LONGEST_SLUG].strip("-")
    if (
        slug not in RESERVED
        and not is_reserved(slug)
        and all(letter.isascii() for letter in letters if letter.isalnum())
    ):
        return slug
    return f"{slug or 'name'}-{hashlib.sha256(name.strip().encode()).hexdigest()[:8]}"


def new_slug(database: Database, name: str) -> str:
    """Return the slug of a study that is to be created.

    Raises
    ------
    ValueError
        If the name cannot be used, or a study has it.
    """
    slug = slugify(name)
    with database.reading() as connection:
        is_taken = studies.slug_exists(connection, slug)
    if is_taken:
        raise SettingError(
            "name", f"{slug!r} (from the name {name!r}); choose another name", "there is already a study"
        )
    return slug


def _read_toml(path: Path, expected: str) -> str:
    if not path.is_file():
        problem = "is a folder" if path.is_dir() else "there is no such file"
        raise ValueError(f"{path}: {problem}; expected {expected}")
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: is no text in UTF-8; expected {expected}") from error


def shows_anything(stimulus_set: StimulusSet) -> bool:
    """Is a set of films of anything, of which nobody knows whether they show models?"""
    return not any(stimulus.renderer for stimulus in stimulus_set.stimuli)


def _noted(notes: Sequence[str]) -> dict[str, list[str]]:
    return {"notes": list(notes)} if notes else {}


def telling_names(name: str, conditions: Sequence[str]) -> str:
    """Return a sentence if a study's name, which participants see, holds that of a condition; else nothing."""
    words = [each for each in conditions if re.search(rf"(?<!\w){re.escape(each)}(?!\w)", name, re.IGNORECASE)]
    if not words:
        return ""
    return (
        f"the name {name.strip()!r} holds {', '.join(words)}, and participants see it, also in the study's address; "
        "choose a name that tells nothing of what is compared"
    )


def _seed(wanted: int | None) -> int:
    if wanted is not None and not 0 <= wanted < 2**63:
        raise ValueError(f"seed {wanted}: expected a whole number from 0 to 2^63 - 1")
    return secrets.randbits(63) if wanted is None else wanted
