"""Studies whose options a test chooses."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest

from app.operations.studies.create import create_study
from app.settings import Settings
from app.study.options.options import parse_options


@pytest.fixture
def create(settings: Settings, stimulus_set: Path) -> Callable[..., dict[str, Any]]:
    def make(**options: Any) -> dict[str, Any]:
        name = f"Study {uuid4()}"
        return create_study(settings, stimulus_set, name, exposure_s=0.4, options=parse_options(options))

    return make
