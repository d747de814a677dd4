"""Nothing that the program imports is under a licence that asks the program to be under it, too."""

from __future__ import annotations

import re
import sys
from importlib.metadata import PathDistribution
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

SPEC = spec_from_file_location("third_party", Path(__file__).parent.parent / "deploy" / "third_party.py")
assert SPEC is not None
assert SPEC.loader is not None
third_party = module_from_spec(SPEC)
sys.modules[SPEC.name] = third_party  # its dataclass looks there
SPEC.loader.exec_module(third_party)


@pytest.mark.slow
@pytest.mark.parametrize("part", ["server", "recon"])
def test_every_package_that_is_installed_has_a_licence_that_is_allowed(part: str) -> None:
    packages = list(third_party.locked_packages(part))
    assert packages
    assert {each.name: each.refused() for each in packages if each.refused()} == {}


def test_every_package_that_browsers_load_has_a_licence_that_is_allowed() -> None:
    packages = list(third_party.browser_packages())
    assert {"three", "vega"} <= {each.name for each in packages}
    assert {each.name: each.refused() for each in packages if each.refused()} == {}


@pytest.mark.parametrize(
    "line",
    [
        "License-Expression: GPL-3.0-or-later",
        "License-Expression: MIT AND (GPL-2.0-only OR AGPL-3.0-only)",
        "Classifier: License :: OSI Approved :: GNU General Public License v3 (GPLv3)",
        "License: GPL",
        "Name: silent",
    ],
)
def test_a_licence_like_the_gpl_and_none_at_all_are_refused(tmp_path: Path, line: str) -> None:
    (tmp_path / "METADATA").write_text(f"Metadata-Version: 2.4\n{line}\n")
    package = third_party.Package("a", "1", third_party.stated_licences(PathDistribution(tmp_path)))
    assert package.refused()


@pytest.mark.slow
def test_the_list_of_packages_is_that_of_the_locks() -> None:
    listed = re.findall(r"^\| (\S+) \| (\S+) \|", third_party.OUT.read_text(encoding="utf-8"), re.MULTILINE)
    locked = [each for part in third_party.PARTS for each in third_party.locked_packages(part)]
    locked += third_party.browser_packages()
    assert [tuple(row) for row in listed if row[0] != "package"] == [(each.name, each.version) for each in locked]
