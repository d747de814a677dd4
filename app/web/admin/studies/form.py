"""Show and read the form of a study, new or not; its fields follow from the table of settings."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

from fastapi import Depends, Request
from starlette.datastructures import FormData

from app.errors import InvalidError, said_on_page
from app.operations.studies.drafts import options_of
from app.study.option_fields import Setting, SettingError
from app.study.options.option_table import COLUMNS, SECTION_NOTES, SECTIONS, SETTINGS, SETTINGS_BY_NAME, why_fixed
from app.study.options.options import parse_options
from app.study.options.own_texts import LONGEST_TEXT
from app.study.options.practice import MOST_PRACTICE
from app.study.options.study_file import StudyFile
from app.study.protocols import typed_scale
from app.study.questions.questionnaire import KINDS, MOST_QUESTIONS
from app.web.admin.layout import unix
from app.web.gates import takes_any_field
from app.web.problems import RefusedForm

MARK = "field"  # names a field that a browser leaves out where nothing is chosen
QUESTION_PARTS = ("name", "kind", "text", "options", "labels", "minimum", "maximum", "required")
FILMS_PARTS = ("dataset", "a", "b")
PARTS = {"questions": QUESTION_PARTS, "practice_pairs": FILMS_PARTS}
WAS = "was"  # names the field that says what the settings were when the page was opened
WAY, ANSWERS = "way", "answer."  # where people take part, and what begins the names of answers of a platform
IN_EVERY_FORM = ("form_token", "revision", "stimulus_set", "preset", "platform", WAY, MARK, WAS)
LONGEST = {"name": 200, "consent_version": 200, "outside.keep": 500}  # characters in a field; of others as declared
LONGEST_TYPED = 1000  # where nothing is declared


@dataclass(frozen=True)
class StudyForm:
    """The form as a page shows it.

    Parameters
    ----------
    values : of the settings, by name
    fixed : why a setting cannot change now, by name
    datasets, conditions : names to choose from; empty: not known, to be typed
    clashes : label, typed value and present value of settings that somebody else has changed meanwhile, too
    others : labels of those that somebody else alone has changed, which are shown as they are now
    was : what the settings were when the page was opened, as `digests_of` returns it
    """

    values: Mapping[str, Any]
    fixed: Mapping[str, str] = field(default_factory=dict)
    datasets: Sequence[str] = ()
    conditions: Sequence[str] = ()
    clashes: Sequence[tuple[str, str, str]] = ()
    others: Sequence[str] = ()
    was: str = ""

    kinds = KINDS
    longest_text = LONGEST_TEXT

    @property
    def basic(self) -> list[Setting]:
        """The settings that come first."""
        return [setting for setting in SETTINGS if setting.is_basic]

    @property
    def sections(self) -> dict[str, tuple[str, str, list[Setting]]]:
        """Title, note and further settings of each section, by its key."""
        return {
            key: (title, SECTION_NOTES.get(key, ""), settings)
            for key, title in SECTIONS.items()
            if (settings := [each for each in SETTINGS if each.section == key and not each.is_basic])
        }

    def reasons(self, settings: Sequence[Setting]) -> dict[str, list[str]]:
        """Labels of the settings that cannot change, by the reason."""
        reasons: dict[str, list[str]] = {}
        for setting in settings:
            if reason := self.fixed.get(setting.name):
                reasons.setdefault(reason, []).append(setting.label)
        return reasons

    def longest(self, setting: Setting) -> int:
        """Most characters of a text."""
        return LONGEST.get(setting.name, setting.longest or LONGEST_TYPED)

    def rows(self, name: str) -> list[Mapping[str, Any]]:
        """Rows of a list of tables, and an empty one to add."""
        most = {"questions": MOST_QUESTIONS, "practice_pairs": MOST_PRACTICE}[name]
        rows = list(self.values.get(name) or ())
        return [*rows, {}] if len(rows) < most else rows

    def options(self, setting: Setting) -> list[str]:
        """Names to choose from: the set's, and what is chosen although the set lacks it."""
        value = self.values.get(setting.name) or ()
        chosen = [value] if isinstance(value, str) else list(value)
        known = self.datasets if setting.kind == "dataset" else self.conditions
        return list(dict.fromkeys([*known, *chosen]))


def in_words(error: ValueError) -> str:
    """Return a refusal in the form's words: the label in place of the setting's name."""
    field = error.field if isinstance(error, SettingError) else ""
    known = field in SETTINGS_BY_NAME
    return (
        error.called(SETTINGS_BY_NAME[field].label)
        if isinstance(error, SettingError) and known
        else said_on_page(error)
    )


def refuse(request: Request, error: ValueError) -> None:
    """Let the form's page, which is filled already, say why what was typed was refused."""
    sentence = f"Nothing was changed: {in_words(error).removesuffix('.')}."
    request.state.refused = RefusedForm(request.url.path, sentence, str(getattr(error, "field", "")))


@dataclass(frozen=True)
class Merged:
    """What somebody typed into a page, and what somebody else has saved meanwhile, by name.

    Parameters
    ----------
    values : as typed where it was typed, else as saved
    clashes, others : as of StudyForm
    """

    values: Mapping[str, Any]
    clashes: Sequence[tuple[str, str, str]]
    others: Sequence[str]


def digests_of(values: Mapping[str, Any]) -> str:
    """Return a short digest of each value, as JSON: enough to tell later which were changed."""
    return json.dumps({name: _digest(value) for name, value in values.items()}, separators=(",", ":"))


