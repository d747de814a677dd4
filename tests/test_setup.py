"""Set-up says how far it is; a forge runs what the Makefile has."""

from __future__ import annotations

import re
import subprocess
import tomllib
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]
SETUP = Path(__file__).parents[1] / "setup.sh"


def test_set_up_counts_the_packages_that_pip_fetches() -> None:
    script = SETUP.read_text(encoding="utf-8")
    (function,) = re.findall(r"^tell_of_packages\(\) \{$.*?^\}$", script, re.MULTILINE | re.DOTALL)
    pip = ["Looking in links: /wheels", *(f"Collecting name{n}==1.0" for n in range(20)), "  Downloading name.whl"]
    pip += ["Processing /wheels/last.whl", "Installing collected packages: many", "Successfully installed many"]
    done = subprocess.run(
        ["bash", "-c", f"{function}\ntell_of_packages 21"], input="\n".join(pip) + "\n", capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        "setup: 10 of at most 21 packages fetched",
        "setup: 20 of at most 21 packages fetched",
        "setup: 21 packages fetched; unpacking them",
    ]


def test_set_up_says_when_it_is_done_and_what_comes_next() -> None:
    script = SETUP.read_text(encoding="utf-8")
    (function,) = re.findall(r"^tell_done\(\) \{$.*?^\}$", script, re.MULTILINE | re.DOTALL)
    done = subprocess.run(
        ["bash", "-c", f"venv=.venv SECONDS=125\n{function}\ntell_done"], capture_output=True, text=True, check=True
    )
    said = "setup: done after 2 min 5 s; to use it: . .venv/bin/activate, then reconstudy --help\n"
    assert done.stdout == said
    assert script.rstrip().endswith("tell_done")


def test_set_up_compiles_kernels_before_it_says_that_it_is_done(tmp_path: Path) -> None:
    shown = SETUP.read_text(encoding="utf-8")
    assert shown.index('"$COMPILED"') < shown.rindex("tell_done")
    (tmp_path / "setup.sh").write_text('#!/bin/sh\necho "${COMPILED:-nothing}"\n')
    (tmp_path / "setup.sh").chmod(0o755)
    told = [
        subprocess.run(
            ["make", "-sf", ROOT / "Makefile", goal], cwd=tmp_path, capture_output=True, text=True, check=True
        ).stdout
        for goal in ("setup", "installed")  # the tests compile them beside the types
    ]
    assert told == [".venv/.kernels\n", "nothing\n"]


def test_the_forge_runs_commands_of_the_makefile_and_builds_every_extra_of_a_server() -> None:
    jobs = yaml.safe_load((ROOT / ".github" / "workflows" / "tests.yml").read_text(encoding="utf-8"))["jobs"]
    commands = [step.get("run", "") for job in jobs.values() for step in job["steps"]]
    made = {name for command in commands for name in re.findall(r"^make (\w+)", command)}
    targets = re.findall(r"^([\w ]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    assert "test" in made <= {name for names in targets for name in names.split()}
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    assert set(jobs["wheel"]["strategy"]["matrix"]["extra"]) <= {"none", *extras}
