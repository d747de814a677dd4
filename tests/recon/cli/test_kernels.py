"""The first compilation of kernels is announced, and only the first."""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path

import pytest

from recon.cli.console import ProgressLine
from recon.cli.kernels import DEPTH, RENDER, ROOT, STUDIO, tell_of_compiling

SOURCE = "from numba import njit\n\n@njit(cache=True)\ndef doubled(x):\n    return 2 * x\n"


def told(package: Path, capsys: pytest.CaptureFixture[str]) -> str:
    tell_of_compiling(ProgressLine(), package)
    return capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("is_elsewhere", [False, True])
def test_kernels_are_announced_until_they_are_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], is_elsewhere: bool
) -> None:
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    package = tmp_path / "depth"
    package.mkdir()
    source = package / "kernel.py"
    source.write_text(SOURCE)
    assert "kernels are compiled (depth), once on this machine" in told(package, capsys)
    spec = importlib.util.spec_from_file_location("kernel", source)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert module.doubled(3) == 6
    if is_elsewhere:  # numba has read the variable when it was imported: what it wrote is moved
        (package / "__pycache__").rename(tmp_path / "cache")
        (tmp_path / "cache").rename(package / "moved")
        monkeypatch.setenv("NUMBA_CACHE_DIR", str(package))
    assert told(package, capsys) == ""
    ahead = source.stat().st_mtime + 1000
    os.utime(source, (ahead, ahead))
    assert "kernels are compiled" in told(package, capsys)


@pytest.mark.parametrize("package", [STUDIO, DEPTH, RENDER])
def test_the_packages_that_are_announced_have_kernels(package: str) -> None:
    assert any("njit(" in path.read_text(encoding="utf-8") for path in (ROOT / package).rglob("*.py"))
