"""A design is replaced and copied as a whole: with its pairs go all their films."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import Connection, Table, func, insert, select

from app.films.pairs import FilmFile
from app.intake.stimuli import StimulusSet
from app.store.database.engine import Database
from app.store.database.tables import dataset, lighter_film, pair, practice_pair, second_film, single_film, study
from app.store.studies.studies import insert_study
from app.store.trials.designs import copy_design, insert_practice, replace_design
from tests.seeded_studies import pair_video, stimulus

FILM = {"file": "film.mp4", "sha256": "0" * 64}
OTHER_FILMS = [(second_film, {"codec": "vp9", "media": "m" * 32}), (single_film, {"strip": "top"}), (lighter_film, {})]


def insert_film(connection: Connection, study_id: int, table: Table, more: dict[str, str]) -> str:
    """Insert another film of a study's first pair; its opaque name."""
    media = first_media(connection, study_id)
    connection.execute(insert(table).values(of_media=media, **FILM, **more))
    return media


def first_media(connection: Connection, study_id: int) -> str:
    pairs = select(pair.c.media).join(dataset).where(dataset.c.study_id == study_id).order_by(pair.c.id)
    return connection.scalars(pairs.limit(1)).one()


@pytest.mark.parametrize(("table", "more"), OTHER_FILMS)
def test_a_replaced_design_leaves_no_film_of_its_pairs_behind(
    database: Database, study_id: int, table: Table, more: dict[str, str]
) -> None:
    with database.writing() as connection:
        insert_film(connection, study_id, table, more)
        replace_design(connection, study_id, StimulusSet(Path(), "test", "0" * 64, {}, ()), [], [])
        assert connection.execute(select(func.count()).select_from(table)).scalar_one() == 0


@pytest.mark.parametrize(("table", "more"), OTHER_FILMS)
def test_a_copied_design_has_all_films_under_new_names(
    database: Database, study_id: int, table: Table, more: dict[str, str]
) -> None:
    film = FilmFile("vp9", **FILM)
    practice = pair_video(stimulus("ball", "a"), stimulus("ball", "b"), second=film, singles=(film,), lighter=film)
    with database.writing() as connection:
        media = insert_film(connection, study_id, table, more)
        insert_practice(connection, study_id, [practice])
        row: dict[str, Any] = dict(connection.execute(select(study)).one()._mapping)
        copy_id = insert_study(connection, {**row, "id": study_id + 1, "slug": "copy"})
        copy_design(connection, study_id, copy_id)
        practised = select(practice_pair.c.media).order_by(practice_pair.c.id)
        of_media = [media, *connection.scalars(practised), first_media(connection, copy_id)]
        films = connection.execute(select(table)).all()
    assert len(set(of_media)) == 4
    assert sorted(film.of_media for film in films) == sorted(of_media)
    if table is second_film:
        assert len({film.media for film in films}) == 4
