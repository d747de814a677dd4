"""Check that text can be stored in every database and file, and replace what cannot."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from typing import Any

DEEPEST = 16  # lists and objects within one another; what the pages send has five
_UNSTORABLE = re.compile("[\0\ud800-\udfff]")
REPLACEMENT = "\ufffd"
BREAKS = ("Cc", "Zl", "Zp")  # Unicode's categories of control characters, and of ends of lines and paragraphs
TURNS = ("LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI")  # bidirectional classes: turn what follows


def check_text(content: Any, where: str = "", deepest: int = DEEPEST) -> None:
    """Check that JSON content holds only text that can be stored: keys and values, at every depth.

    Parameters
    ----------
    content : text, or JSON content
    where : name of the content in messages; empty: none
    deepest : lists and objects that may lie within one another

    Raises
    ------
    ValueError
        Naming the place of a NUL character, of a lone surrogate (half of a character of UTF-16) or of the depth.
    """
    if isinstance(content, str):
        if (character := _UNSTORABLE.search(content)) is not None:
            what = "a NUL character" if character[0] == "\0" else "half of a character (a lone surrogate)"
            raise ValueError(
                f"{where[:80] or 'the text'} holds {what} at position {character.start() + 1}; type it anew"
            )
    elif isinstance(content, Mapping | list | tuple):
        if deepest == 0:
            raise ValueError(f"{where[:80] or 'the content'} holds more than {DEEPEST} lists within one another")
        if isinstance(content, Mapping):
            for key in content:
                check_text(key, f"a name in {where}" if where else "a name")
        parts = content.items() if isinstance(content, Mapping) else enumerate(content, 1)
        for key, part in parts:
            check_text(part, f"{where}.{key}" if where else str(key), deepest - 1)


def is_one_line(text: str) -> bool:
    """Tell whether a text, in whatever script, has no line breaks and nothing that changes how others are shown."""
    return not any(
        unicodedata.category(letter) in BREAKS or unicodedata.bidirectional(letter) in TURNS for letter in text
    )


def storable(text: str) -> str:
    """Replace each NUL character and each lone surrogate by U+FFFD."""
    return _UNSTORABLE.sub(REPLACEMENT, text)


def storable_content(content: Any) -> Any:
    """Return JSON content with every text replaced as by `storable`."""
    if isinstance(content, str):
        return storable(content)
    if isinstance(content, Mapping):
        return {storable(key): storable_content(part) for key, part in content.items()}
    if isinstance(content, list):
        return [storable_content(part) for part in content]
    return content
