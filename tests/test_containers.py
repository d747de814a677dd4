"""The images that Dockerfile and compose.yaml describe; tests/app/test_wheel.py runs the steps that need no network."""

from __future__ import annotations

import fnmatch
import json
import re
import shlex
import shutil
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml

from app.cli import app
from app.settings import Settings
from app.web.monitoring.health import healthz, router
from tests.containers import ROOT, arguments_of, copied_files, stages

COMPOSE = yaml.safe_load((ROOT / "compose.yaml").read_text(encoding="utf-8"))
OURS = {name: service for name, service in COMPOSE["services"].items() if "build" in service}
IMAGES = ("server", "recon")


def test_the_linter_finds_nothing_wrong_with_the_dockerfile() -> None:
    hadolint = shutil.which("hadolint", path=str(Path(sys.executable).parent))
    assert hadolint, "hadolint is missing: `make setup` installs it"
    done = subprocess.run([hadolint, "--no-color", ROOT / "Dockerfile"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "")


@pytest.mark.parametrize("stage", stages())
def test_what_a_stage_copies_is_there_and_not_ignored(stage: str) -> None:
    lines = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    let_through = [line[1:] for line in lines if line.startswith("!")]
    for path in copied_files(stage):
        assert (ROOT / path).exists()
        assert any(fnmatch.fnmatch(path, pattern) for pattern in let_through), f"{path} is in .dockerignore"


@pytest.mark.parametrize("stage", stages())
def test_every_package_is_installed_by_its_hash_or_is_our_wheel(stage: str) -> None:
    installs = arguments_of(stage, "RUN", "pip install")
    assert installs
    for command in installs:
        words = shlex.split(command)
        if "--require-hashes" in words:
            locks = [Path(word).name for flag, word in pairwise(words) if flag == "-r"]
            assert all((ROOT / lock).is_file() for lock in locks)
        else:
            assert "--no-deps" in words
            assert words[-1] == "/wheels/*.whl"


def test_the_reconstruction_has_the_system_packages_of_a_developers_machine() -> None:
    (command,) = arguments_of("recon", "RUN", "apt-get install")
    packages = re.findall(r"\blib[\w.-]+", command.split("&&")[1])
    (developers,) = re.findall(r"^packages=\((.*)\)$", (ROOT / "setup.sh").read_text(encoding="utf-8"), re.MULTILINE)
    assert packages
    assert set(packages) <= set(developers.split())


@pytest.mark.parametrize("stage", IMAGES)
def test_an_image_does_not_run_as_root(stage: str) -> None:
    assert arguments_of(stage, "USER")[-1] not in ("0", "root")


@pytest.mark.parametrize("stage", IMAGES)
def test_an_image_starts_a_command_that_exists(stage: str) -> None:
    (entry,) = arguments_of("server", "ENTRYPOINT")
    assert json.loads(entry) == ["reconstudy"]
    assert_command(json.loads(arguments_of(stage, "CMD")[-1]))


def test_health_is_asked_where_the_server_answers() -> None:
    (port,) = arguments_of("server", "EXPOSE")
    (check,) = arguments_of("server", "HEALTHCHECK")
    assert f"http://127.0.0.1:{port}{router.url_path_for(healthz.__name__)}" in check
    (published,) = COMPOSE["services"]["server"]["ports"]
    assert published == f"127.0.0.1:{port}:{port}"


def test_only_the_data_folder_is_kept_and_the_server_writes_there() -> None:
    (volume,) = arguments_of("server", "VOLUME")
    (variable,) = arguments_of("server", "ENV")
    assert variable.startswith(f"RECONSTUDY_DATA_DIR={volume}/")
    assert all(service["volumes"] == [f"data:{volume}"] for service in OURS.values())
    assert set(COMPOSE["volumes"]) == {"data", "database"}


def test_only_a_proxy_on_this_host_is_believed_who_asks() -> None:
    (network,) = COMPOSE["networks"]["default"]["ipam"]["config"]
    assert {service["environment"]["FORWARDED_ALLOW_IPS"] for service in OURS.values()} == {network["gateway"]}


@pytest.mark.parametrize("name", OURS)
def test_a_service_is_built_from_a_stage_and_has_known_settings(name: str) -> None:
    service = OURS[name]
    assert service["build"]["target"] in IMAGES
    assert_command(service.get("command", ["--help"]))
    prefix = str(Settings.model_config["env_prefix"])
    given = {
        variable.removeprefix(prefix).lower() for variable in service["environment"] if variable.startswith(prefix)
    }
    assert given <= set(Settings.model_fields)


def test_the_database_is_upgraded_before_the_server_starts() -> None:
    services: dict[str, Any] = COMPOSE["services"]
    assert services["upgrade"]["command"] == ["db", "upgrade"]
    assert services["upgrade"]["depends_on"] == {"database": {"condition": "service_healthy"}}
    assert services["server"]["depends_on"] == {"upgrade": {"condition": "service_completed_successfully"}}


def test_no_password_stands_in_the_files() -> None:
    assert COMPOSE["services"]["database"]["environment"]["POSTGRES_PASSWORD"].startswith("${DATABASE_PASSWORD:?")
    assert all(service["environment"]["PGPASSWORD"].startswith("${DATABASE_PASSWORD:?") for service in OURS.values())
    assert ".env" in (ROOT / ".gitignore").read_text(encoding="utf-8").split()


@pytest.mark.parametrize(
    "image", [arguments_of("build", "FROM")[0].split()[0], COMPOSE["services"]["database"]["image"]]
)
def test_a_foreign_image_is_of_a_named_version(image: str) -> None:
    assert re.fullmatch(r"[a-z]+:\d[\w.-]+", image)


def assert_command(words: list[str]) -> None:
    command: Any = typer.main.get_command(app)
    while words and hasattr(command, "commands") and words[0] in command.commands:
        command, words = command.commands[words[0]], words[1:]
    known = {name for parameter in command.params for name in parameter.opts} | {"--help"}
    assert {word for word in words if word.startswith("-")} <= known
    assert words == ["--help"] or not hasattr(command, "commands")
