"""Create studies: from a stimulus set, from a study file, or as a copy of another study."""

from __future__ import annotations

import hashlib
import re
import secrets
import tomllib
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from app.errors import StimuliError
from app.ffmpeg import Progress, no_progress
from app.files import file_digest
from app.films.object_store import MediaStore
from app.films.pairs import (
    NO_REFERENCES,
    FilmMaker,
    PairVideo,
    prepare_against,
    prepare_alone,
    prepare_identical,
    prepare_pairs,
    prepare_practice,
    split_reference,
)
from app.films.practice import Practice, choose_practice, without_dataset
from app.intake.stimuli import MANIFEST, StimulusSet, read_stimulus_set
from app.operations.languages import read_languages
from app.operations.manage import opened_store
from app.settings import Settings
from app.store import studies
from app.store.audit import COMMAND_LINE, Actor, Entry, record
from app.store.designs import copy_design, insert_design, insert_practice
from app.store.engine import Database, Transaction
from app.store.images import copy_images
from app.store.invitations import insert_invitation
from app.store.keys import utc_now
from app.store.orders import pairs_to_show, study_plan
from app.study.adaptive import check_adaptive
from app.study.options import StudyOptions, check_minimum_viewing, parse_options
from app.study.presets import QUICK, read_preset
from app.study.protocols import DCR, WITH_REFERENCE
from app.study.stages import PRACTICE
from app.study.study_file import parse_study_file
from app.study.wording import LONGEST_NAME, check_languages, refused_languages

EXPOSURE_BOUNDS_S = (0.1, 3600.0)
LONGEST_SLUG = 48


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
    slug, wanted = slugify(name), options or StudyOptions()
    with opened_store(settings) as database:
        _refuse_second(database, slug, name)
        packs = read_languages(settings)
        check_languages(wanted, packs)
        stimulus_set = _left_out(read_stimulus_set(manifest_path, progress), wanted.without)
        practice = _practice(stimulus_set, wanted)
        exposure = _exposure(practice.compared, exposure_s)
        check_minimum_viewing(wanted, exposure)
        row = {
            "slug": slug,
            "name": name.strip(),
            "state": "open",
            "exposure_s": exposure,
            "seed": _seed(seed),
            "factors": practice.compared.factors,
            "options": replace(wanted, practice_pairs=practice.films).as_json(),
            "manifest_sha256": stimulus_set.sha256,
        }
        films = _prepare_films(settings, stimulus_set, practice, wanted, progress)
        row["created_at"] = created_at = utc_now()
        row["paused_at"] = created_at if is_paused else None
        with database.writing() as connection:
            study_id = studies.insert_study(connection, row)
            insert_design(connection, study_id, films.shown, films.pairs)
            insert_practice(connection, study_id, films.practice)
            code = insert_invitation(connection, study_id, None, created_at)
            detail = {"stimulus_set": stimulus_set.name, "seed": row["seed"]}
            entry = Entry("study created", study_id, slug, {**detail, **_noted(practice.notes)})
            record(connection, by, entry, created_at)
        with database.reading() as connection:
            counts = asdict(studies.progress_of(connection, study_id))
            n_trials = _n_trials(connection, study_id)
    return {
        "languages": {tag: refusal or "offered" for tag, refusal in refused_languages(wanted, packs).items()},
        "invitation": code,
        "path": f"/s/{code}",
        **{key: row[key] for key in ("slug", "name", "exposure_s", "seed")},
        "protocol": wanted.protocol,
        "n_trials": n_trials,
        **{key: counts[key] for key in counts if key.endswith(("datasets", "conditions", "pairs"))},
        "without": list(wanted.without),
        **_noted(practice.notes),
    }


