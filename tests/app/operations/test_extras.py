"""Whoever lacks a package that an extra brings is told a command that installs it."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from app.operations.extras import MODULES, install_command, missing_extra
from recon.studio import SynthParameters, synthesise

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[3]
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]


# A module to hide, a command that needs it, and settings.
NEEDS = [
    ("recon", "cv2", "capture check nowhere", {}),
    ("cluster", "distributed", "reconstruct ball -o run --cluster tcp://127.0.0.1:1", {}),
    ("postgres", "psycopg", "db upgrade", {"RECONSTUDY_DATABASE_URL": "postgresql://reader:secret@host/study"}),
    ("s3", "s3fs", "reconstruct s3://bucket/ball -o run", {}),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder to work in, with a capture."""
    folder = tmp_path_factory.mktemp("work")
    synthesise(folder / "ball", SynthParameters(scene="ball", n_sensors=1, n_frames=1, size=(48, 32)))
    return folder


def run_without(module: str, arguments: str, folder: Path, **settings: str) -> subprocess.CompletedProcess[str]:
    """Run a command in a process that cannot import a module."""
    code = f"import sys; sys.modules[{module!r}] = None; from app.cli import main; main()"
    return subprocess.run(
        [sys.executable, "-c", code, *arguments.split()],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)} | settings,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize(("extra", "module", "arguments", "settings"), NEEDS, ids=lambda value: str(value)[:30])
def test_a_command_without_its_extra_tells_what_installs_it(
    folder: Path, extra: str, module: str, arguments: str, settings: dict[str, str]
) -> None:
    told = run_without(module, arguments, folder, **settings)
    assert told.returncode == 1
    *_, line = told.stderr.splitlines()  # a note may come first
    assert module in line
    assert f"'{extra}'" in line
    assert "secret" not in line
    assert line.endswith(f"to install it: {install_command(extra)}")
    assert line.endswith(f"pip install 'reconstudy[{extra}]'")


def test_pip_takes_the_commands() -> None:
    """Without a network, as all that they ask for is there already: the program itself and what its extras name."""
    commands = [shlex.split(install_command(extra)) for extra in MODULES]
    asked = [word for command in commands for word in command[4:]]
    every = [*commands[0][:4], *asked, "--dry-run", "--no-index"]
    done = subprocess.run(every, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "Would install" not in done.stdout


@pytest.mark.parametrize("extra", MODULES)
def test_a_module_that_is_looked_for_is_of_a_package_of_its_extra(extra: str) -> None:
    packages = {"OpenEXR": ["OpenEXR"]} | packages_distributions()  # Python 3.11 lists no single compiled module
    brought = {canonicalize_name(name) for module in MODULES[extra] for name in packages[module]}
    assert brought == {canonicalize_name(Requirement(line).name) for line in EXTRAS[extra]} & installed_names()


def test_an_error_of_another_cause_is_left_as_it_is() -> None:
    assert missing_extra(ValueError("broken")) is None
    assert missing_extra(ModuleNotFoundError("No module named 'x'", name="x")) is None


def installed_names() -> set[str]:
    return {canonicalize_name(name) for names in packages_distributions().values() for name in names}