def changed_since(was: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values that were changed since a page was opened; all of them where its digests are not known."""
    before = digests_in(was)
    return {name: value for name, value in given.items() if _digest(value) != before.get(name)}


def merged(was: str, given: Mapping[str, Any], now: Mapping[str, Any], labels: Mapping[str, str]) -> Merged:
    """Keep what somebody typed although somebody else has saved something meanwhile.

    Parameters
    ----------
    was : the digests of the page that was typed into; empty: not known, so that every difference is a clash
    given : as it was typed
    now : all values as they are saved now
    labels : how the page calls each that it shows
    """
    before = digests_in(was)
    values, clashes, others = dict(now), [], []
    for name, label in labels.items():
        if name not in given or _digest(given[name]) == _digest(now.get(name)):
            continue
        typed, present, first = given[name], now.get(name), before.get(name)
        if first is not None and _digest(typed) == first:
            others.append(label)
            continue
        values[name] = typed
        if first is None or _digest(present) != first:
            clashes.append((label, _in_words(typed), _in_words(present)))
    return Merged(values, clashes, others)


def digests_in(was: str) -> dict[str, str]:
    """Read what `digests_of` returns; nothing where it is no such text."""
    try:
        return dict(json.loads(was)) if was else {}
    except (ValueError, TypeError):
        return {}


def _digest(value: Any) -> str:
    """Return a digest of a value; 1 and 1.0 are the same, and so are no text, no number and no list."""
    plain = float(value) if isinstance(value, int) and not isinstance(value, bool) else value or None
    return hashlib.sha256(json.dumps(plain, default=list, sort_keys=True).encode()).hexdigest()[:8]


def _in_words(value: Any) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, list | tuple):
        return ", ".join(map(_in_words, value)) or "none"
    if isinstance(value, Mapping):
        return "; ".join(f"{key} {_in_words(part)}" for key, part in value.items() if part not in (None, ""))
    return "none" if value in (None, "") else str(value)


def fixed_settings(*, has_begun: bool, has_stimuli: bool) -> dict[str, str]:
    """Return why settings cannot change now, by name."""
    reasons = {
        setting.name: why_fixed(setting.change, has_begun=has_begun, has_stimuli=has_stimuli) for setting in SETTINGS
    }
    return {name: reason for name, reason in reasons.items() if reason}


def read_values(fields: FormData) -> dict[str, Any]:
    """Read the settings that a form holds, by name; `study_of` checks them.

    Raises
    ------
    InvalidError
        If it holds a field that is no setting.
    """
    named = {name for name in fields if not name.startswith(ANSWERS)}
    given = {*named, *map(str, fields.getlist(MARK))} - set(IN_EVERY_FORM)
    names = {name if name in SETTINGS_BY_NAME else name.partition(".")[0] for name in given}
    if unknown := sorted(names - SETTINGS_BY_NAME.keys()):
        raise InvalidError(f"The form has the field {unknown[0][:60]!r}, which is no setting of a study.")
    return {setting.name: _value(fields, setting) for setting in SETTINGS if setting.name in names}


def study_of(now: StudyFile, given: Mapping[str, Any]) -> StudyFile:
    """Return a study with what a form gives in place.

    Raises
    ------
    ValueError
        Naming the setting and what is expected.
    """
    columns = {name: given[name] for name in COLUMNS if given.get(name) is not None}
    return now.but(**columns, options=parse_options(options_of(now.options, given)))


def _value(fields: FormData, setting: Setting) -> Any:
    texts = [unix(str(text)) for text in fields.getlist(setting.name)]
    text = texts[-1] if texts else ""
    match setting.kind:
        case "flag":
            return "true" in texts
        case "several" | "conditions":
            return [text for text in texts if text]
        case "whole" | "number":
            return None if not text and setting.may_be_empty else _number(setting.label, text)
        case "window":
            return [_number(setting.label, text) for text in texts if text]
        case "names":
            return text.replace(",", " ").split()
        case "spoken":
            return [line.strip() for line in text.splitlines() if line.strip()]
        case "questions":
            return [_question(row) for row in _rows(fields, setting.name) if row["name"]]
        case "films":
            return [row for row in _rows(fields, setting.name) if any(row.values())]
    return typed_scale(text) if setting.name == "scale" else text


def _number(label: str, text: str) -> int | float:
    try:
        return int(text)
    except ValueError:
        pass
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise InvalidError(f"{label} is {text[:40]!r}, expected a number.")
    return number


def _rows(fields: FormData, name: str) -> Iterator[dict[str, str]]:
    """Read the rows of a list of tables: each part of a row is a field of its own, in the same order."""
    columns = [[unix(str(text)) for text in fields.getlist(f"{name}.{part}")] for part in PARTS[name]]
    if len({len(column) for column in columns}) > 1:
        raise InvalidError(f"The rows of {name} are not complete; load the page again.")
    for row in zip(*columns, strict=True):
        yield dict(zip(PARTS[name], row, strict=True))


def _question(row: Mapping[str, str]) -> dict[str, Any]:
    """Read a question as a study file holds it: what is empty is left out."""
    lists = {part: [line.strip() for line in row[part].splitlines() if line.strip()] for part in ("options", "labels")}
    bounds = {
        part: _number(f"question {row['name']}: {part}", row[part]) for part in ("minimum", "maximum") if row[part]
    }
    content = {"name": row["name"], "kind": row["kind"], "text": row["text"], "required": row["required"] == "true"}
    return {**content, **lists, **bounds}


@takes_any_field
async def _form_fields(request: Request) -> FormData:
    return await request.form()


Fields = Annotated[FormData, Depends(_form_fields)]
