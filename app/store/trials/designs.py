"""Keep a study's design: its datasets, conditions, stimuli and pairs, which stay once somebody has begun."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from sqlalchemy import (
    Column,
    ColumnElement,
    Connection,
    Select,
    Table,
    delete,
    exists,
    func,
    insert,
    literal,
    select,
    true,
    union_all,
    update,
)

from app.films.pairs import FilmFile, PairVideo
from app.films.strips import H264, LIGHTER, SINGLE
from app.intake.stimuli import StimulusSet
from app.store.database.belonging import rows_of_study
from app.store.database.keys import new_opaque_id
from app.store.database.tables import (
    assignment,
    condition,
    dataset,
    lighter_film,
    measurement,
    model,
    pair,
    practice_pair,
    second_film,
    single_film,
    stimulus,
    trial,
)
from app.study.trial.trial import PlannedPair

FILM_FACTS = ("file", "sha256", "width", "height", "guard_rows", "fps", "n_frames")
STIMULUS_FACTS = ("sha256", "width", "height", "fps", "n_frames", "codec", "renderer")
OF_PRACTICE = "practice"  # what its films show, in words
STRIPS = ("top", "bottom", "reference")  # parts of a film, from the top
SECOND_FILM = "second"  # ends the address of a film in another codec
PAIRS = (pair, practice_pair)
OTHER_FILMS = (second_film, single_film, lighter_film)  # of a pair, besides its first


@dataclass(frozen=True, kw_only=True)
class PairFilm:
    """The film of a pair, as a participant may know it, and which others there are of it."""

    width: int
    height: int
    guard_rows: int
    fps: float
    n_frames: int
    second_codec: str | None
    has_singles: bool
    has_lighter: bool


@dataclass(frozen=True, kw_only=True)
class PracticePair(PairFilm):
    """A pair to practise with."""

    position: int
    media: str


@dataclass(frozen=True)
class ShownPair:
    """A pair's names."""

    dataset: str
    top: str
    bottom: str


_TOP, _BOTTOM = stimulus.alias("top"), stimulus.alias("bottom")
_TOP_CONDITION, _BOTTOM_CONDITION = condition.alias("top_condition"), condition.alias("bottom_condition")
PAIR_NAMES = (
    dataset.c.name.label("dataset"),
    _TOP_CONDITION.c.name.label("top"),
    _BOTTOM_CONDITION.c.name.label("bottom"),
)


def pair_film(table: Table) -> tuple[ColumnElement[Any], ...]:
    """Return the columns of `PairFilm`, for a query of `pair` or `practice_pair`."""
    second = select(second_film.c.codec).where(second_film.c.of_media == table.c.media)
    return (
        *(table.c[name] for name in ("width", "height", "guard_rows", "fps", "n_frames")),
        second.scalar_subquery().label("second_codec"),
        exists().where(single_film.c.of_media == table.c.media).label("has_singles"),
        exists().where(lighter_film.c.of_media == table.c.media).label("has_lighter"),
    )


def insert_design(connection: Connection, study_id: int, stimulus_set: StimulusSet, pairs: Sequence[PairVideo]) -> None:
    """Insert a study's datasets, conditions, stimuli and pairs; those of the same name that are there stay."""
    datasets = {
        name: _placed(connection, dataset, {"study_id": study_id, "name": name}, {"position": position})
        for position, name in enumerate(stimulus_set.datasets)
    }
    levels = {shown.approach: shown.levels for shown in stimulus_set.stimuli}
    conditions = {
        name: _placed(
            connection,
            condition,
            {"study_id": study_id, "name": name},
            {"position": position, "levels": levels[name]},
        )
        for position, name in enumerate(stimulus_set.conditions)
    }
    stimuli = {
        shown.name: _placed(
            connection,
            stimulus,
            {"dataset_id": datasets[shown.dataset], "condition_id": conditions[shown.approach]},
            shown.model_dump(include=set(STIMULUS_FACTS)),
        )
        for shown in stimulus_set.stimuli
    }
    for video in pairs:
        ids = {"top_id": stimuli[video.top.name], "bottom_id": stimuli[video.bottom.name]}
        place = {"dataset_id": datasets[video.top.dataset], **ids}
        _insert(connection, pair, {**place, **_film(connection, video)})


