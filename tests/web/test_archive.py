"""A study's archive needs no more memory the more was voted."""

from __future__ import annotations

import tracemalloc
import zipfile
from collections.abc import Iterator
from tempfile import SpooledTemporaryFile
from typing import Any

import pytest

from app.settings import Settings
from app.store.engine import open_database
from app.store.studies import study_by_slug
from app.web import archive
from app.web.answers import IN_MEMORY

N_TRIALS = 25_000


def trials(*_: object) -> Iterator[dict[str, Any]]:
    for number in range(N_TRIALS):
        switches = [{"to": "b", "at_ms": at_ms, "frame": number} for at_ms in (100.5, 900.25, 1700.125)]
        yield {"trial": f"trial {number}", "participant": "P001", "viewing": {"switches": switches}}


@pytest.mark.slow
def test_an_archive_of_many_trials_takes_little_memory(
    settings: Settings, study: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(archive, "trial_records", trials)
    database = open_database(settings.url)
    with database.reading() as connection:
        of = study_by_slug(connection, study["slug"])
    assert of is not None
    with SpooledTemporaryFile(IN_MEMORY) as content:
        tracemalloc.start()
        archive.write_archive(content, database, of)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        with zipfile.ZipFile(content) as written:
            size = written.getinfo(f"{of.slug}/trials.csv").file_size
    database.dispose()
    assert size > 4 * IN_MEMORY
    assert peak < 3 * IN_MEMORY
