"""Generate pages of the documentation: those at the repository's top, every command, setting and table of results."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import typer
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from app.web.admin.manual_reference import default_in_words, jobs, markdown_table, one_line, settings, tables

if TYPE_CHECKING:
    from pydantic import BaseModel

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
    pages["index.md"] = f"---\nhide: [toc]\n---\n\n{pages['index.md']}"  # its lines of commands need the room
    pages["CITATION.cff"] = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
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
    return markdown_table(("format", "what", "known by", "meaning", "takes"), rows)


def commands() -> str:
    """Return every command with its arguments and options, as `--help` prints them."""
    from app.cli import app

    parts = [
        "# Commands",
        "`--help` after any command prints the same. `--json` prints the result as one JSON object on standard output; "
        "everything else goes to standard error. The exit status is 0 on success, 1 on failure, 2 for wrong use.",
    ]
    for name, command in leaves(typer.main.get_command(app), ("reconstudy",)):
        parts += [f"## {name}", one_line(command.help), _parameters(command)]
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
    return markdown_table(("", "", "default"), rows) if rows else ""


def _row(parameter: Any) -> tuple[str, str, str] | None:
    if "--help" in parameter.opts or getattr(parameter, "hidden", False):
        return None
    if parameter.param_type_name == "option":
        names = [*sorted(parameter.opts, key=len, reverse=True), *parameter.secondary_opts]
        shown = " / ".join(f"`{name}`" for name in names)
    else:
        name = (parameter.metavar or parameter.name.upper()).replace("|", " or ")  # a bar would end the table's cell
        shown = f"`{name}{' …' if parameter.nargs == -1 else ''}`"
    default = "required" if parameter.required else default_in_words(parameter.default)
    return shown, one_line(getattr(parameter, "help", "")), default


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
    yield one_line((inspect.getdoc(model) or "").partition("\n\n")[0])
    rows, below = [], []
    for name, info in model.model_fields.items():
        inner = list(dict.fromkeys(part for part in _inner_kinds(info.annotation) if is_model(part)))
        below += inner
        links = ", ".join(f"[{(title := _title(part))}](#{title.lower().replace(' ', '-')})" for part in inner)
        default = (
            "required" if info.is_required() else "" if inner else _written(info.get_default(call_default_factory=True))
        )
        rows.append((f"`{key_of(name, info)}`", one_line(info.description), links or taken(info).words, default))
    yield markdown_table(("key", "", "takes", "default"), rows)
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