def replace_design(
    connection: Connection,
    study_id: int,
    stimulus_set: StimulusSet,
    pairs: Sequence[PairVideo],
    practice: Sequence[PairVideo],
) -> None:
    """Put other stimuli and pairs in the place of a study's, in which nobody has begun.

    Measures and models attached to what stays, stay.
    """
    of_study = select(dataset.c.id).where(dataset.c.study_id == study_id)
    for table, is_replaced in (
        (pair, pair.c.dataset_id.in_(of_study)),
        (practice_pair, practice_pair.c.study_id == study_id),
    ):
        films = list(connection.scalars(select(table.c.media).where(is_replaced)))
        for others in OTHER_FILMS:
            connection.execute(delete(others).where(others.c.of_media.in_(films)))
        connection.execute(delete(table).where(is_replaced))
    insert_design(connection, study_id, stimulus_set, pairs)
    insert_practice(connection, study_id, practice)
    shown = {(each.dataset, each.approach) for each in stimulus_set.stimuli}
    for key, place in stimulus_names(connection, study_id).items():
        if place not in shown:
            connection.execute(delete(stimulus).where(stimulus.c.id == key))
    for table, column, names in (
        (dataset, "dataset_id", stimulus_set.datasets),
        (condition, "condition_id", stimulus_set.conditions),
    ):
        absent = (table.c.study_id == study_id, table.c.name.not_in(names))
        gone = list(connection.scalars(select(table.c.id).where(*absent)))
        for attached in (measurement, model):
            connection.execute(delete(attached).where(attached.c[column].in_(gone)))
        connection.execute(delete(table).where(table.c.id.in_(gone)))


def insert_practice(connection: Connection, study_id: int, pairs: Sequence[PairVideo]) -> None:
    """Insert the pairs that participants practise with."""
    for position, video in enumerate(pairs):
        place = {"study_id": study_id, "position": position}
        _insert(connection, practice_pair, {**place, **_film(connection, video)})


def change_levels(connection: Connection, study_id: int, levels: Mapping[str, Mapping[str, str]]) -> None:
    """Give a study's conditions other levels of factors; `levels` are by condition and factor."""
    for row in connection.execute(
        select(condition.c.id, condition.c.name).where(condition.c.study_id == study_id)
    ).all():
        if row.name in levels:
            new = update(condition).where(condition.c.id == row.id).values(levels=dict(levels[row.name]))
            connection.execute(new)


def practice_pairs(connection: Connection, study_id: int) -> list[PracticePair]:
    """Return the pairs that participants practise with, in order."""
    rows = select(practice_pair.c.position, practice_pair.c.media, *pair_film(practice_pair))
    of_study = rows.where(practice_pair.c.study_id == study_id).order_by(practice_pair.c.position)
    return [PracticePair(**row._mapping) for row in connection.execute(of_study)]


def datasets_of(connection: Connection, study_id: int) -> list[str]:
    rows = select(dataset.c.name).where(dataset.c.study_id == study_id).order_by(dataset.c.position)
    return list(connection.scalars(rows))


def conditions_of(connection: Connection, study_id: int) -> dict[str, dict[str, str]]:
    """Return factor levels by the condition's name."""
    rows = select(condition.c.name, condition.c.levels).where(condition.c.study_id == study_id)
    return {row.name: row.levels for row in connection.execute(rows.order_by(condition.c.position))}


def planned_pairs(connection: Connection, study_id: int) -> list[PlannedPair]:
    """Return all pairs of a study, as its orders need them."""
    rows = connection.execute(
        select(pair.c.id, pair.c.dataset_id, pair.c.top_id, pair.c.bottom_id)
        .join(dataset)
        .where(dataset.c.study_id == study_id)
        .order_by(dataset.c.position, pair.c.id)
    )
    return [PlannedPair(row.id, row.dataset_id, row.top_id, row.bottom_id) for row in rows]


