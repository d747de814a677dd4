"""Text that no database or file can hold is refused where it enters, and readable where it is stored already."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.study.languages.text import DEEPEST, check_text, storable_content

TEXT = st.text(st.characters(codec="utf-8", exclude_characters="\0"))
CONTENT = st.recursive(TEXT | st.integers() | st.none(), lambda part: st.lists(part) | st.dictionaries(TEXT, part))


@pytest.mark.parametrize(
    ("content", "where"),
    [
        ({"answers": {"reasons": "good \ud800"}}, r"answers\.reasons holds half of a character .* position 6"),
        ({"answers": ["one", "t\0wo"]}, r"answers\.2 holds a NUL character at position 2"),
        ({"na\udfffme": 1}, "a name holds half of a character"),
        ("\0", "the text holds a NUL character at position 1"),
    ],
)
def test_text_that_cannot_be_stored_is_named(content: Any, where: str) -> None:
    with pytest.raises(ValueError, match=where):
        check_text(content)


def test_content_may_be_as_deep_as_said_and_no_deeper() -> None:
    content: Any = "text"
    for _ in range(DEEPEST):
        content = [content]
    check_text(content)
    with pytest.raises(ValueError, match="more than 16 lists within one another"):
        check_text([content])


@pytest.mark.slow
@given(CONTENT)
def test_text_that_can_be_stored_stays_as_it_is(content: Any) -> None:
    assert storable_content(content) == content


@given(st.text(st.characters(exclude_categories=())))
def test_what_was_replaced_can_be_stored(text: str) -> None:
    content = storable_content({text: [text, 1]})
    check_text(content)
    json.dumps(content, ensure_ascii=False).encode()
    assert len(content.popitem()[1][0]) == len(text)
