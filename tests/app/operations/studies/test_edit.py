"""What else changes when a study's settings do."""

from __future__ import annotations

from pathlib import Path

from app.operations.studies.edit import check_edit
from app.operations.studies.languages import read_languages
from app.operations.studies.manage import study_file_of
from app.settings import Settings
from app.store.database.engine import Database
from app.store.studies.studies import study_by_slug
from tests.seeded_studies import seed_study


def test_a_language_that_is_added_to_a_study_of_imported_films_speaks_of_films(
    database: Database, tmp_path: Path
) -> None:
    seed_study(database, ["scene"], ["a", "b"])
    with database.reading() as connection:
        study = study_by_slug(connection, "test")
    assert study is not None
    settings, now = Settings(data_dir=tmp_path), study_file_of(study)
    texts = {"en": {"welcome.body": "Mine."}}
    wanted = now.but(options=now.options.but(languages=("en", "es"), texts=texts))
    changed = check_edit(settings, database, study, wanted, read_languages(settings)).wanted.options
    assert changed.texts["es"]["comprehension.compare"] == "Espero una segunda película de la misma escena."
    assert changed.texts["en"] == texts["en"], "what was there stays"