def stimulus_names(connection: Connection, study_id: int) -> dict[int, tuple[str, str]]:
    """Return the names of dataset and condition by the stimulus' id."""
    rows = connection.execute(
        select(stimulus.c.id, dataset.c.name, condition.c.name)
        .select_from(stimulus.join(dataset).join(condition, stimulus.c.condition_id == condition.c.id))
        .where(dataset.c.study_id == study_id)
    )
    return {key: (of_dataset, of_condition) for key, of_dataset, of_condition in rows}


def film_file(connection: Connection, address: str) -> FilmFile | None:
    """Find a film's file by its opaque address, `NAME` or `NAME.KIND`.

    The name is that of a trial, which no two sessions share and no two trials, of a practice pair, or of a pair. The
    kind is `second` for the film in another codec, `lighter` for that with fewer bytes, or a strip for its film alone.
    """
    name, _, kind = address.partition(".")
    of_trial = select(pair.c.media, pair.c.file, pair.c.sha256).select_from(trial.join(assignment).join(pair))
    named = [select(table.c.media, table.c.file, table.c.sha256).where(table.c.media == name) for table in PAIRS]
    shown = connection.execute(union_all(of_trial.where(trial.c.public_id == name), *named)).first()
    if shown is None or not kind:
        return FilmFile(H264, shown.file, shown.sha256) if shown and _has_both(connection, shown) else None
    if kind == SECOND_FILM:
        query = select(second_film).where(second_film.c.of_media == shown.media)
    elif kind == LIGHTER:
        query = select(lighter_film).where(lighter_film.c.of_media == shown.media)
    else:
        query = select(single_film).where(single_film.c.of_media == shown.media, single_film.c.strip == kind)
    row = connection.execute(query).one_or_none()
    return FilmFile(kind if kind in (SECOND_FILM, LIGHTER) else SINGLE, row.file, row.sha256) if row else None


def _has_both(connection: Connection, shown: Any) -> bool:
    """Is a pair's file one of both films, and not that of the upper one alone?"""
    alone = select(single_film.c.id).where(single_film.c.of_media == shown.media, single_film.c.file == shown.file)
    return connection.execute(alone).first() is None


def has_single_films(connection: Connection, study_id: int) -> bool:
    """Whether a study was made with films of each stimulus alone."""
    singles = single_film.join(pair, pair.c.media == single_film.c.of_media).join(dataset)
    of_study = select(single_film.c.id).select_from(singles).where(dataset.c.study_id == study_id)
    return connection.execute(of_study.limit(1)).first() is not None


def largest_film(connection: Connection, study_id: int) -> tuple[int, int]:
    """Return the largest width and the largest height of a study's films of one stimulus, pixels."""
    pairs = select(func.max(pair.c.width), func.max(pair.c.height)).join(dataset).where(dataset.c.study_id == study_id)
    width, height = connection.execute(pairs).one()
    return int(width), int(height)


def film_files(connection: Connection, study_id: int | None = None) -> dict[str, str]:
    """Return the SHA-256 of every film's file by its name in the media folder, of one study or of all."""
    return {
        row.file: row.sha256
        for table in (*PAIRS, *OTHER_FILMS)
        for row in connection.execute(select(table.c.file, table.c.sha256).where(_of_study(table, study_id)))
    }


def _of_study(table: Table, study_id: int | None) -> ColumnElement[bool]:
    belongs = None if study_id is None else rows_of_study(table, study_id)
    return true() if belongs is None else belongs


def _film(connection: Connection, video: PairVideo) -> dict[str, Any]:
    """Return the columns of a pair that describe its film; its other films get rows of their own."""
    media = new_opaque_id()
    if video.second:
        values = {"media": new_opaque_id(), "of_media": media, **asdict(video.second)}
        _insert(connection, second_film, values)
    if video.lighter:
        values = {"of_media": media, "file": video.lighter.file, "sha256": video.lighter.sha256}
        _insert(connection, lighter_film, values)
    for strip, film in zip(STRIPS, video.singles, strict=False):  # not every pair has a reference
        values = {"of_media": media, "strip": strip, "file": film.file, "sha256": film.sha256}
        _insert(connection, single_film, values)
    return {"media": media, **{name: getattr(video, name) for name in FILM_FACTS}}


