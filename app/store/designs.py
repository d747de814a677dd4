"""A study's design: its datasets, conditions, stimuli and pairs, none of which changes once it is there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

from sqlalchemy import Connection, Table, insert, select

from app.stimuli import PairVideo, StimulusSet
from app.store.keys import new_opaque_id
from app.store.tables import condition, dataset, pair, practice_pair, stimulus
from app.study.trial import PlannedPair

STIMULUS_FACTS = {"sha256", "width", "height", "fps", "n_frames", "codec", "renderer"}


@dataclass(frozen=True)
class PairFile:
    """The file of a pair's video in the media folder."""

    file: str
    sha256: str


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
        facts = {name: value for name, value in asdict(video).items() if name not in ("top", "bottom")}
        ids = {"top_id": stimuli[video.top.name], "bottom_id": stimuli[video.bottom.name]}
        own = {"dataset_id": datasets[video.top.dataset], "media": new_opaque_id()}
        _insert(connection, pair, {**own, **ids, **facts})


def insert_practice(connection: Connection, study_id: int, pairs: Sequence[PairVideo]) -> None:
    """Insert the pairs that participants practise with."""
    for position, video in enumerate(pairs):
        facts = {name: value for name, value in asdict(video).items() if name not in ("top", "bottom")}
        own = {"study_id": study_id, "position": position, "media": new_opaque_id()}
        _insert(connection, practice_pair, {**own, **facts})


def practice_pairs(connection: Connection, study_id: int) -> list[PracticePair]:
    """The pairs that participants practise with, in order."""
    columns = [practice_pair.c[one.name] for one in fields(PracticePair)]
    rows = select(*columns).where(practice_pair.c.study_id == study_id).order_by(practice_pair.c.position)
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


def pair_file(connection: Connection, media: str) -> PairFile | None:
    for table in (pair, practice_pair):
        row = connection.execute(select(table.c.file, table.c.sha256).where(table.c.media == media)).one_or_none()
        if row:
            return PairFile(row.file, row.sha256)
    return None


def _insert(connection: Connection, table: Table, values: Mapping[str, Any]) -> int:
    return int(connection.execute(insert(table).values(**values).returning(table.c.id)).scalar_one())
