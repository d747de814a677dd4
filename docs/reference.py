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
from typing import TYPE_CHECKING, Any, get_args

import typer
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

if TYPE_CHECKING:
    from pydantic import BaseModel

    from app.study.option_fields import Setting

ROOT = Path(__file__).parent.parent
REPOSITORY_PAGES = {
    "index.md": "README.md",
    "contributing.md": "CONTRIBUTING.md",
    "reporting.md": "SECURITY.md",
    "changelog.md": "CHANGELOG.md",
    "third_party.md": "THIRD_PARTY.md",
}
FILE_TITLES = {
    "capture": "capture.json",
    "scene": "scene.json",
    "manifest": "manifest.json",
    "methods": "The methods file",
}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages."""
    pages = {name: repository_page(source) for name, source in REPOSITORY_PAGES.items()}
    pages |= {
        "commands.md": commands(),
        "settings.md": settings(),
        "files.md": file_keys(),
        "tables.md": tables(),
        "jobs.md": jobs(),
    }
    for name, content in pages.items():
        files.append(File.generated(config, name, content=content))
    return files


def repository_page(name: str) -> str:
    """Return a page of the repository's top folder, with its links relative to the documentation."""
    text = (ROOT / name).read_text(encoding="utf-8")
    for page, source in REPOSITORY_PAGES.items():
        text = text.replace(f"]({source})", f"]({page})")
    return re.sub(r"\]\(docs/", "](", text).replace("](LICENSE)", "](https://opensource.org/license/mit)")


def formats() -> str:
    """Return the table of layouts and programs that `analyse --format` names."""
    from app.analysis.reading.programs import KNOWN

    rows = [f"| `{name}` | {says.replace('|', chr(92) + '|')} |" for name, says in KNOWN.items()]
    return "\n".join(["| `--format` | what is in the file |", "|---|---|", *rows])


