"""What all tests share: where the real recordings lie."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real recordings, which are never part of the project; absent, the test is skipped."""
    folder = Path(os.environ.get("RECONSTUDY_REAL_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real recordings at {folder}; set RECONSTUDY_REAL_DATA to a folder that has them")
    return folder
