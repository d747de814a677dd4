"""What deploy/ describes is what systemd understands; nginx's part is tested with the videos that it sends."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from app.main import UVICORN_OPTIONS

NGINX_KEEPS_S = 60  # an idle connection to the server, by default
UNIT = Path(__file__).parents[3] / "deploy" / "reconstudy.service"
PROGRAM = "/opt/reconstudy/.venv/bin/reconstudy"


def verified(folder: Path, text: str) -> list[str]:
    """What systemd says against a unit, whose program need not be installed here, and no other unit."""
    program = shutil.which("systemd-analyze")
    if program is None:
        pytest.skip("systemd is not installed here")
    unit = folder / UNIT.name
    unit.write_text(text.replace(PROGRAM, "/bin/true"), encoding="utf-8")
    done = subprocess.run([program, "verify", str(unit)], capture_output=True, text=True, check=False)
    return [line for line in done.stderr.splitlines() if UNIT.name in line]


def test_systemd_finds_nothing_wrong_with_the_unit(tmp_path: Path) -> None:
    assert verified(tmp_path, UNIT.read_text(encoding="utf-8")) == []


def test_the_unit_starts_what_the_documentation_installs() -> None:
    """By commands that make the program's environment and fill it."""
    installs = (UNIT.parents[1] / "docs" / "operations.md").read_text(encoding="utf-8")
    environment = PROGRAM.removesuffix("/bin/reconstudy")
    assert f"python3 -m venv {environment}\n" in installs
    assert f"{environment}/bin/pip install --no-deps reconstudy-" in installs
    assert UNIT.read_text(encoding="utf-8").count(f"={PROGRAM} ") == 2


def test_systemd_would_find_a_wrong_key(tmp_path: Path) -> None:
    (complaint,) = verified(tmp_path, UNIT.read_text(encoding="utf-8").replace("Restart=", "Restrat="))
    assert "Restrat" in complaint


def test_the_server_keeps_connections_for_longer_than_nginx_does() -> None:
    """The other way round, a vote would now and then be sent into a connection that was just closed."""
    assert "keepalive_timeout" not in (UNIT.parent / "nginx.conf").read_text(encoding="utf-8")
    assert UVICORN_OPTIONS["timeout_keep_alive"] > NGINX_KEEPS_S
