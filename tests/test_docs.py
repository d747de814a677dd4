"""The documentation says what is there: its links hold, and every command and setting it names exists."""

from __future__ import annotations

import importlib
import json
import re
import shlex
import subprocess
import sys
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from fastapi.routing import APIRoute

from app.cli import app
from app.cli.experiments import DEMO_TAKES
from app.cli.schema import FILES
from app.experiment.reconstruction.scale import SCALES
from app.settings import Settings
from app.study.options.options import parse_options
from app.web.analyst.columns import JOBS, KINDS, STUDIES
from app.web.routers import ROUTERS
from ground.progress import duration

ROOT = Path(__file__).parent.parent
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")])
ELSEWHERE = {"RECONSTUDY_REAL_DATA"}  # of the tests
OF_OTHERS = {  # of docker, of a reader's own program, and of MPEG's pc_error
    *("--target", "--version", "--dropdups", "--neighborsProc", "--averageNormals", "--mseSpace"),
}


def leaves(command: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    below = getattr(command, "commands", {})
    if not below or command.invoke_without_command:
        yield path, command
    for name, each in below.items():
        yield from leaves(each, (*path, name))


COMMANDS = dict(leaves(typer.main.get_command(app)))


def command_lines(page: Path) -> Iterator[str]:
    """The lines of code blocks and the code in sentences that call the command, continuation lines joined."""
    text = page.read_text(encoding="utf-8").replace("\\\n", " ")
    blocks = re.findall(r"^```(?:sh|bash|text)?\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    lines = [line for block in blocks for line in block.splitlines()]
    without_blocks = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    lines += re.findall(r"`([^`]+)`", without_blocks)
    for line in lines:
        found = re.search(r"(?:^|[\s/])reconstudy ([a-z].*)$", line.split("#")[0].replace("\n", " "))
        if found:
            yield found[1].strip()


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_name_that_a_page_imports_is_there(page: Path) -> None:
    lines = re.findall(r"^from ((?:app|recon)[\w.]*) import ([\w, ]+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    missing = [
        f"{module}.{name}" for module, names in lines for name in names.split(", ") if not is_there(module, name)
    ]
    assert not missing


def is_there(module: str, name: str) -> bool:
    return hasattr(importlib.import_module(module), name)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_name_that_a_page_imports_is_public(page: Path) -> None:
    rows = re.findall(
        r"^\| `((?:app|recon)[\w.]*)` \| (.*) \|$", (ROOT / "docs" / "python.md").read_text(), re.MULTILINE
    )
    public = {f"{package}.{name}" for package, names in rows for name in re.findall(r"`(\w+)`", names)}
    lines = re.findall(r"^from ((?:app|recon)[\w.]*) import ([\w, ]+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    assert {f"{module}.{name}" for module, names in lines for name in names.split(", ")} <= public


def words(line: str) -> list[str]:
    try:
        return shlex.split(line)
    except ValueError:
        return line.split()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_script_that_starts_workers_guards_them(page: Path) -> None:
    blocks = re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    scripts = [block for block in blocks if "workers=" in block]
    assert [script for script in scripts if 'if __name__ == "__main__":' not in script] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_that_is_shown_exists_with_its_options(page: Path) -> None:
    assert unknown(command_lines(page)) == []


def test_the_front_page_of_the_demo_shows_commands_that_exist() -> None:
    front = (ROOT / "templates" / "front.html").read_text(encoding="utf-8")
    shown = re.findall(
        r"reconstudy ([a-z].*?)(?:</|$)", front.replace("\\\n", " ").split("With your own")[1], re.MULTILINE
    )
    assert len(shown) == 11
    assert unknown(shown) == []


def unknown(lines: Iterable[str]) -> list[str]:
    wrong = []
    for line in lines:
        given = words(line)
        path = next((tuple(given[:n]) for n in (2, 1) if tuple(given[:n]) in COMMANDS), None)
        groups = {path[:1] for path in COMMANDS if len(path) > 1}
        if path is None:
            if tuple(given[:1]) not in groups or (len(given) > 1 and given[1].isalpha()):
                wrong.append(line)
            continue
        command = COMMANDS[path]
        known = {name for each in options_of(command) for name in each}
        options = [word.split("=")[0] for word in given if re.match(r"-{1,2}[a-z]", word)]
        wrong += [f"{line}: {option}" for option in options if option not in known | {"--help"}]
    return wrong


def code_in_sentences(page: Path) -> list[str]:
    without_blocks = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    return [" ".join(code.split()) for code in re.findall(r"`([^`]+)`", without_blocks)]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_option_in_a_sentence_is_one_of_a_command_or_a_bench(page: Path) -> None:
    known = {name for command in COMMANDS.values() for each in options_of(command) for name in each}
    known |= set(re.findall(r'"(--[a-z-]+)"', "".join(path.read_text() for path in (ROOT / "bench").glob("*.py"))))
    sentences = [code for code in code_in_sentences(page) if code.startswith("--")]
    named = {name for code in sentences for name in re.findall(r"(?<!\S)--[a-z][\w-]*", code)}
    assert sorted(named - known - OF_OTHERS) == []


def options_of(command: Any) -> list[list[str]]:
    parameters = command.get_params(typer.Context(command))  # some are made only now
    return [[*each.opts, *each.secondary_opts] for each in parameters]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_file_of_the_repository_that_a_sentence_names_is_there(page: Path) -> None:
    files = r"(?:^|\s)((?:app|recon|ground|tests|docs|bench|deploy|migrations|static|templates|languages)/[\w./@-]+)"
    named = {file for code in code_in_sentences(page) for file in re.findall(files, code)}
    assert [file for file in sorted(named) if not (ROOT / file).exists() and not (ROOT / f"{file}.py").exists()] == []


def test_every_route_that_the_page_of_the_interface_shows_is_there() -> None:
    without_names = re.compile(r"{[^}]*}")
    routes = [route for router in ROUTERS for route in router.routes if isinstance(route, APIRoute)]
    known = {(method, without_names.sub("{}", route.path)) for route in routes for method in route.methods}
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    shown = re.findall(r"^(GET|POST|PUT|PATCH|DELETE) +(/[^\s,?]+)", page, re.MULTILINE)
    tables = page.split("## Tables")[1].split(":", 1)[1].split("; `/api")[0]
    shown += [("GET", f"/studies/{{slug}}/{name}") for name in re.findall(r"`([\w-]+)`", tables)]
    assert len(shown) > 35
    assert [each for each in shown if (each[0], without_names.sub("{}", f"/api/v1{each[1]}")) not in known] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_setting_that_is_named_exists(page: Path) -> None:
    prefix = str(Settings.model_config["env_prefix"])
    known = {f"{prefix}{name.upper()}" for name in Settings.model_fields} | ELSEWHERE
    assert set(re.findall(rf"\b{prefix}[A-Z_]+\b", page.read_text(encoding="utf-8"))) <= known


@pytest.mark.slow
def test_the_site_is_built_without_a_broken_link_and_names_every_command_setting_key_and_column(tmp_path: Path) -> None:
    built = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--quiet", "--site-dir", str(tmp_path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert built.returncode == 0, built.stderr
    commands = (tmp_path / "commands.html").read_text(encoding="utf-8")
    for path, command in COMMANDS.items():
        heading = f">reconstudy {' '.join(path)}<"
        assert heading in commands
        section = commands.split(heading)[1].split("<h2")[0]
        for parameter in command.params:
            if parameter.param_type_name == "option":
                assert max(parameter.opts, key=len) in section
            else:
                assert (parameter.metavar or parameter.name.upper()).replace("|", " or ") in section
    settings = (tmp_path / "settings.html").read_text(encoding="utf-8")
    assert all(f"RECONSTUDY_{name.upper()}" in settings for name in Settings.model_fields)
    files = (tmp_path / "files.html").read_text(encoding="utf-8")
    keys = {key for name in FILES.keys() - {"study"} for key in keys_of(FILES[name]().model_json_schema())}
    assert len(keys) > 80
    assert sorted(key for key in keys if f"<code>{key}</code>" not in files) == []
    tables = (tmp_path / "tables.html").read_text(encoding="utf-8")
    assert [name for name in KINDS.keys() - STUDIES.keys() - JOBS.keys() if f"<code>{name}</code>" not in tables] == []


def keys_of(schema: dict[str, Any]) -> set[str]:
    return {key for part in (schema, *schema["$defs"].values()) for key in part.get("properties", {})}


def test_the_readme_and_the_demo_promise_the_same_minutes() -> None:
    assert f"The demo takes {DEMO_TAKES}." in " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())


def test_the_page_of_the_experiment_promises_what_the_command_says() -> None:
    told = (ROOT / "docs" / "experiment.md").read_text(encoding="utf-8")
    small, full = SCALES["small"], SCALES["full"]
    for scale in (small, full, full.resized(5, 5)):
        assert f": about {duration(3600 * scale.hours)}" in told
    assert f"fills about {full.gigabytes:.0f} GB of disk" in " ".join(told.split())


def test_the_security_page_names_tests_that_are_there() -> None:
    page = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
    sources = [path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("test_*.py")]
    tests = set(re.findall(r"^(?:async )?def (test_\w+)", "\n".join(sources), re.MULTILINE))
    named = set(re.findall(r"`(test_\w+)`", page))
    assert len(named) > 70
    assert sorted(named - tests) == []


STATES = ("held", "documented", "absent", "not applicable", "operator", "open")


def test_what_the_security_page_calls_held_has_a_test() -> None:
    page = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| (\d[^|]*) \|[^|]*\| held \|(?!.*`test_).*$", page, re.MULTILINE) == []
    assert set(re.findall(r"^\| \d[^|]*\|[^|]*\| ([^|]*?) \|", page, re.MULTILINE)) == set(STATES)


def test_the_security_page_has_every_requirement_once_and_counts_them() -> None:
    page = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
    states: dict[str, str] = {}
    for listed, state in re.findall(r"^\| (\d[\d., to]*) \|[^|]*\| ([^|]*?) \|", page, re.MULTILINE):
        for part in listed.split(", "):
            first, _, last = part.partition(" to ")
            section, number = first.rsplit(".", 1)
            for each in range(int(number), int((last or first).rsplit(".", 1)[1]) + 1):
                assert states.setdefault(f"{section}.{each}", state) == state
    said = re.search(r"Of (\d+) requirements ([^.]*) are open", page)
    assert said
    counts = Counter(states.values())
    told = [len(states), *(counts[state] for state in STATES)]
    assert [int(number) for number in re.findall(r"\d+", said[0])] == told
    assert told[0] == sum(told[1:]) == 253  # of levels 1 and 2 of ASVS 5.0.0


def test_the_page_of_formats_has_the_table_that_the_code_has() -> None:
    from docs.reference import formats

    assert formats() in (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")


def test_the_page_of_cameras_has_the_table_of_formats_that_the_code_has() -> None:
    from docs.reference import imports

    assert imports() in (ROOT / "docs" / "cameras.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_part_of_a_study_file_that_is_shown_is_taken(page: Path) -> None:
    for block in study_files(page):
        options = tomllib.loads(block).get("options", {})
        texts = [language.get("questions", {}) for language in options.get("texts", {}).values()]
        named = {name: given for questions in texts for name, given in questions.items()}
        asked = [
            {"name": name, "kind": "choice", "text": "?", "options": [str(n) for n, _ in enumerate(given["labels"])]}
            for name, given in named.items()
        ]
        parse_options(options | ({"questions": asked} if asked else {}))


def test_the_pages_show_study_files() -> None:
    assert len([block for page in PAGES for block in study_files(page)]) > 8


def study_files(page: Path) -> list[str]:
    text = page.read_text(encoding="utf-8")
    fenced = re.findall(r"^```toml\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    indented = re.findall(r"(?:^    .*\n|^\n(?=    ))+", text, re.MULTILINE)
    blocks = [*fenced, *(re.sub("^    ", "", block, flags=re.MULTILINE) for block in indented)]
    return [block[block.index("[options") :] for block in blocks if re.search(r"^\[options", block, re.MULTILINE)]


@pytest.mark.parametrize("page", ["models.md", "splats.md"])
def test_every_scene_file_that_is_shown_is_taken(page: str) -> None:
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    usual = {"schema_version": 1, "dataset": "dancer", "fps": 25, "units": "mm", "up": "y"}
    blocks = re.findall(r"^```json\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    assert blocks
    for block in blocks:
        FILES["scene"]().model_validate_json(json.dumps(usual | json.loads(block)))


def test_every_page_stands_in_the_navigation() -> None:
    navigation = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    names = {page.name.lower() for page in PAGES} - {"readme.md"}
    assert {name for name in names if f": {name}" not in navigation} == set()
