"""A deleted study leaves no row behind, but its entries in the audit log."""

from __future__ import annotations

import pytest
from sqlalchemy import Table, func, insert, select

from app.store.delete_study import delete_rows
from app.store.engine import Database
from app.store.tables import dataset, lighter_film, pair, second_film, single_film

FILM = {"file": "film.mp4", "sha256": "0" * 64}


@pytest.mark.parametrize(
    ("table", "more"),
    [(second_film, {"codec": "vp9", "media": "m" * 32}), (single_film, {"strip": "top"}), (lighter_film, {})],
)
def test_the_other_films_of_its_pairs_are_deleted(
    database: Database, study_id: int, table: Table, more: dict[str, str]
) -> None:
    with database.writing() as connection:
        pairs = select(pair.c.media).join(dataset).where(dataset.c.study_id == study_id)
        media = connection.scalars(pairs.limit(1)).one()
        connection.execute(insert(table).values(of_media=media, **FILM, **more))
        delete_rows(connection, study_id)
        assert connection.execute(select(func.count()).select_from(table)).scalar_one() == 0
