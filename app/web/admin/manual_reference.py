"""Write the pages of the manual that follow from the program: every setting, job and table of results, as Markdown."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from functools import reduce
from operator import getitem
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from app.study.option_fields import Setting


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
            default_in_words(reduce(getitem, setting.name.split("."), default)),
            setting.change,
        )
        for setting in settings_of(StudyOptions)
    ]
    questions = [
        (
            f"`{setting.name}`",
            _described_setting(setting),
            "required" if info.is_required() else default_in_words(info.default),
        )
        for setting, info in zip(settings_of(Question), Question.model_fields.values(), strict=True)
    ]
    prefix = str(Settings.model_config["env_prefix"])
    server = [
        (f"`{prefix}{name.upper()}`", one_line(field.description), default_in_words(field.default))
        for name, field in Settings.model_fields.items()
    ]
    parts = [
        "# Settings",
        "## Server",
        "Environment variables. Options of the command line override some of them for one run.",
        markdown_table(("variable", "", "default"), server),
        "## Studies",
        "Keys of the options file of `reconstudy study create --options` and of a study file. When they [may "
        "change](studies.md#options): any time, until somebody has begun, or until then and with new films.",
        markdown_table(("key", "", "default", "may change"), options),
        "### Questions",
        "Keys of each table `[[options.questions]]`.",
        markdown_table(("key", "", "default"), questions),
        "## Analyses",
        "Options of `reconstudy analyse`, and the fields of `app.analysis.AnalysisSettings`.",
        markdown_table(("field", "", "default"), _fields(AnalysisSettings)),
    ]
    return "\n\n".join(parts) + "\n"


def tables() -> str:
    """Return the columns of every table of results that analysts fetch, and the tables of an analysis."""
    from app.analysis.report.write import COLUMNS
    from app.analysis.tables import TABLES as ANALYSIS
    from app.web.analyst.columns import FIGURES, FILES, FURTHER, OUTSIDE_IDS, SETS, TABLES

    parts = [
        "# Tables of results",
        "The columns of each table of [the REST interface](api.md#tables) and of a study's archive.",
    ]
    further = {"outside-ids": OUTSIDE_IDS, "figures": FIGURES, "sets": SETS, "files": FILES}
    for name, columns in {**TABLES, **further}.items():
        every = columns | FURTHER.get(name, {})
        rows = [(f"`{column}`", one_line(about.meaning)) for column, about in every.items()]
        parts += [f"## {name.replace('_', ' ')}", markdown_table(("column", "is"), rows)]
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
        markdown_table(("table", "a row for each", "columns", "file"), kept),
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
            parts += [f"### {kind.title}: `{kind.name}`", does, markdown_table(("field", ""), rows)]
    return "\n\n".join(parts) + "\n"


def _described_setting(setting: Setting) -> str:
    """Return what an option does, with its choices."""
    choices = "; ".join(f"`{key}` {what}" if key else f"empty: {what}" for key, what in setting.choices.items())
    return f"{setting.label}: {setting.text}{f' ({choices})' if choices else ''}"


def _fields(kind: type[Any]) -> list[tuple[str, str, str]]:
    """Return the fields of a dataclass with their descriptions from its docstring."""
    from ground.dataclass_models import described

    words = described(kind)
    return [(f"`{item.name}`", words[item.name], default_in_words(item.default)) for item in dataclasses.fields(kind)]


def default_in_words(value: Any) -> str:
    if callable(value) or value in (None, False, (), [], {}, "", 0, dataclasses.MISSING):
        return ""
    if isinstance(value, list):  # of an option that may be repeated
        return f"`{' '.join(value)}`"
    if isinstance(value, tuple):  # as TOML writes it
        return f"`{json.dumps(value, ensure_ascii=False)}`"
    return f"`{'yes' if value is True else value}`"


def one_line(text: str | None) -> str:
    return " ".join((text or "").replace("\b", "").split())


def markdown_table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in lines)
