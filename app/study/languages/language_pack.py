"""Read and check language packs: all texts of the participants' pages in one language, as one JSON file.

The English pack is the model: every other one has the same keys, and the same placeholders in each text.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

from app.files import packaged
from app.study.languages.text import check_text, is_one_line

SHIPPED = "languages"  # folder of the packs that come with the program
MODEL = "en"
HEAD = ("language", "direction", "status")
DIRECTIONS = ("ltr", "rtl")
STATUSES = ("reviewed", "draft")
LONGEST_NAME = 60  # characters of a language's name, which stands on a button
PLURALS = ("zero", "one", "two", "few", "many", "other")  # of Unicode CLDR; each language uses some, always "other"
BY = "by"  # names the placeholder of a plural text whose number chooses the form
TAG = re.compile(r"[a-z]{2,3}(-[A-Za-z0-9]{2,8})*")
PLACEHOLDER = re.compile(r"\{(\w+)\}")
HTML = re.compile(r"<[/!a-zA-Z]|&(#\w+|[a-zA-Z]\w*);")

Text = str | list[str] | dict[str, str]  # a list: several texts in order; a dict: a plural text


class LanguagePackError(ValueError):
    """A language pack that cannot be used."""


@dataclass(frozen=True)
class LanguagePack:
    """All texts in one language.

    Parameters
    ----------
    tag : of the language, as in `<html lang>`: the file's name
    name : of the language, in itself
    direction : in which it is read: left to right, or right to left
    status : a draft has not been reviewed by a native speaker who knows the study
    texts : by key, such as "trial.question"
    """

    tag: str
    name: str
    direction: Literal["ltr", "rtl"]
    status: Literal["reviewed", "draft"]
    texts: Mapping[str, Text]


def read_language_pack(path: Path) -> LanguagePack:
    """Read a pack from its file.

    Raises
    ------
    LanguagePackError
        If the pack has faults: names the first, and how many more there are.
    """
    faults = language_pack_faults(path)
    if faults:
        more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
        raise LanguagePackError(f"{path}: {faults[0]}{more}")
    content = _read_content(path)
    language, direction, status = (content.pop(key) for key in HEAD)
    return LanguagePack(path.stem, language, direction, status, flat_texts(content))


def language_pack_faults(path: Path) -> list[str]:
    """Find everything wrong with a pack's file, each in one sentence; none: the pack can be used."""
    if path.suffix != ".json" or not TAG.fullmatch(path.stem):
        return [f"its name is {path.name!r}, expected the language's tag and .json, such as fr.json or zh-Hant.json"]
    try:
        content = _read_content(path)
    except _TwiceError as error:
        return [str(error)]
    except RecursionError:
        return ["it holds too many lists within one another, expected an object with the texts"]
    except OSError as error:
        return [f"it cannot be read: {error.strerror}"]
    except ValueError as error:
        return [f"it cannot be read as JSON in UTF-8: {error}"]
    try:
        check_text(content)
    except ValueError as error:
        return [str(error)]
    if not isinstance(content, dict):
        return [f"it holds {type(content).__name__}, expected an object with the texts"]
    return [*_head_faults(content), *texts_faults(flat_texts({k: v for k, v in content.items() if k not in HEAD}))]


class _TwiceError(ValueError):
    """A name stands twice in an object, so that one of its texts would be lost."""


def _read_content(path: Path) -> Any:
    """Read JSON in UTF-8, with or without the byte-order mark of some editors."""
    return json.loads(path.read_text(encoding="utf-8-sig"), object_pairs_hook=_object)


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content: dict[str, Any] = {}
    for name, value in pairs:
        if name in content:
            raise _TwiceError(f"{name!r} stands there twice in one object, expected once: one of them would be lost")
        content[name] = value
    return content


def texts_faults(texts: Mapping[str, Any]) -> list[str]:
    """Compare the texts of a pack with the English ones, key by key."""
    model = model_texts()
    missing = [f"{key} is missing; the English text is {_quoted(model[key])}" for key in model if key not in texts]
    unknown = [f"{key} is not known; expected only the keys of the English pack" for key in texts if key not in model]
    known = [fault for key in model if key in texts for fault in text_faults(key, texts[key])]
    return [*missing, *unknown, *known]


def text_faults(key: str, text: Any, *, may_leave_out: bool = False) -> list[str]:
    """Compare a text with the English one.

    Parameters
    ----------
    key : of the text, in the English pack
    text : string, list or plural text
    may_leave_out : may the text leave out placeholders, and be one string where the English one is plural?
    """
    model: Any = model_texts()[key]
    if may_leave_out and isinstance(model, dict) and isinstance(text, str):
        return _string_faults(key, text, model["other"], may_leave_out=True)
    if not isinstance(text, type(model)):
        return [f"{key} is {_kind(text)}, expected {_kind(model)} as in English"]
    if isinstance(model, dict):
        return _plural_faults(key, text, model, may_leave_out=may_leave_out)
    if isinstance(model, list):
        if len(text) != len(model):
            return [f"{key} has {len(text)} texts, expected {len(model)} as in English"]
        pairs = zip(text, model, strict=True)
        return [
            fault
            for number, (part, english) in enumerate(pairs, start=1)
            for fault in _string_faults(f"{key}, text {number},", part, english, may_leave_out=may_leave_out)
        ]
    return _string_faults(key, text, model, may_leave_out=may_leave_out)


