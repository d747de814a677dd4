"""A server of one test's own, and somebody who forgets their password."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from app.main import running_server
from app.settings import Settings
from tests.app.web.admin.dashboard_client import PASSWORD, Dashboard, signed_in


@pytest.fixture
def small(tmp_path: Path) -> Settings:
    return Settings(data_dir=tmp_path)


@pytest.fixture
def small_server(small: Settings) -> Iterator[str]:
    """A server of one test's own: a few wrong passwords there hold up nobody else."""
    with running_server(small) as url:
        yield url


@pytest.fixture
def forgetful(small_server: str, small: Settings) -> Iterator[Dashboard]:
    """Fred, who has a password and is signed in."""
    with signed_in(small_server, small, "Fred", "experimenter") as fred:
        fred.act("/admin/account/password", password=PASSWORD, again=PASSWORD)
        yield fred
