"""Read and write a study as a TOML file: all of it but its stimuli, which are in a folder of their own."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from app.study.languages.text import check_text
from app.study.option_fields import ANY_TIME, Options, Setting, SettingError
from app.study.options.options import StudyOptions, parse_options
from app.study.protocols import EXPOSURE_BOUNDS_S
from ground.file_models import schema_name

LONGEST_FILE = 80_000  # characters in a form, which takes 1 MiB and escapes a letter to up to twelve bytes
MOST_PARTS = 32  # of a dotted key, which a study's file has four of; tomllib's time and memory grow with their square
DOTTED = re.compile(rf"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{MOST_PARTS}}}""")


def _options(content: Any) -> StudyOptions:
    if isinstance(content, StudyOptions):
        return content
    if not isinstance(content, Mapping):
        raise ValueError(f"options is {content!r:.120}, expected a table")
    return parse_options(content)


class StudyFile(Options):
    """The content of a study file."""

    name: Annotated[
        str,
        Setting(
            "Name",
            "shown to participants and experimenters",
            ANY_TIME,
            "study",
            expected="the study's name",
            is_basic=True,
        ),
    ]
    stimuli: Annotated[
        str | None,
        Setting("Stimulus set", "its folder, relative to the file; none: named elsewhere", expected="a folder"),
    ] = None
    manifest_sha256: Annotated[
        str | None,
        Setting("Manifest", "SHA-256 of the set's, to check that it is the same", expected="64 hexadecimal digits"),
    ] = None
    exposure_s: Annotated[
        float | None,
        Setting(
            "Seconds a pair or film is shown",
            "empty in a new study: as long as the shortest video",
            section="study",
            is_basic=True,
            expected="seconds from {:g} to {:g}".format(*EXPOSURE_BOUNDS_S),
        ),
    ] = Field(default=None, ge=EXPOSURE_BOUNDS_S[0], le=EXPOSURE_BOUNDS_S[1])
    seed: Annotated[
        int | None,
        Setting("Seed of all orders", "a whole number; empty in a new study: drawn at random", section="study"),
    ] = Field(default=None, ge=0, le=2**63 - 1)
    options: Annotated[StudyOptions, BeforeValidator(_options)] = StudyOptions()


def parse_study_file(text: str) -> StudyFile:
    """Read a study file.

    Raises
    ------
    ValueError
        If it is not TOML, a key is unknown or missing, or a value is invalid: names it.
    """
    content = read_toml(text)
    check_text(content)
    return StudyFile.read(content)


def read_toml(text: str) -> dict[str, Any]:
    """Read TOML that somebody else may have written.

    Raises
    ------
    ValueError
        If it is not TOML, or takes far longer to read than its size explains.
    """
    if deep := DOTTED.search(text):
        line = text.count("\n", 0, deep.start()) + 1
        raise ValueError(
            f"line {line}: more than {MOST_PARTS} words are joined by dots, expected a key of at most four"
        )
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise ValueError("the file holds too many lists within one another") from error


def write_study_file(study: StudyFile) -> str:
    """Write the file that `parse_study_file` reads; options with default values are left out."""
    default = StudyOptions().as_json()
    options = {name: value for name, value in study.options.as_json().items() if value != default[name]}
    questions, texts = options.pop("questions", []), options.pop("texts", {})
    lines = [f"#:schema {schema_name('study')}"]
    lines += [_line(key, value) for key, value in study if key != "options" and value is not None]
    tables = {name: options.pop(name) for name in list(options) if isinstance(options[name], Mapping)}
    if options:
        lines += ["", "[options]", *(_line(name, value) for name, value in options.items())]
    for name, table in tables.items():
        lines += ["", f"[options.{name}]", *(_line(key, value) for key, value in table.items())]
    for language, said in texts.items():
        lines += ["", f"[options.texts.{language}]", *(_line(key, text) for key, text in said.items())]
    for question in questions:
        given = {key: value for key, value in question.items() if value not in (None, [])}
        lines += ["", "[[options.questions]]", *(_line(key, value) for key, value in given.items())]
    return "\n".join(lines) + "\n"


def with_line(text: str, refused: ValueError, said: str = "") -> str:
    """Name the line of a study file where the setting is written that a refusal of `parse_study_file` is about.

    Parameters
    ----------
    text : of the file
    refused : why it was refused
    said : the same in a page's words; default: as it is
    """
    names = refused.field.split(".") if isinstance(refused, SettingError) else []
    for name in reversed(names):
        written = re.compile(rf"\s*(\[+[\w.]*\b{name}[\].]|[\w.\"']*\b{name}\b[\"']?\s*=)")
        number = next((number for number, line in enumerate(text.splitlines(), 1) if written.match(line)), None)
        if number is not None:
            return f"line {number}: {said or refused}"
    return said or str(refused)


def _line(key: str, value: Any) -> str:
    return f"{key} = {_toml(value)}"


def _toml(value: Any) -> str:
    """Write a value; texts, numbers and booleans are the same in TOML and JSON, but for the character DEL."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(_line(key, item) for key, item in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
