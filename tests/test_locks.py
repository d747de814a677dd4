"""What development, a server, the reconstruction and the build install is of one kind, and no more than each needs."""

from __future__ import annotations

import re
import tomllib

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.locks import BUILD, LOCK, RECON, ROOT, SERVER, locked

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
EXTRAS = PROJECT["project"]["optional-dependencies"]


def names(lines: list[str]) -> set[str]:
    return {canonicalize_name(Requirement(line).name) for line in lines}


def locked_names(*locks: str) -> set[str]:
    return {requirement.name for requirement in locked(*locks)}


@pytest.mark.parametrize("part", [SERVER, RECON, BUILD])
def test_a_part_pins_the_versions_that_are_tested(part: str) -> None:
    tested = {(requirement.name, str(requirement.specifier)) for requirement in locked(LOCK)}
    assert locked(part)
    assert {(requirement.name, str(requirement.specifier)) for requirement in locked(part)} <= tested


def test_each_part_has_what_its_extras_ask_for() -> None:
    server = names(PROJECT["project"]["dependencies"] + EXTRAS["postgres"] + EXTRAS["s3"])
    assert server <= locked_names(SERVER)
    assert names(EXTRAS["recon"] + EXTRAS["cluster"]) <= locked_names(SERVER, RECON)
    assert names(PROJECT["dependency-groups"]["build"]) == locked_names(BUILD)


def test_production_installs_nothing_for_tests_and_a_server_no_reconstruction() -> None:
    needed_by_dask_and_pyrender = {"pyyaml", "trimesh"}
    only_for_tests = names(EXTRAS["test"] + EXTRAS["docs"]) - needed_by_dask_and_pyrender
    assert not only_for_tests & locked_names(SERVER, RECON)
    assert not names(EXTRAS["recon"] + EXTRAS["cluster"]) & locked_names(SERVER)


@pytest.mark.parametrize("lock", [LOCK, SERVER, RECON, BUILD])
def test_every_package_has_hashes_and_no_lock_names_a_registry(lock: str) -> None:
    text = (ROOT / lock).read_text(encoding="utf-8")
    assert "://" not in text
    assert "index-url" not in text
    pins = re.split(r"^(?=\S+==)", text, flags=re.MULTILINE)[1:]
    assert [pin.split()[0] for pin in pins if "--hash=sha256:" not in pin] == []
