"""Pages and routes are tested on SQLite alone: their statements lie in app/store, whose tests run on both kinds.

What reads the most tables, and what concerns connections and durability, runs on PostgreSQL too.
"""

from __future__ import annotations

from pathlib import Path

import pytest

HERE = Path(__file__).parent
ON_BOTH = {
    "admin/participants/test_participants.py",
    "admin/studies/test_study_pages.py",
    "admin/test_admin.py",
    "analyst/test_archive.py",
    "analyst/test_results.py",
    "analyst/test_validation.py",
    "test_connections.py",
    "test_durability.py",
    "test_vote_path.py",
}


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    again = {
        item
        for item in items
        if "[postgresql" in item.name
        and item.path.is_relative_to(HERE)
        and item.path.relative_to(HERE).as_posix() not in ON_BOTH
    }
    config.hook.pytest_deselected(items=list(again))
    items[:] = [item for item in items if item not in again]
