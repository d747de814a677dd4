"""The lock files as tests read them."""

from __future__ import annotations

import re
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parent.parent
LOCK = "requirements.lock"
SERVER, RECON, BUILD = (f"requirements-{part}.lock" for part in ("server", "recon", "build"))


def locked(*names: str) -> list[Requirement]:
    """The pinned packages of some lock files, with their markers."""
    text = "\n".join((ROOT / name).read_text(encoding="utf-8") for name in names)
    return [Requirement(line) for line in re.findall(r"^(\S+==.*?) \\$", text, re.MULTILINE)]
