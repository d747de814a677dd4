"""The rules of direction between the packages, read off the import statements."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent

# Left to right; a stage may import its own and those before it.
STAGES = [
    {"rig", "geometry", "storage", "workers"},
    {"capture"},
    {"studio"},
    {"depth"},
    {"cloud"},
    {"surface"},
    {"fusion"},
    {"approaches"},
    {"render"},
    {"pipeline"},
    {"validation"},
    {"export_models"},
    {"experiment"},
    {"cli"},
]
RANK = {stage: rank for rank, stages in enumerate(STAGES) for stage in stages}

# Third-party packages and where alone they may be imported.
HOMES = {
    "sqlalchemy": ("app/store/", "migrations/"),
    "alembic": ("app/store/", "migrations/"),
    "fastapi": ("app/web/", "app/main.py"),
    "starlette": ("app/web/", "app/main.py"),
    "jinja2": ("app/web/", "app/main.py", "app/analysis/report.py", "app/experiment/report.py"),
    "open3d": ("recon/",),
    "pyrender": ("recon/",),
    "cv2": ("recon/",),
    "numba": ("recon/",),
    "imageio_ffmpeg": ("recon/render/video.py", "app/ffmpeg.py"),
}
PURE = {"numpy", "scipy", "app"}
PURE_EXCEPTIONS = {
    "app/analysis/charts.py": {"altair", "vl_convert", "pandas"},
    "app/analysis/report.py": {"jinja2", "pandas"},
    "app/analysis/reading.py": {"pandas"},
    "app/analysis/tabular.py": {"pandas"},
    "app/analysis/votes_table.py": {"pandas"},
}
IMPURE_STANDARD_LIBRARY = {"sqlite3", "random", "secrets", "time", "socket", "http", "urllib", "uuid"}


def python_files(*folders: str) -> list[Path]:
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))


def imported_modules(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            assert node.module is not None
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names if node.module == "recon")


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("path", python_files("recon"), ids=name_of)
def test_recon_never_imports_app(path: Path) -> None:
    assert not [name for name in imported_modules(path) if name.split(".")[0] == "app"]


@pytest.mark.parametrize("path", python_files("app"), ids=name_of)
def test_in_app_only_the_command_line_imports_recon(path: Path) -> None:
    if not name_of(path).startswith("app/cli/"):
        assert not [name for name in imported_modules(path) if name.split(".")[0] == "recon"]


@pytest.mark.parametrize("path", [p for p in python_files("recon") if name_of(p) != "recon/__init__.py"], ids=name_of)
def test_a_stage_imports_only_stages_to_its_left(path: Path) -> None:
    own = Path(path.relative_to(ROOT / "recon").parts[0]).stem
    stages = {name.split(".")[1] for name in imported_modules(path) if name.startswith("recon.")}
    assert not [stage for stage in stages if RANK[stage] > RANK[own]]


@pytest.mark.parametrize("path", python_files("app", "recon", "migrations"), ids=name_of)
def test_third_party_packages_stay_in_their_homes(path: Path) -> None:
    for package in {name.split(".")[0] for name in imported_modules(path)} & set(HOMES):
        assert name_of(path).startswith(HOMES[package]), f"{package} belongs in {HOMES[package]}"


@pytest.mark.parametrize("path", python_files("app/study", "app/analysis"), ids=name_of)
def test_study_and_analysis_are_pure(path: Path) -> None:
    for name in imported_modules(path):
        package = name.split(".")[0]
        assert package not in IMPURE_STANDARD_LIBRARY, f"{name}: a clock, randomness or the network"
        allowed = PURE | PURE_EXCEPTIONS.get(name_of(path), set()) | set(sys.stdlib_module_names)
        assert package in allowed, f"{name} in a pure module"
        if package == "app" and name != "app.files":
            assert name.startswith(("app.study", "app.analysis")), f"{name} in a pure module"