def _n_trials(connection: Transaction, study_id: int) -> int:
    """Count the trials of a study's first participant."""
    study = studies.study_by_id(connection, study_id)
    assert study is not None, "it was just inserted"
    return len(study_plan(connection, study).order_of_slot(0, pairs_to_show(connection, study, 0)))


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
    try:
        study = parse_study_file(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
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
    slug = slugify(name)
    _refuse_second(database, slug, name)
    kept = ("exposure_s", "factors", "options", "manifest_sha256")
    row = {key: getattr(original, key) for key in kept}
    changes = {"slug": slug, "name": name.strip(), "state": "open", "seed": secrets.randbits(63)}
    with database.writing() as connection:
        study_id = studies.insert_study(connection, {**row, **changes, "created_at": actor.now, "paused_at": actor.now})
        copy_design(connection, original.id, study_id)
        copy_images(connection, original.id, study_id)
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
    try:
        in_file = tomllib.loads(path.read_text(encoding="utf-8"))
        return parse_options(chosen.overridden_by({**in_file, **given}))
    except (OSError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error


def slugify(name: str) -> str:
    """Return a study's name as it appears in addresses; a name in another script appears as a digest.

    Raises
    ------
    ValueError
        If the name is too long, or has no letter or digit.
    """
    if not any(map(str.isalnum, name)) or len(name) > LONGEST_NAME:
        raise ValueError(f"{name!r}: expected a name of 1 to {LONGEST_NAME} characters, with a letter or digit")
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode().lower()
    slug = re.sub(r"[^a-z0-9]+", "-", plain).strip("-")[:LONGEST_SLUG].strip("-")
    return slug or f"name-{hashlib.sha256(name.strip().encode()).hexdigest()[:8]}"


def _refuse_second(database: Database, slug: str, name: str) -> None:
    with database.reading() as connection:
        is_taken = studies.slug_exists(connection, slug)
    if is_taken:
        raise ValueError(f"there is already a study {slug!r} (from the name {name!r}); choose another name")


def _left_out(stimulus_set: StimulusSet, conditions: Sequence[str]) -> StimulusSet:
    """Return the set without conditions that a study neither shows nor compares.

    Raises
    ------
    StimuliError
        If the set has no such condition, or a dataset has one other stimulus, or none.
    """
    if unknown := [condition for condition in conditions if condition not in stimulus_set.conditions]:
        raise StimuliError(
            f"{unknown[0]!r} cannot be left out: it is none of the set's conditions, "
            f"{', '.join(stimulus_set.conditions)}"
        )
    kept = stimulus_set.without(*conditions)
    for dataset in stimulus_set.datasets:
        if (n := len(kept.of_dataset(dataset))) < 2:
            raise StimuliError(
                f"dataset {dataset} has {n} stimuli without {', '.join(conditions)}, expected at least two to compare"
            )
    return kept


@dataclass(frozen=True)
class _Films:
    """The stimuli that a study shows, and the films of its pairs and of the practice."""

    shown: StimulusSet
    pairs: Sequence[PairVideo]
    practice: Sequence[PairVideo]


def _practice(stimulus_set: StimulusSet, options: StudyOptions) -> Practice:
    """Choose what the study's participants practise with, and what is left to compare."""
    if PRACTICE in options.way:
        return choose_practice(stimulus_set, options.practice_dataset, options.practice_pairs, options.reference_beside)
    if options.practice_dataset:
        return Practice((), without_dataset(stimulus_set, options.practice_dataset))
    return Practice((), stimulus_set)


def _noted(notes: Sequence[str]) -> dict[str, list[str]]:
    return {"notes": list(notes)} if notes else {}


def _prepare_films(
    settings: Settings, stimulus_set: StimulusSet, practice: Practice, options: StudyOptions, progress: Progress
) -> _Films:
    """Make the missing films and upload them to the object store, if there is one."""
    compared, references = practice.compared, NO_REFERENCES
    if options.reference:
        fewest = 1 if options.protocol in WITH_REFERENCE else 2
        compared, references = split_reference(compared, options.reference, fewest)
    if options.adaptive_pairs:
        check_adaptive(options.adaptive_pairs, len(compared.conditions))
    maker = FilmMaker(settings.media_dir, options.second_codec, bool(options.fallback), progress)
    if options.is_shown_alone:
        pairs = prepare_alone(practice.compared, maker)
    elif options.protocol == DCR:
        pairs = prepare_against(compared, maker, references, has_identical=options.identical_pairs > 0)
    else:
        pairs = prepare_pairs(compared, maker, references)
        if options.identical_pairs:
            pairs += prepare_identical(compared, maker, references)
    practised = []
    if practice.pairs:
        practised = prepare_practice(stimulus_set, practice.pairs, maker, is_alone=options.is_shown_alone)
    if settings.media_url:
        files = [file for video in [*pairs, *practised] for file in video.files]
        MediaStore(settings.media_url).upload(settings.media_dir / file for file in files)
    shown = practice.compared if options.protocol in WITH_REFERENCE else compared
    return _Films(shown, pairs, practised)


def _exposure(stimulus_set: StimulusSet, wanted_s: float | None) -> float:
    """Return how long a pair is shown, s: the wanted time, or the length of the shortest video."""
    shortest_s = min(round(stimulus.n_frames / stimulus.fps, 3) for stimulus in stimulus_set.stimuli)
    exposure_s = float(shortest_s if wanted_s is None else wanted_s)
    low_s, high_s = EXPOSURE_BOUNDS_S
    if not low_s <= exposure_s <= high_s:
        raise ValueError(f"exposure {exposure_s} s: expected between {low_s} and {high_s}")
    return exposure_s


def _seed(wanted: int | None) -> int:
    if wanted is not None and not 0 <= wanted < 2**63:
        raise ValueError(f"seed {wanted}: expected a whole number from 0 to 2^63 - 1")
    return secrets.randbits(63) if wanted is None else wanted
