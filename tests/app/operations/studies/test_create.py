"""Creating studies of a stimulus set."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from app.operations.database import open_store
from app.operations.studies.create import create_study
from app.operations.studies.manage import list_studies, upgrade_database
from app.settings import Settings
from tests.seeded_studies import seed_study


@pytest.mark.slow
def test_studies_of_the_same_set_may_be_created_at_the_same_time(tmp_path: Path, stimulus_set: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    upgrade_database(settings)

    def create(number: int) -> dict[str, Any]:
        return create_study(settings, stimulus_set, f"Study {number}")

    with ThreadPoolExecutor(4) as pool:
        made = list(pool.map(create, range(4)))
    assert [study["n_pairs"] for study in made] == [6, 6, 6, 6]
    assert len(list(settings.media_dir.glob("*.mp4"))) == 12


def test_a_name_that_another_study_takes_while_films_are_made_is_refused(tmp_path: Path, stimulus_set: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    upgrade_database(settings)

    def be_late(what: str, done: int, total: int) -> None:
        if what.startswith("encoding") and done == total:
            with open_store(settings) as database:
                seed_study(database, ["ball"], ["id_fa", "pm_fb"])  # its name is Test, too

    with pytest.raises(ValueError, match="there is already a study 'test'"):
        create_study(settings, stimulus_set, "Test", progress=be_late)
    assert [study["n_pairs"] for study in list_studies(settings)] == [1]
