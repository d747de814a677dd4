"""Read and write a study as a TOML file: all of it but its stimuli, which are in a folder of their own."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from app.study.languages.text import check_text
from app.study.options.options import StudyOptions, parse_options

KEYS = ("name", "stimuli", "manifest_sha256", "exposure_s", "seed", "options")
EXPOSURE_BOUNDS_S = (0.1, 3600.0)
HIGHEST_SEED = 2**63 - 1
LONGEST_FILE = 80_000  # characters in a form, which takes 1 MiB and escapes a letter to up to twelve bytes


@dataclass(frozen=True)
class StudyFile:
    """The content of a study file.

    Parameters
    ----------
    name : shown to participants and experimenters
    stimuli : the stimulus set's folder, relative to the file; None: named elsewhere
    manifest_sha256 : of the set's manifest, to check that it is the same set; None: any
    exposure_s : how long a pair is shown; None: as long as the shortest video
    seed : of all orders; None: drawn at random
    options : everything besides the votes

    Raises
    ------
    ValueError
        If exposure or seed is out of bounds.
    """

    name: str
    stimuli: str | None = None
    manifest_sha256: str | None = None
    exposure_s: float | None = None
    seed: int | None = None
    options: StudyOptions = field(default_factory=StudyOptions)

    def __post_init__(self) -> None:
        low_s, high_s = EXPOSURE_BOUNDS_S
        if self.exposure_s is not None and not low_s <= self.exposure_s <= high_s:
            raise ValueError(f"exposure_s is {self.exposure_s!r:.40}, expected {low_s:g} to {high_s:g} seconds")
        if self.seed is not None and not 0 <= self.seed <= HIGHEST_SEED:
            raise ValueError(f"seed is {self.seed!r:.40}, expected a whole number from 0 to 2^63 - 1")


def parse_study_file(text: str) -> StudyFile:
    """Read a study file.

    Raises
    ------
    ValueError
        If it is not TOML, a key is unknown or missing, or a value is invalid: names it.
    """
    try:
        content = tomllib.loads(text)
    except RecursionError as error:
        raise ValueError("the file holds too many lists within one another") from error
    check_text(content)
    if unknown := sorted(set(content) - set(KEYS)):
        raise ValueError(f"{unknown[0]!r} is not known; expected some of {', '.join(KEYS)}")
    if not isinstance(content.get("name"), str):
        raise ValueError(f"name is {content.get('name')!r}, expected the study's name")
    options = content.get("options", {})
    if not isinstance(options, Mapping):
        raise ValueError(f"options is {options!r}, expected a table")
    return StudyFile(
        name=content["name"],
        stimuli=_typed(content, "stimuli", str, "a folder"),
        manifest_sha256=_typed(content, "manifest_sha256", str, "64 hexadecimal digits"),
        exposure_s=_typed(content, "exposure_s", (int, float), "seconds"),
        seed=_typed(content, "seed", int, "a whole number"),
        options=parse_options(options),
    )


def write_study_file(study: StudyFile) -> str:
    """Write the file that `parse_study_file` reads; options with default values are left out."""
    default = StudyOptions().as_json()
    options = {name: value for name, value in study.options.as_json().items() if value != default[name]}
    questions, texts = options.pop("questions", []), options.pop("texts", {})
    lines = [_line(key, getattr(study, key)) for key in KEYS[:-1] if getattr(study, key) is not None]
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


def with_line(text: str, complaint: str) -> str:
    """Name the line of a study file that a complaint of `parse_study_file` is about, where its setting is written.

    Parameters
    ----------
    text : of the file
    complaint : it begins with the names of the setting, such as `screening: distance is`
    """
    lines = text.splitlines()
    for name in reversed(re.findall(r"[a-z_][a-z0-9_]*", re.split(r" is | has |, expected", complaint)[0])):
        written = re.compile(rf"\s*(\[+[\w.]*\b{name}[\].]|[\w.\"']*\b{name}\b[\"']?\s*=)")
        number = next((number for number, line in enumerate(lines, 1) if written.match(line)), None)
        if number is not None:
            return f"line {number}: {complaint}"
    return complaint


def _typed(content: Mapping[str, Any], key: str, kind: Any, expected: str) -> Any:
    value = content.get(key)
    if value is not None and (isinstance(value, bool) or not isinstance(value, kind)):
        raise ValueError(f"{key} is {value!r}, expected {expected}")
    return value


def _line(key: str, value: Any) -> str:
    return f"{key} = {_toml(value)}"


def _toml(value: Any) -> str:
    """Write a value; texts, numbers and booleans are the same in TOML and JSON, but for the character DEL."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(_line(key, item) for key, item in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