def _placed(connection: Connection, table: Table, place: Mapping[str, Any], facts: Mapping[str, Any]) -> int:
    """Return the id of the row at a place, with these facts; it is inserted unless it is there."""
    is_there = [table.c[name] == value for name, value in place.items()]
    known = connection.scalar(update(table).where(*is_there).values(**facts).returning(table.c.id))
    return _insert(connection, table, {**place, **facts}) if known is None else int(known)


def _insert(connection: Connection, table: Table, values: Mapping[str, Any]) -> int:
    return int(connection.execute(insert(table).values(**values).returning(table.c.id)).scalar_one())


def stimulus_records(connection: Connection, study_id: int) -> list[dict[str, Any]]:
    """Return every stimulus with its facts, and a pair's video and half that show it."""
    rows = connection.execute(
        select(
            dataset.c.name.label("dataset"),
            condition.c.name.label("item"),
            condition.c.levels,
            *(stimulus.c[name] for name in ("id", *STIMULUS_FACTS)),
        )
        .select_from(stimulus.join(dataset).join(condition))
        .where(dataset.c.study_id == study_id)
        .order_by(dataset.c.position, condition.c.position)
    ).all()
    seen_in: dict[int, tuple[str, str]] = {}
    pairs = select(pair.c.media, pair.c.top_id, pair.c.bottom_id).join(dataset).where(dataset.c.study_id == study_id)
    for media, top_id, bottom_id in connection.execute(pairs.order_by(pair.c.id)):
        seen_in.setdefault(top_id, (media, "top"))
        seen_in.setdefault(bottom_id, (media, "bottom"))
    return [
        {**{key: value for key, value in row._mapping.items() if key != "id"}, **_seen_in(seen_in.get(row.id))}
        for row in rows
    ]


def _seen_in(where: tuple[str, str] | None) -> dict[str, str | None]:
    return {"media": where[0] if where else None, "half": where[1] if where else None}


def pair_records(connection: Connection, study_id: int) -> list[dict[str, Any]]:
    """Return every pair's video: what it holds, and its file."""
    rows = _named_pairs(study_id, *(pair.c[name] for name in ("media", *FILM_FACTS)))
    return [dict(row._mapping) for row in connection.execute(rows.order_by(dataset.c.position, pair.c.id))]


@dataclass(frozen=True)
class ShownFilm:
    """A film's file, and what its player expects of it.

    Parameters
    ----------
    media : opaque name of the pair whose film it is
    name : what it shows, in words
    width, height : of a strip, pixels
    guard_rows : between two strips
    n_strips : one above the other
    codec : key of ENCODERS
    is_single : is it shown by a decoder, picture by picture?
    """

    media: str
    name: str
    file: str
    sha256: str
    width: int
    height: int
    guard_rows: int
    fps: float
    n_frames: int
    n_strips: int
    codec: str = H264
    is_single: bool = False