def imports() -> str:
    """Return the table of formats that `capture import` takes."""
    from recon.capture.importing.formats import FORMATS
    from recon.cli.commands.recordings import IMPORTED

    rows = [
        (
            f"`{name}`",
            words,
            ", ".join(f"`{file}`" for file in dict.fromkeys(FORMATS[name].files[:3])),
            FORMATS[name].means,
            " ".join(f"`--{option}`" for option in FORMATS[name].takes),
        )
        for name, words in IMPORTED.items()
        if name in FORMATS
    ]
    return _table(("format", "what", "known by", "meaning", "takes"), rows)


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
    from app.study.questions.questionnaire import Question

    default = StudyOptions().model_dump()
    options = [
        (
            f"`{setting.name}`",
            _described_setting(setting),
            _default(reduce(getitem, setting.name.split("."), default)),
            setting.change,
        )
        for setting in settings_of(StudyOptions)
    ]
    questions = [
        (
            f"`{setting.name}`",
            _described_setting(setting),
            "required" if info.is_required() else _default(info.default),
        )
        for setting, info in zip(settings_of(Question), Question.model_fields.values(), strict=True)
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
        "Keys of the options file of `reconstudy study create --options` and of a study file. When they [may "
        "change](studies.md#options): any time, until somebody has begun, or until then and with new films.",
        _table(("key", "", "default", "may change"), options),
        "### Questions",
        "Keys of each table `[[options.questions]]`.",
        _table(("key", "", "default"), questions),
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
    from ground.dataclass_models import described

    words = described(kind)
    return [(f"`{item.name}`", words[item.name], _default(item.default)) for item in dataclasses.fields(kind)]


def tables() -> str:
    """Return the columns of every table of results that analysts fetch, and the tables of an analysis."""
    from app.analysis.report.write import COLUMNS
    from app.analysis.tables import TABLES as ANALYSIS
    from app.web.analyst.columns import FIGURES, FURTHER, OUTSIDE_IDS, SETS, TABLES

    parts = [
        "# Tables of results",
        "The columns of each table of [the REST interface](api.md#tables) and of a study's archive.",
    ]
    for name, columns in {**TABLES, "outside-ids": OUTSIDE_IDS, "figures": FIGURES, "sets": SETS}.items():
        every = columns | FURTHER.get(name, {})
        rows = [(f"`{column}`", _sentence(about.meaning)) for column, about in every.items()]
        parts += [f"## {name.replace('_', ' ')}", _table(("column", "is"), rows)]
    kept = [
        (
            f"`{name}`",
            table.row,
            "; ".join(f"`{column}`: {meaning}" for column, meaning in table.columns.items()),
            f"`{name}.csv`" if name in COLUMNS else "",
        )
        for name, table in ANALYSIS.items()
    ]
    parts += [
        "## Tables of an analysis",
        "In `analysis.json` of [an analysis](analysis.md#tables), with the columns that their names do not explain.",
        _table(("table", "a row for each", "columns", "file"), kept),
    ]
    return "\n\n".join(parts) + "\n"


def jobs() -> str:
    """Return every kind of job with its fields."""
    from app.operations.jobs.kinds import GROUPS

    parts = [
        "# Jobs",
        "The kinds of [jobs](work.md), with their names over REST and the fields of their forms. An empty field takes "
        "the default of the command.",
    ]
    for group, kinds in GROUPS.items():
        parts.append(f"## {group}")
        for kind in kinds:
            rows = [(f"`{field.name}`", f"{field.label}: {field.help}".rstrip(": ")) for field in kind.fields]
            does = f"{kind.help.rstrip('.')}. By `reconstudy {kind.command}`."
            parts += [f"### {kind.title}: `{kind.name}`", does, _table(("field", ""), rows)]
    return "\n\n".join(parts) + "\n"


def file_keys() -> str:
    """Return the keys of every file that users write, but a study's, which stand with the settings."""
    from app.cli.schema import FILES

    parts = [
        "# Files",
        "The keys of the files that you may write or change by hand. What is refused is told with its place, what was "
        "found and what is expected. `reconstudy schema capture` (or `scene`, `manifest`, `methods`, `study`) prints "
        "JSON Schema. Written to `capture.schema.json` beside the file, it lets an editor complete and check it: "
        '`"$schema": "capture.schema.json"` stands in what the program writes, and `#:schema study.schema.json` at '
        "the top of a TOML file.",
    ]
    for name, title in FILE_TITLES.items():
        parts += [f"## {title}", *_model(FILES[name](), set())]
    return "\n\n".join(parts) + "\n"


def _model(model: type[BaseModel], shown: set[str]) -> Iterator[str]:
    """Yield a table of a model's keys, and those of the models in it."""
    from ground.fields import is_model, key_of, taken

    shown.add(model.__name__)
    yield _sentence((inspect.getdoc(model) or "").partition("\n\n")[0])
    rows, below = [], []
    for name, info in model.model_fields.items():
        inner = list(dict.fromkeys(part for part in _inner_kinds(info.annotation) if is_model(part)))
        below += inner
        links = ", ".join(f"[{(title := _title(part))}](#{title.lower().replace(' ', '-')})" for part in inner)
        default = (
            "required" if info.is_required() else "" if inner else _written(info.get_default(call_default_factory=True))
        )
        rows.append((f"`{key_of(name, info)}`", _sentence(info.description), links or taken(info).words, default))
    yield _table(("key", "", "takes", "default"), rows)
    for part in dict.fromkeys(below):
        if part.__name__ not in shown:
            yield f"### {_title(part)}"
            yield from _model(part, shown)


def _title(model: type[BaseModel]) -> str:
    """Return what a model's table is called: its name in words."""
    words = re.findall("[A-Z][a-z]*", model.__name__.removesuffix("Content").removesuffix("Facts"))
    return " ".join(words).capitalize()


def _written(value: Any) -> str:
    """Return a default as a file has it; empty: there is none."""
    return "" if value in (None, "", [], {}) else f"`{json.dumps(value)}`"


def _inner_kinds(kind: Any) -> Iterator[Any]:
    """Yield all types that a type is made of."""
    yield kind
    for part in get_args(kind):
        yield from _inner_kinds(part)


def _sentence(text: str | None) -> str:
    return " ".join((text or "").replace("\b", "").split())


def _table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in lines)
