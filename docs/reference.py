"""Generate pages of the documentation: those at the repository's top, every command, setting and table of results."""

from __future__ import annotations

import dataclasses
import inspect
import json
import re
from collections.abc import Iterator, Sequence
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

if TYPE_CHECKING:
    from app.study.option_fields import Setting

ROOT = Path(__file__).parent.parent
REPOSITORY_PAGES = {
    "index.md": "README.md",
    "contributing.md": "CONTRIBUTING.md",
    "reporting.md": "SECURITY.md",
    "changelog.md": "CHANGELOG.md",
    "third_party.md": "THIRD_PARTY.md",
}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages."""
    pages = {name: repository_page(source) for name, source in REPOSITORY_PAGES.items()}
    for name, content in {**pages, "commands.md": commands(), "settings.md": settings(), "tables.md": tables()}.items():
        files.append(File.generated(config, name, content=content))
    return files


def repository_page(name: str) -> str:
    """Return a page of the repository's top folder, with its links relative to the documentation."""
    text = (ROOT / name).read_text(encoding="utf-8")
    for page, source in REPOSITORY_PAGES.items():
        text = text.replace(f"]({source})", f"]({page})")
    return re.sub(r"\]\(docs/", "](", text).replace("](LICENSE)", "](https://opensource.org/license/mit)")


def commands() -> str:
    """Return every command with its arguments and options, as `--help` prints them."""
    from app.cli import app

    parts = [
        "# Commands",
        "`--help` after any command prints the same. `--json` prints the result as one JSON object on standard output; "
        "everything else goes to standard error. The exit status is 0 on success, 1 on failure, 2 for wrong use.",
    ]
    for name, command in leaves(typer.main.get_command(app), ("reconstudy",)):
        parts += [f"## {name}", _sentence(command.help), _parameters(command)]
    return "\n\n".join(part for part in parts if part) + "\n"


def leaves(command: Any, path: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    """Return every command that does something, with its full name; so may one that has others below it."""
    below = getattr(command, "commands", {})
    command.get_params(typer.Context(command))  # some have all their parameters only once they are asked
    if not below or command.invoke_without_command:
        yield " ".join(path), command
    for name, each in below.items():
        yield from leaves(each, (*path, name))


def _parameters(command: Any) -> str:
    rows = [row for parameter in command.params if (row := _row(parameter)) is not None]
    return _table(("", "", "default"), rows) if rows else ""


def _row(parameter: Any) -> tuple[str, str, str] | None:
    if "--help" in parameter.opts or getattr(parameter, "hidden", False):
        return None
    if parameter.param_type_name == "option":
        names = [*sorted(parameter.opts, key=len, reverse=True), *parameter.secondary_opts]
        shown = " / ".join(f"`{name}`" for name in names)
    else:
        name = (parameter.metavar or parameter.name.upper()).replace("|", " or ")  # a bar would end the table's cell
        shown = f"`{name}{' …' if parameter.nargs == -1 else ''}`"
    default = "required" if parameter.required else _default(parameter.default)
    return shown, _sentence(getattr(parameter, "help", "")), default


def _default(value: Any) -> str:
    if callable(value) or value in (None, False, (), [], {}, "", 0, dataclasses.MISSING):
        return ""
    if isinstance(value, list):  # of an option that may be repeated
        return f"`{' '.join(value)}`"
    if isinstance(value, tuple):  # as TOML writes it
        return f"`{json.dumps(value, ensure_ascii=False)}`"
    return f"`{'yes' if value is True else value}`"


def settings() -> str:
    """Return the server's environment variables, the options of a study and the settings of an analysis."""
    from app.analysis.model.settings import AnalysisSettings
    from app.settings import Settings
    from app.study.option_fields import settings_of
    from app.study.options.options import StudyOptions

    default = StudyOptions().model_dump()
    options = [
        (f"`{setting.name}`", _described_setting(setting), _default(reduce(getitem, setting.name.split("."), default)))
        for setting in settings_of(StudyOptions)
    ]
    prefix = str(Settings.model_config["env_prefix"])
    server = [
        (f"`{prefix}{name.upper()}`", _sentence(field.description), _default(field.default))
        for name, field in Settings.model_fields.items()
    ]
    parts = [
        "# Settings",
        "## Server",
        "Environment variables. Options of the command line override some of them for one run.",
        _table(("variable", "", "default"), server),
        "## Studies",
        "Keys of the options file of `reconstudy study create --options` and of a study file.",
        _table(("key", "", "default"), options),
        "## Analyses",
        "Options of `reconstudy analyse`, and the fields of `app.analysis.AnalysisSettings`.",
        _table(("field", "", "default"), _fields(AnalysisSettings)),
    ]
    return "\n\n".join(parts) + "\n"


def _described_setting(setting: Setting) -> str:
    """Return what an option does, with its choices."""
    choices = "; ".join(f"`{key}` {what}" if key else f"empty: {what}" for key, what in setting.choices.items())
    return f"{setting.label}: {setting.text}{f' ({choices})' if choices else ''}"


def _fields(kind: type[Any]) -> list[tuple[str, str, str]]:
    """Return the fields of a dataclass with their descriptions from its docstring."""
    described = _described(inspect.getdoc(kind) or "")
    return [(f"`{item.name}`", described[item.name], _default(item.default)) for item in dataclasses.fields(kind)]


def tables() -> str:
    """Return the columns of every table of results that analysts fetch."""
    from app.web.analyst.columns import FURTHER, TABLES

    parts = [
        "# Tables of results",
        "The columns of each table of [the REST interface](api.md#tables) and of a study's archive.",
    ]
    for name, columns in TABLES.items():
        every = columns | FURTHER.get(name, {})
        rows = [(f"`{column}`", _sentence(meaning)) for column, meaning in every.items()]
        parts += [f"## {name.replace('_', ' ')}", _table(("column", "is"), rows)]
    return "\n\n".join(parts) + "\n"


TYPE = re.compile(r"(str|bool|int|float|mapping|tuple of \w+|sequence of \w+)(, optional)?")


def _described(docstring: str) -> dict[str, str]:
    """Return name -> sentence of a docstring's parameters, `name, name : type` with indented lines or `name : text`."""
    sentences: dict[str, str] = {}
    names: list[str] = []
    for line in docstring.splitlines():
        match = re.match(r"^([a-z_]+(?:, [a-z_]+)*) : (.*)$", line)
        if match:
            names = match[1].split(", ")
            sentences.update(dict.fromkeys(names, "" if TYPE.fullmatch(match[2]) else match[2]))
        elif names and line.startswith("    "):
            sentences.update({name: f"{sentences[name]} {line.strip()}" for name in names})
    return {name: _sentence(text) for name, text in sentences.items()}


def _sentence(text: str | None) -> str:
    return " ".join((text or "").replace("\b", "").split())


def _table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in lines)
