"""A study's design: its datasets, conditions, stimuli and pairs, none of which changes once it is there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

from sqlalchemy import Connection, Table, insert, select

from app.films import H264, FilmFile, PairVideo
from app.stimuli import StimulusSet
from app.store.keys import new_opaque_id
from app.store.tables import condition, dataset, pair, practice_pair, second_film, stimulus
from app.study.trial import PlannedPair

FILM_FACTS = {"file", "sha256", "width", "height", "guard_rows", "fps", "n_frames"}
STIMULUS_FACTS = {"sha256", "width", "height", "fps", "n_frames", "codec", "renderer"}


@dataclass(frozen=True)
class PracticePair:
    """A pair to practise with, as its participant may know it."""

    position: int
    media: str
    width: int
    height: int
    guard_rows: int
    fps: float
    n_frames: int
    second_media: str | None
    second_codec: str | None


SECOND = (second_film.c.media.label("second_media"), second_film.c.codec.label("second_codec"))


def insert_design(connection: Connection, study_id: int, of: StimulusSet, pairs: Sequence[PairVideo]) -> None:
    """Insert what a study compares."""
    datasets = {
        name: _insert(connection, dataset, {"study_id": study_id, "position": position, "name": name})
        for position, name in enumerate(of.datasets)
    }
    levels = {stimulus.approach: stimulus.levels for stimulus in of.stimuli}
    conditions = {
        name: _insert(
            connection, condition, {"study_id": study_id, "position": position, "name": name, "levels": levels[name]}
        )
        for position, name in enumerate(of.conditions)
    }
    stimuli = {
        one.name: _insert(
            connection,
            stimulus,
            {
                "dataset_id": datasets[one.dataset],
                "condition_id": conditions[one.approach],
                **one.model_dump(include=STIMULUS_FACTS),
            },
        )
        for one in of.stimuli
    }
    for video in pairs:
        ids = {"top_id": stimuli[video.top.name], "bottom_id": stimuli[video.bottom.name]}
        own = {"dataset_id": datasets[video.top.dataset], **ids}
        _insert(connection, pair, {**own, **_film(connection, video)})


def insert_practice(connection: Connection, study_id: int, pairs: Sequence[PairVideo]) -> None:
    """Insert the pairs that participants practise with."""
    for position, video in enumerate(pairs):
        own = {"study_id": study_id, "position": position}
        _insert(connection, practice_pair, {**own, **_film(connection, video)})


def practice_pairs(connection: Connection, study_id: int) -> list[PracticePair]:
    """The pairs that participants practise with, in order."""
    own = [practice_pair.c[one.name] for one in fields(PracticePair) if one.name in practice_pair.c]
    rows = (
        select(*own, *SECOND)
        .select_from(practice_pair.outerjoin(second_film, second_film.c.of_media == practice_pair.c.media))
        .where(practice_pair.c.study_id == study_id)
        .order_by(practice_pair.c.position)
    )
    return [PracticePair(**row._mapping) for row in connection.execute(rows)]


def datasets_of(connection: Connection, study_id: int) -> list[str]:
    rows = select(dataset.c.name).where(dataset.c.study_id == study_id).order_by(dataset.c.position)
    return list(connection.scalars(rows))


def conditions_of(connection: Connection, study_id: int) -> dict[str, dict[str, str]]:
    """Factor levels by the condition's name."""
    rows = select(condition.c.name, condition.c.levels).where(condition.c.study_id == study_id)
    return {row.name: row.levels for row in connection.execute(rows.order_by(condition.c.position))}


def planned_pairs(connection: Connection, study_id: int) -> list[PlannedPair]:
    """All pairs of a study, as its orders need them."""
    rows = connection.execute(
        select(pair.c.id, pair.c.dataset_id, pair.c.top_id, pair.c.bottom_id)
        .join(dataset)
        .where(dataset.c.study_id == study_id)
        .order_by(dataset.c.position, pair.c.id)
    )
    return [PlannedPair(row.id, row.dataset_id, row.top_id, row.bottom_id) for row in rows]


def stimulus_names(connection: Connection, study_id: int) -> dict[int, tuple[str, str]]:
    """(dataset, condition) by the stimulus' id."""
    rows = connection.execute(
        select(stimulus.c.id, dataset.c.name, condition.c.name)
        .select_from(stimulus.join(dataset).join(condition, stimulus.c.condition_id == condition.c.id))
        .where(dataset.c.study_id == study_id)
    )
    return {key: (of_dataset, of_condition) for key, of_dataset, of_condition in rows}


def pair_file(connection: Connection, media: str) -> FilmFile | None:
    """The file in the media folder that has this opaque name."""
    for table in (pair, practice_pair):
        row = connection.execute(select(table.c.file, table.c.sha256).where(table.c.media == media)).one_or_none()
        if row:
            return FilmFile(H264, row.file, row.sha256)
    found = select(second_film.c.codec, second_film.c.file, second_film.c.sha256).where(second_film.c.media == media)
    second = connection.execute(found).one_or_none()
    return FilmFile(second.codec, second.file, second.sha256) if second else None


def _film(connection: Connection, video: PairVideo) -> dict[str, Any]:
    """The columns of a pair that say which film it is; the film in the second codec gets its own row."""
    media = new_opaque_id()
    if video.second:
        values = {"media": new_opaque_id(), "of_media": media, **asdict(video.second)}
        _insert(connection, second_film, values)
    return {"media": media, **{name: value for name, value in asdict(video).items() if name in FILM_FACTS}}


def _insert(connection: Connection, table: Table, values: Mapping[str, Any]) -> int:
    return int(connection.execute(insert(table).values(**values).returning(table.c.id)).scalar_one())
