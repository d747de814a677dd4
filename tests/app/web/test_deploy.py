"""What deploy/ describes is what systemd understands; nginx's part is tested with the videos that it sends."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

from app.main import UVICORN_OPTIONS
from app.web.monitoring.metrics import Metrics

NGINX_KEEPS_S = 60  # an idle connection to the server, by default
DEPLOY = Path(__file__).parents[3] / "deploy"
UNIT = DEPLOY / "reconstudy.service"
UNITS = sorted(path.name for path in DEPLOY.iterdir() if path.suffix in (".service", ".timer"))
PROGRAM = "/opt/reconstudy/.venv/bin/reconstudy"


def verified(folder: Path, name: str, text: str) -> list[str]:
    """What systemd says against a unit, whose program need not be installed here, beside the others of deploy/."""
    program = shutil.which("systemd-analyze")
    if program is None:
        pytest.skip("systemd is not installed here")
    for other in UNITS:
        there = text if other == name else (DEPLOY / other).read_text(encoding="utf-8")
        (folder / other).write_text(there.replace(PROGRAM, "/bin/true"), encoding="utf-8")
    unit = folder / name.replace("@", "@trial")
    done = subprocess.run([program, "verify", str(unit)], capture_output=True, text=True, check=False)
    return [line for line in done.stderr.splitlines() if "reconstudy" in line]


@pytest.mark.parametrize("name", UNITS)
def test_systemd_finds_nothing_wrong_with_the_unit(tmp_path: Path, name: str) -> None:
    assert verified(tmp_path, name, (DEPLOY / name).read_text(encoding="utf-8")) == []


def test_every_alarm_asks_for_a_count_that_the_server_keeps() -> None:
    """`node_...` is node_exporter's, `up` Prometheus' own."""
    rules = [rule for group in yaml.safe_load((DEPLOY / "alarms.yml").read_text())["groups"] for rule in group["rules"]]
    assert all({"alert", "expr", "annotations"} <= rule.keys() for rule in rules)
    asked = {name for rule in rules for name in re.findall(r"reconstudy_\w+", rule["expr"].replace('"', " "))}
    text = Metrics(lambda: 0).text()[0].decode()
    assert {name for name in asked if f"# TYPE {name} " not in text} == set()
    assert len(asked) == 3


def test_the_unit_starts_what_the_documentation_installs() -> None:
    """By commands that make the program's environment and fill it."""
    installs = (UNIT.parents[1] / "docs" / "operations.md").read_text(encoding="utf-8")
    environment = PROGRAM.removesuffix("/bin/reconstudy")
    assert f"python3 -m venv {environment}\n" in installs
    assert f"{environment}/bin/pip install --no-deps reconstudy-" in installs
    assert UNIT.read_text(encoding="utf-8").count(f"={PROGRAM} ") == 2


def test_systemd_would_find_a_wrong_key(tmp_path: Path) -> None:
    text = UNIT.read_text(encoding="utf-8").replace("Restart=", "Restrat=")
    (complaint,) = verified(tmp_path, UNIT.name, text)
    assert "Restrat" in complaint


def test_the_server_keeps_connections_for_longer_than_nginx_does() -> None:
    """The other way round, a vote would now and then be sent into a connection that was just closed."""
    assert "keepalive_timeout" not in (UNIT.parent / "nginx.conf").read_text(encoding="utf-8")
    assert UVICORN_OPTIONS["timeout_keep_alive"] > NGINX_KEEPS_S
