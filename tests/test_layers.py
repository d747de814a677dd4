"""The rules of direction between the packages, read off the import statements."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent

# Floor by floor from the bottom; a room may import its own floor and those below. docs/architecture.md shows the same.
FLOORS = {
    "ground": [
        {"fields", "files", "progress"},
        {"file_models"},
        {"dataclass_models"},
    ],
    "recon": [
        {"geometry", "runtime"},
        {"capture"},
        {"depth", "models", "studio"},
        {"cloud"},
        {"surface"},
        {"fusion"},
        {"methods"},
        {"render"},
        {"pipeline", "validation"},
        {"contract"},
        {"cli"},
    ],
    "app": [
        {"errors", "files", "settings"},
        {"study"},
        {"analysis", "ffmpeg"},
        {"intake"},
        {"films"},
        {"store"},
        {"operations"},
        {"simulation", "web"},
        {"main"},
        {"experiment"},
        {"cli"},
    ],
}
RANKS = {
    package: {room: rank for rank, floor in enumerate(floors) for room in floor} for package, floors in FLOORS.items()
}
FOLDERS = sorted(
    {path.parent.relative_to(ROOT).as_posix() for package in FLOORS for path in (ROOT / package).rglob("*.py")}
)
MOST_ROOMS = 15
MOST_FLOORS = 12

# Third-party packages and where alone they may be imported.
HOMES = {
    "sqlalchemy": ("app/store/", "migrations/"),
    "alembic": ("app/store/", "migrations/"),
    "fastapi": ("app/web/", "app/main.py"),
    "starlette": ("app/web/", "app/main.py"),
    "jinja2": (
        "app/web/",
        "app/main.py",
        "app/files.py",
        "app/analysis/report/page.py",
        "recon/runtime/pages.py",
    ),
    "open3d": ("recon/",),
    "pyrender": ("recon/",),
    "cv2": ("recon/",),
    "numba": ("recon/",),
    "imageio_ffmpeg": (
        "recon/render/encoding/video.py",
        "recon/validation/films/vmaf.py",
        "recon/capture/importing/depth_cameras/kinect.py",
        "app/ffmpeg/",
    ),
}
PURE = {"numpy", "pydantic", "pydantic_core", "scipy"}
PURE_EXCEPTIONS = {
    "app/analysis/report/score_charts.py": {"altair"},
    "app/analysis/report/vote_charts.py": {"altair"},
    "app/analysis/drawing/charts_in_common.py": {"PIL", "altair", "vl_convert"},
    "app/analysis/report/objective_charts.py": {"altair"},
    "app/analysis/report/rate_charts.py": {"altair"},
    "app/analysis/report/rating_charts.py": {"altair"},
    "app/analysis/report/page.py": {"jinja2"},
    "app/analysis/analyse.py": {"pandas"},
    "app/analysis/reading/cells.py": {"pandas"},
    "app/analysis/reading/read_votes.py": {"pandas"},
    "app/analysis/reading/files/tabular.py": {"pandas", "pyarrow"},
    "app/analysis/reading/files/text.py": {"pandas", "pyarrow"},
    "app/analysis/reading/votes_table.py": {"pandas"},
    "app/study/options/recruiting.py": {"urllib"},  # its quoting
    "app/study/screening/pictures.py": {"PIL"},
}
IMPURE_STANDARD_LIBRARY = {"sqlite3", "random", "secrets", "time", "socket", "http", "urllib", "uuid"}


def python_files(*folders: str) -> list[Path]:
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))


@cache
def imported_modules(path: Path) -> frozenset[str]:
    return frozenset(_imports(path))


def _imports(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            assert node.module is not None
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def imports_between_rooms(folder: Path) -> dict[str, set[str]]:
    """Return what each room of a folder, a module or a folder of them, imports of the others."""
    prefix = folder.relative_to(ROOT).as_posix().replace("/", ".") + "."
    imports: dict[str, set[str]] = {}
    for path in python_files(folder.relative_to(ROOT).as_posix()):
        room = Path(path.relative_to(folder).parts[0]).stem
        if room != "__init__":
            names = {
                name.removeprefix(prefix).split(".")[0] for name in imported_modules(path) if name.startswith(prefix)
            }
            imports.setdefault(room, set()).update(names - {room})
    return {room: others & imports.keys() for room, others in imports.items()}


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def is_below(name: str, package: str) -> bool:
    return name == package or name.startswith(f"{package}.")


def modules_that_import(package: str, *folders: str) -> list[str]:
    return [
        name_of(path)
        for path in python_files(*folders)
        if any(name.split(".")[0] == package for name in imported_modules(path))
    ]


def test_recon_never_imports_app() -> None:
    assert modules_that_import("app", "recon") == []


def test_the_ground_of_both_halves_loads_nothing_heavy_and_neither_of_them() -> None:
    imported = {name.split(".")[0] for path in python_files("ground") for name in imported_modules(path)}
    assert imported - sys.stdlib_module_names == {"ground", "pydantic"}


def test_in_app_only_the_command_line_and_the_experiment_import_recon_and_jobs_its_light_room_of_settings() -> None:
    reconstructing = ("app/cli/", "app/experiment/reconstruction/")
    others = [path for path in python_files("app") if not name_of(path).startswith(reconstructing)]
    imported = {(name_of(path), name) for path in others for name in imported_modules(path) if is_below(name, "recon")}
    rooms = {name for name, _ in imported if not name.startswith("app/operations/commands/")}
    assert rooms <= {"app/operations/jobs/forms.py"}
    assert [name for _, name in imported if not is_below(name, "recon.cli.commands")] == []


def test_the_settings_of_commands_load_nothing_heavy() -> None:
    imported = {name for path in python_files("recon/cli/commands") for name in imported_modules(path)}
    ours = {name for name in imported if is_below(name, "recon.cli.commands")}
    assert {name.split(".")[0] for name in imported - ours} - sys.stdlib_module_names == {"ground", "pydantic"}


@pytest.mark.parametrize("package", FLOORS)
def test_a_room_imports_only_its_own_floor_and_those_below(package: str) -> None:
    ranks = RANKS[package]
    upwards = [
        f"{room} imports {other}"
        for room, others in imports_between_rooms(ROOT / package).items()
        for other in others
        if ranks[other] > ranks[room]
    ]
    assert upwards == []


@pytest.mark.parametrize("folder", FOLDERS)
def test_rooms_of_a_folder_stand_on_few_floors_and_do_not_import_each_other_in_a_circle(folder: str) -> None:
    imports = {room: set(others) for room, others in imports_between_rooms(ROOT / folder).items()}
    n_floors = 0
    while free := [room for room, others in imports.items() if not others & imports.keys()]:
        n_floors += 1
        for room in free:
            del imports[room]
    assert not imports
    assert n_floors <= MOST_FLOORS


@pytest.mark.parametrize("folder", FOLDERS)
def test_a_folder_has_few_rooms(folder: str) -> None:
    assert len(imports_between_rooms(ROOT / folder)) <= MOST_ROOMS


@pytest.mark.parametrize("package", FLOORS)
def test_the_floors_the_picture_and_the_page_name_every_room(package: str) -> None:
    rooms = set(imports_between_rooms(ROOT / package))
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    picture = (ROOT / "docs" / "pictures" / "house.svg").read_text(encoding="utf-8")
    assert rooms == RANKS[package].keys()
    assert not [room for room in rooms if f">{room}</text>" not in picture]
    assert not [room for room in rooms if f"`{package}/{room}" not in page]


@pytest.mark.parametrize("package", HOMES)
def test_third_party_packages_stay_in_their_homes(package: str) -> None:
    users = modules_that_import(package, "app", "recon", "migrations")
    assert users
    assert [name for name in users if not name.startswith(HOMES[package])] == []


def test_study_and_analysis_are_pure() -> None:
    impure = [
        f"{name_of(path)} imports {name}"
        for path in python_files("app/study", "app/analysis")
        for name in imported_modules(path)
        if not is_pure(name, PURE | PURE_EXCEPTIONS.get(name_of(path), set()))
    ]
    assert impure == []


def is_pure(name: str, packages: set[str]) -> bool:
    """May a module without clock, randomness and network import a name?"""
    package = name.split(".")[0]
    if package == "ground":
        return True
    if package == "app":
        return name.startswith(("app.study", "app.analysis", "app.files"))
    return package in packages or (package in sys.stdlib_module_names and package not in IMPURE_STANDARD_LIBRARY)
