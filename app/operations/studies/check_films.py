"""Check a study's films: each is there, unchanged, decodes to its end in the size its player expects, and plays."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import datetime
from functools import partial
from math import isclose
from pathlib import Path
from typing import Any

from app.errors import StimuliError, StudyError, said_on_page
from app.ffmpeg import Progress, VideoFacts, decode, in_parallel, no_progress
from app.files import file_digest, read_json, write_json
from app.films.strips import H264, MEDIA_TYPES
from app.intake.stimuli import FPS_TOLERANCE
from app.operations.database import open_store, study_named
from app.operations.studies.play_films import PlayedFilm, browser_version, find_browser, play_films
from app.operations.tasks import start_task
from app.settings import Settings
from app.store.database.engine import Database, Transaction
from app.store.database.keys import utc_now
from app.store.studies.audit import Actor
from app.store.studies.film_failures import in_words as reason_in_words
from app.store.studies.studies import Study
from app.store.trials.designs import ShownFilm, shown_films
from app.study.options.options import parse_options

MOST_PLAYED_AT_ONCE = 60  # before the first invitation; `study check` plays all


@dataclass(frozen=True)
class FilmCheck:
    """What is known of a study's films.

    Parameters
    ----------
    checked_at : ISO 8601
    films : digest of what was checked
    n_films : files that were decoded
    n_played : those that a browser played to the end
    browser : that played them; empty: none is installed here
    faults : sentence by the film's opaque name
    """

    checked_at: str
    films: str
    n_films: int
    n_played: int = 0
    browser: str = ""
    faults: Mapping[str, str] = field(default_factory=dict)


def check_study(settings: Settings, slug: str, *, progress: Progress = no_progress) -> dict[str, Any]:
    """Check all films of a study, and play them where a browser is installed.

    Raises
    ------
    ValueError
        If there is no such study.
    """
    with open_store(settings) as database, database.reading() as connection:
        study = study_named(connection, slug)
        films = films_of(connection, study)
    return asdict(check_films(settings, study, films, utc_now(), progress=progress))


def films_of(connection: Transaction, study: Study) -> list[ShownFilm]:
    """Return every film that a study's participants may be shown, each file once."""
    options = parse_options(study.options)
    n_strips = 1 if options.is_shown_alone else 3 if options.reference_beside else 2
    return shown_films(connection, study.id, n_strips=n_strips, n_of_practice=min(n_strips, 2))


def check_films(
    settings: Settings,
    study: Study,
    films: Sequence[ShownFilm],
    now: datetime,
    *,
    most_played: int | None = None,
    progress: Progress = no_progress,
) -> FilmCheck:
    """Decode every film to its end, play some or all in a browser, and keep the result for the study's pages.

    Parameters
    ----------
    most_played : films that a browser plays, evenly among all; None: all
    """
    faults: dict[str, str] = {}

    def check(film: ShownFilm) -> None:
        if fault := _fault(settings, film):
            faults[film.media] = fault

    in_parallel([(f"decoding {film.name}", partial(check, film)) for film in films], progress)
    whole = [film for film in films if film.media not in faults]
    played = FilmCheck(now.isoformat(timespec="seconds"), films_digest(films), len(films), faults=faults)
    step = 1 if most_played is None else max(1, -(-len(whole) // most_played))
    played = _played(settings, whole[::step], played, progress)
    path = check_file(settings, study.slug)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_json(path, asdict(played))
    return played


def start_film_check(settings: Settings, database: Database, study: Study, actor: Actor) -> str:
    """Begin to check a study's films in the background; return the task's id."""

    def work(progress: Progress) -> str:
        with database.reading() as connection:
            films = films_of(connection, study)
        check = check_films(settings, study, films, actor.now, progress=progress)
        with database.writing() as connection:
            facts = {"files": check.n_films, "faults": len(check.faults), "played": check.n_played}
            actor.note(connection, "films checked", study, study.slug, **facts)
        return f"/admin/studies/{study.slug}/stimuli"

    title = f"Checking the films of {study.name}"
    return start_task(database, actor, title, work, subject=f"films of {study.slug}")


def check_file(settings: Settings, slug: str) -> Path:
    """Return where the last check of a study's films is kept."""
    return settings.data_dir / "checks" / f"{slug}.json"


def last_check(settings: Settings, study: Study, films: Sequence[ShownFilm]) -> FilmCheck | None:
    """Return the last check of these films; None: they were never checked, or are others now."""
    try:
        known = FilmCheck(**read_json(check_file(settings, study.slug)))
    except (ValueError, TypeError):
        return None
    return known if known.films == films_digest(films) else None


def damage_of(settings: Settings, film: ShownFilm) -> str:
    """Say why a film's file is not the one that was made; empty if it is."""
    path = settings.media_dir / film.file
    if not path.is_file():
        return "the file is missing"
    return "" if file_digest(path) == film.sha256 else "the file is not what it was when the study was made"


def films_digest(films: Sequence[ShownFilm]) -> str:
    """Return a digest of what films there are."""
    return hashlib.sha256(json.dumps(sorted(film.sha256 for film in films)).encode()).hexdigest()


def in_words(check: FilmCheck) -> str:
    """Say in a sentence how far a check went."""
    if check.faults:
        return f"Films that cannot be shown: {len(check.faults)} of {check.n_films}."
    whole = f"All {check.n_films} films were decoded to their last picture, in the size that their player expects"
    if not check.browser:
        return f"{whole}. They could not be played in a browser: none is installed here."
    n = "all" if check.n_played == check.n_films else f"{check.n_played} of them"
    return f"{whole}, and {n} were played to the end in {check.browser}."


def _fault(settings: Settings, film: ShownFilm) -> str:
    """Return what is wrong with a film's file; empty: nothing."""
    if damage := damage_of(settings, film):
        return damage
    path = settings.media_dir / film.file
    try:
        facts = decode(path)
    except StimuliError as error:
        return said_on_page(error).replace(f"{path}: ", "")
    fps = facts.fps if isclose(facts.fps, film.fps, rel_tol=FPS_TOLERANCE) else film.fps
    expected = VideoFacts(film.width, _height(film), fps, film.n_frames)
    return "" if facts == expected else f"it has {facts}, its player expects {expected}"


def _height(film: ShownFilm) -> int:
    """Return the height of all strips of a film, with what keeps them apart, pixels."""
    return film.n_strips * film.height + (film.n_strips - 1) * film.guard_rows


def _played(settings: Settings, films: Sequence[ShownFilm], known: FilmCheck, progress: Progress) -> FilmCheck:
    browser = find_browser(settings.check_browser)
    if browser is None or not films:
        return known
    shown = [
        PlayedFilm(
            settings.media_dir / film.file,
            "decoder" if film.is_single else "video",
            MEDIA_TYPES.get(film.codec, MEDIA_TYPES[H264]),
            film.width,
            _height(film),
            film.n_frames,
            film.fps,
        )
        for film in films
    ]
    try:
        faults = play_films(browser, shown, progress)
    except StudyError:
        return known
    bad = {film.media: reason_in_words(fault) for film, fault in zip(films, faults, strict=True) if fault}
    return replace(
        known,
        n_played=sum(not fault for fault in faults),
        browser=browser_version(browser),
        faults={**known.faults, **bad},
    )
