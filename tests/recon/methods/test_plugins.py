"""Plug-ins: found by their names without an import, and refused by name."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from recon.methods.plugins import DEPTH_GROUP, Plugin, PluginError, PluginWarning, registered
from tests.installed_package import install

FLAT = Plugin("flat", "theirs:match", "theirs", "1.0")


@pytest.fixture
def packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of installed packages."""
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def test_a_plug_in_is_found_with_its_package_and_imported_when_it_is_loaded(packages: Path) -> None:
    install(packages, "their_flat", "def match(): return 7", "[reconstudy.depth]\nflat = their_flat:match\n", "2.1")
    plugin = registered(DEPTH_GROUP, {"id"})["flat"]
    assert plugin == Plugin("flat", "their_flat:match", "their_flat", "2.1")
    assert "their_flat" not in sys.modules
    loaded = plugin.load()
    assert callable(loaded)
    assert loaded() == 7


def test_a_plug_in_changes_its_code_version_with_its_source(packages: Path) -> None:
    for name in ("their_a", "their_b", "their_c"):
        code = "A = 1" if name != "their_c" else "A = 2"
        install(packages, name, code, f"[reconstudy.depth]\n{name[-1]} = {name}:A\n")
    plugins = registered(DEPTH_GROUP)
    assert plugins["a"].code_version() == plugins["b"].code_version() != plugins["c"].code_version()


def test_a_plug_in_in_a_folder_without_init_changes_its_code_version_with_any_of_its_files(packages: Path) -> None:
    for name in ("their_bare_a", "their_bare_b", "their_bare_c"):
        folder = packages / name / "inner"
        folder.mkdir(parents=True)
        (folder / "match.py").write_text("A = 1")
        (folder / "costs.py").write_text("B = 1" if name != "their_bare_c" else "B = 2")
    versions = [Plugin("a", f"their_bare_{name}.inner.match:A", "bare", "1.0").code_version() for name in "abc"]
    assert versions[0] == versions[1] != versions[2]


@pytest.mark.parametrize(
    ("code", "reason"),
    [("import no_such_module", "no_such_module"), ("1 / 0", "division by zero"), ("", "has no attribute 'match'")],
)
def test_a_plug_in_that_cannot_be_imported_is_named_when_it_is_used(packages: Path, code: str, reason: str) -> None:
    name = f"their_broken_{len(code)}"
    install(packages, name, code, f"[reconstudy.depth]\nbroken = {name}:match\n")
    with pytest.raises(PluginError, match=f"plug-in broken of {name} 1.0 cannot be imported .*{reason}") as raised:
        registered(DEPTH_GROUP)["broken"].load()
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("name", "reason"), [("id", "id is a method of this program"), ("a_b", "'a_b' is no name of a method")]
)
def test_a_plug_in_whose_name_cannot_be_used_is_left_out_by_name(packages: Path, name: str, reason: str) -> None:
    install(packages, "their_name", "", f"[reconstudy.depth]\n{name} = their_name:match\nfine = their_name:match\n")
    with pytest.warns(PluginWarning, match=f"plug-in {name} of their_name 1.0 is left out: {reason}"):
        assert list(registered(DEPTH_GROUP, {"id"})) == ["fine"]


def test_two_packages_with_a_name_in_common_are_both_left_out(packages: Path) -> None:
    for package in ("their_one", "their_two"):
        install(packages, package, "", f"[reconstudy.depth]\nsame = {package}:match\n")
    with (
        pytest.warns(PluginWarning, match=r"same of their_one 1\.0 is left out: .* same of their_two 1\.0: remove one"),
        pytest.warns(PluginWarning, match=r"same of their_two 1\.0 is left out: .* same of their_one 1\.0: remove one"),
    ):
        assert not registered(DEPTH_GROUP)


@pytest.mark.parametrize(
    ("code", "sentence"),
    [
        ("raise KeyError('left')", "plug-in flat of theirs 1.0 failed: KeyError('left')"),
        ("raise SystemExit(0)", "plug-in flat of theirs 1.0 failed: SystemExit(0)"),
        ("raise StopIteration", "plug-in flat of theirs 1.0 failed: StopIteration()"),
    ],
)
def test_what_a_plug_in_raises_names_it_and_the_kind_of_error(code: str, sentence: str) -> None:
    with pytest.raises(PluginError, match=f"^{re.escape(sentence)}$"), FLAT.running():
        exec(code)


def test_an_error_that_is_an_answer_passes_as_it_is() -> None:
    with pytest.raises(LookupError, match="no surface"), FLAT.running(LookupError):
        raise KeyError("no surface")


def test_what_a_plug_in_prints_goes_to_standard_error(capsys: pytest.CaptureFixture[str]) -> None:
    with FLAT.running():
        print("matching")
    assert capsys.readouterr() == ("", "matching\n")
