from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.files import packaged
from app.study.languages.language_pack import (
    HEAD,
    SHIPPED,
    LanguagePackError,
    flat_texts,
    language_pack_faults,
    model_texts,
    nested_texts,
    read_language_pack,
    texts_faults,
)

ENGLISH = json.loads((packaged(SHIPPED) / "en.json").read_text(encoding="utf-8"))
PACKS = sorted(packaged(SHIPPED).glob("*.json"))
keys = st.sampled_from(sorted(model_texts()))


def english() -> dict[str, Any]:
    return copy.deepcopy(dict(model_texts()))


@pytest.mark.parametrize("path", PACKS, ids=lambda path: path.stem)
def test_every_shipped_pack_is_complete(path: Path) -> None:
    assert language_pack_faults(path) == []


def test_english_and_german_are_reviewed_and_the_others_are_drafts_of_which_arabic_runs_right_to_left() -> None:
    packs = {path.stem: read_language_pack(path) for path in PACKS}
    assert {tag for tag, pack in packs.items() if pack.status == "reviewed"} == {"en", "de"}
    assert set(packs) >= {"fr", "es", "zh", "ar"}
    assert {tag for tag, pack in packs.items() if pack.direction == "rtl"} == {"ar"}


@pytest.mark.parametrize("path", PACKS, ids=lambda path: path.stem)
def test_no_shipped_text_shows_a_participant_technical_words(path: Path) -> None:
    words = json.dumps(list(read_language_pack(path).texts.values()), ensure_ascii=False).lower()
    for word in ("pixel", "h.264", "codec", " hz", "refresh rate", "logmar", "webcodecs", "bildwiederholrate"):
        assert word not in words


def test_texts_are_nested_again_as_they_were() -> None:
    texts = {key: text for key, text in ENGLISH.items() if key not in HEAD}
    assert nested_texts(flat_texts(texts)) == texts


@given(keys)
def test_a_missing_text_is_named_with_the_english_one(key: str) -> None:
    texts = english()
    removed = texts.pop(key)
    (fault,) = texts_faults(texts)
    assert fault == f"{key} is missing; the English text is {json.dumps(removed, ensure_ascii=False)}"


@given(keys)
def test_an_unknown_text_is_named(key: str) -> None:
    (fault,) = texts_faults({**english(), f"{key}.more": "x"})
    assert fault.startswith(f"{key}.more is not known")


@given(
    keys, st.sampled_from(["", " \n", "{nobody}", "<b>bold</b>", "&nbsp;", "a {", 3, None, ["a"] * 99, {"one": "x"}])
)
def test_no_wrong_text_passes(key: str, wrong: Any) -> None:
    """Empty, with an unknown placeholder, HTML or a stray brace, of another type, or a plural text without parts."""
    (fault,) = texts_faults({**english(), key: wrong})
    assert key in fault


@pytest.mark.parametrize(
    ("plural", "fault"),
    [
        ({"other": "{total}"}, "'by' is None, expected the placeholder that counts: {total}"),
        ({"by": "films", "other": "{total}"}, "'by' is 'films', expected the placeholder that counts: {total}"),
        ({"by": "total", "one": "{total}"}, "the plural form 'other' is missing"),
        ({"by": "total", "other": "{total}", "several": "x"}, "the plural form 'several' is not known"),
        ({"by": "total", "other": "many"}, "form other, has the placeholders none, expected {total}"),
        ({"by": "total", "other": "{total}", "one": ""}, "form one, is empty"),
    ],
)
def test_a_wrong_plural_is_named(plural: dict[str, str], fault: str) -> None:
    (given_fault,) = texts_faults({**english(), "instructions.see.body": plural})
    assert fault in given_fault


def test_a_form_for_one_or_two_may_leave_out_the_number() -> None:
    plural = {"by": "total", "one": "A pair.", "two": "Two pairs.", "other": "{total} pairs."}
    assert texts_faults({**english(), "instructions.see.body": plural}) == []


@pytest.mark.parametrize(
    ("name", "content", "fault"),
    [
        ("french.txt", "{}", "its name is 'french.txt', expected the language's tag and .json"),
        ("fr.json", "{", "it cannot be read as JSON"),
        ("fr.json", "[]", "it holds list, expected an object"),
        ("fr.json", json.dumps({**ENGLISH, "direction": "up"}), "direction is 'up', expected ltr or rtl"),
        ("fr.json", json.dumps({**ENGLISH, "status": "done"}), "status is 'done', expected reviewed or draft"),
        ("fr.json", json.dumps({**ENGLISH, "language": ""}), "language is '', expected the language's name"),
        ("fr.json", json.dumps({**ENGLISH, "language": "\ud800"}), "half of a character (a lone surrogate)"),
        ("fr.json", json.dumps({**ENGLISH, "language": "Fran\ncais"}), "expected the language's name"),
        ("fr.json", json.dumps({**ENGLISH, "language": "x" * 10**6}), "expected the language's name"),
        ("fr.json", json.dumps(ENGLISH)[:-1] + ', "language": "Twice"}', "'language' stands there twice"),
        ("fr.json", json.dumps({**ENGLISH, "\ud800": "?"}), "half of a character (a lone surrogate)"),
        ("fr.json", "[" * 100_000, "it holds too many lists within one another"),
    ],
)
def test_a_pack_with_a_fault_is_refused_with_the_reason(tmp_path: Path, name: str, content: str, fault: str) -> None:
    path = tmp_path / name
    path.write_text(content, encoding="utf-8")
    with pytest.raises(LanguagePackError, match=r"french\.txt|fr\.json") as refusal:
        read_language_pack(path)
    assert fault in str(refusal.value)


def test_a_pack_that_an_editor_has_given_a_byte_order_mark_and_its_ends_of_lines_is_read(tmp_path: Path) -> None:
    path = tmp_path / "fr.json"
    path.write_bytes(json.dumps(ENGLISH, indent=1).replace("\n", "\r\n").encode("utf-8-sig"))
    assert read_language_pack(path).texts == model_texts()