def flat_texts(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return nested texts by dotted keys; lists and plural texts stay whole."""
    return dict(_flat(content))


def _flat(content: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in content.items():
        if isinstance(value, Mapping) and not _is_plural(value):
            yield from _flat(value, f"{before}{name}.")
        else:
            yield f"{before}{name}", value


def nested_texts(texts: Mapping[str, Any]) -> dict[str, Any]:
    """Return texts by dotted keys as nested dictionaries; undoes `flat_texts`."""
    nested: dict[str, Any] = {}
    for key, text in texts.items():
        *path, name = key.split(".")
        place = nested
        for part in path:
            place = place.setdefault(part, {})
        place[name] = text
    return nested


@cache
def model_texts() -> Mapping[str, Text]:
    """Return the texts of the English pack, by key."""
    content = json.loads((packaged(SHIPPED) / f"{MODEL}.json").read_text(encoding="utf-8"))
    return flat_texts({key: value for key, value in content.items() if key not in HEAD})


@cache
def reviewed_languages() -> tuple[str, ...]:
    """Return the tags of the packs that come with the program and are reviewed, the English one first."""
    packs = [read_language_pack(path) for path in sorted(packaged(SHIPPED).glob("*.json"))]
    reviewed = [pack.tag for pack in packs if pack.status == "reviewed"]
    return tuple(sorted(reviewed, key=lambda tag: tag != MODEL))


def _is_plural(value: Mapping[str, Any]) -> bool:
    return BY in value or (bool(value) and set(value) <= set(PLURALS))


def _head_faults(content: Mapping[str, Any]) -> Iterator[str]:
    name = content.get("language")
    if not isinstance(name, str) or not _is_name(name):
        yield f"language is {name!r:.60}, expected the language's name in itself, such as Français"
    for key, known in (("direction", DIRECTIONS), ("status", STATUSES)):
        if content.get(key) not in known:
            yield f"{key} is {content.get(key)!r}, expected {' or '.join(known)}"


def _is_name(text: str) -> bool:
    return 0 < len(text.strip()) <= LONGEST_NAME and is_one_line(text) and not HTML.search(text)


def _plural_faults(key: str, text: Mapping[str, Any], model: Mapping[str, str], *, may_leave_out: bool) -> list[str]:
    forms = {name: form for name, form in text.items() if name != BY}
    placeholders = set(PLACEHOLDER.findall(model["other"]))
    if text.get(BY) not in placeholders:
        return [f"{key}: {BY!r} is {text.get(BY)!r}, expected the placeholder that counts: {_listed(placeholders)}"]
    if unknown := sorted(set(forms) - set(PLURALS)):
        return [f"{key}: the plural form {unknown[0]!r} is not known; expected some of {', '.join(PLURALS)}"]
    if "other" not in forms:
        return [f"{key}: the plural form 'other' is missing, which every language needs"]
    return [
        fault
        for name, form in forms.items()
        for fault in _string_faults(
            f"{key}, form {name},", form, model["other"], may_leave_out=may_leave_out or name != "other"
        )
    ]


def _string_faults(what: str, text: Any, english: str, *, may_leave_out: bool) -> list[str]:
    if not isinstance(text, str):
        return [f"{what} is {_kind(text)}, expected a text"]
    if not text.strip():
        return [f"{what} is empty, expected a text"]
    try:
        check_text(text, what)
    except ValueError as error:
        return [str(error)]
    if html := HTML.search(text):
        return [f"{what} has HTML at {text[html.start() :][:20]!r}, expected plain text"]
    given, expected = set(PLACEHOLDER.findall(text)), set(PLACEHOLDER.findall(english))
    if given - expected or (expected - given and not may_leave_out):
        return [f"{what} has the placeholders {_listed(given)}, expected {_listed(expected)}"]
    if stray := re.search(r"[{}]", PLACEHOLDER.sub("", text)):
        return [f"{what} has a stray {stray.group()!r}, expected braces only around placeholders"]
    return []


def _listed(placeholders: set[str]) -> str:
    return ", ".join(f"{{{name}}}" for name in sorted(placeholders)) or "none"


def _quoted(text: Text) -> str:
    return json.dumps(text, ensure_ascii=False)


def _kind(value: Any) -> str:
    kinds: dict[type, str] = {str: "a text", list: "a list of texts", dict: "a plural text"}
    return kinds.get(type(value), f"the value {value!r:.40}")
