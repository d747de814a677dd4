"""Creating studies of a stimulus set."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from app.operations.create import create_study
from app.operations.manage import upgrade_database
from app.settings import Settings


def test_studies_of_the_same_set_may_be_created_at_the_same_time(tmp_path: Path, stimulus_set: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    upgrade_database(settings)

    def create(number: int) -> dict[str, Any]:
        return create_study(settings, stimulus_set, f"Study {number}")

    with ThreadPoolExecutor(4) as pool:
        made = list(pool.map(create, range(4)))
    assert [study["n_pairs"] for study in made] == [6, 6, 6, 6]
    assert len(list(settings.media_dir.glob("*.mp4"))) == 12