def shown_films(connection: Connection, study_id: int, *, n_strips: int, n_of_practice: int) -> list[ShownFilm]:
    """Return every film of a study that a participant may be shown, each file once.

    Parameters
    ----------
    n_strips : of the films of trials
    n_of_practice : of those of the practice
    """
    datasets = select(dataset.c.id).where(dataset.c.study_id == study_id)
    by_file: dict[str, ShownFilm] = {}
    names = film_names(connection, study_id)
    for table, belongs, strips in (
        (pair, pair.c.dataset_id.in_(datasets), n_strips),
        (practice_pair, practice_pair.c.study_id == study_id, n_of_practice),
    ):
        facts = [table.c[name] for name in ("media", "width", "height", "guard_rows", "fps", "n_frames")]
        alone = select(single_film.c.file).where(single_film.c.of_media == table.c.media)
        both = select(*facts, table.c.file, table.c.sha256).where(belongs, table.c.file.not_in(alone))
        for row in connection.execute(both.order_by(table.c.id)).all():
            whole = ShownFilm(**row._mapping, name=names.get(row.media, OF_PRACTICE), n_strips=strips)
            by_file.setdefault(whole.file, whole)
        for other, codec in ((second_film, ""), (lighter_film, LIGHTER), (single_film, SINGLE)):
            kept = other.c.codec if other is second_film else literal(codec).label("codec")
            of_pairs = table.join(other, other.c.of_media == table.c.media)
            rows = connection.execute(
                select(*facts, other.c.file, other.c.sha256, kept).select_from(of_pairs).where(belongs)
            )
            for row in rows.all():
                n = 1 if codec == SINGLE else strips
                name = f"{names.get(row.media, OF_PRACTICE)} ({row.codec})"
                film = ShownFilm(**row._mapping, name=name, n_strips=n, is_single=codec == SINGLE)
                by_file.setdefault(film.file, film)
    return list(by_file.values())


def film_names(connection: Connection, study_id: int) -> dict[str, str]:
    """Return what each pair's film shows, in words, by its opaque name."""
    rows = connection.execute(_named_pairs(study_id, pair.c.media))
    return {
        row.media: f"{row.dataset}: {row.top}" + (f" and {row.bottom}" if row.bottom != row.top else "") for row in rows
    }


def shown_pairs(connection: Connection, study_id: int) -> dict[int, ShownPair]:
    """Return the names of a study's pairs, by id."""
    rows = connection.execute(_named_pairs(study_id, pair.c.id))
    return {row.id: ShownPair(row.dataset, row.top, row.bottom) for row in rows}


def _named_pairs(study_id: int, *columns: Column[Any]) -> Select[Any]:
    """Select a study's pairs: the names of dataset, top and bottom condition, then other columns."""
    return with_pair_names(select(*PAIR_NAMES, *columns).select_from(pair)).where(dataset.c.study_id == study_id)


def with_pair_names(query: Select[Any]) -> Select[Any]:
    """Join what `PAIR_NAMES` are read from to a query of pairs."""
    return (
        query.join(dataset, pair.c.dataset_id == dataset.c.id)
        .join(_TOP, pair.c.top_id == _TOP.c.id)
        .join(_BOTTOM, pair.c.bottom_id == _BOTTOM.c.id)
        .join(_TOP_CONDITION, _TOP.c.condition_id == _TOP_CONDITION.c.id)
        .join(_BOTTOM_CONDITION, _BOTTOM.c.condition_id == _BOTTOM_CONDITION.c.id)
    )


def copy_design(connection: Connection, source_id: int, target_id: int) -> None:
    """Give a study the datasets, conditions, stimuli and pairs of another one; the films get new opaque names."""
    studies = {source_id: target_id}
    datasets = _copy_rows(connection, dataset, study_id=studies)
    conditions = _copy_rows(connection, condition, study_id=studies)
    stimuli = _copy_rows(connection, stimulus, dataset_id=datasets, condition_id=conditions)
    _copy_rows(connection, pair, dataset_id=datasets, top_id=stimuli, bottom_id=stimuli)
    _copy_rows(connection, practice_pair, study_id=studies)


def _copy_rows(connection: Connection, table: Table, **references: Mapping[Any, Any]) -> dict[int, int]:
    """Copy the rows that refer to rows which were copied; returns new ids by old ones.

    Parameters
    ----------
    references : for each column that refers, new values by old ones
    """
    copied = {}
    belongs = [table.c[column].in_(list(known)) for column, known in references.items()]
    for row in connection.execute(select(table).where(*belongs).order_by(table.c.id)).all():
        values = {name: value for name, value in row._mapping.items() if name != "id"}
        new = {column: known[values[column]] for column, known in references.items()}
        if "media" in values:
            new["media"] = new_opaque_id()
        copied[row.id] = _insert(connection, table, {**values, **new})
        for other_films in OTHER_FILMS if table in PAIRS else ():
            _copy_rows(connection, other_films, of_media={row.media: new["media"]})
    return copied
