"""Kinds of wrong sentences, told by their words."""

from __future__ import annotations

import html
import re

MANY = (
    "answers|are|checks|columns|comparisons|conditions|datasets|differ|films|frames|grades|items|jobs|measures|pairs|"
    "participants|people|points|ratings|rows|scenes|sets|studies|switches|times|trials|triads|videos|votes|were"
)
OF_ONE = re.compile(
    rf"(?<![\d.,−-] )(?<![\d.,])\b1 (?!million )(?:[a-z]+ )?(?:{MANY})\b"
    r"|\b1 of \d+ (?:\w+ (?:\(\d+ %\) )?are|differ)\b"
)
OF_PROGRAMS = re.compile(r"(?<![\w-])--[a-z]|\b(?:None|True(?! difference)|False|nan|undefined)\b|\[object|Traceback")


def words_of(page: str) -> str:
    """Return what a page says, its titles and labels too, without code and drawings."""
    text = re.sub(r"(?s)<(script|style|svg|pre|code|textarea)\b.*?</\1>", "", page)
    text = re.sub(r'(?:aria-label|title|alt)="([^"]*)"[^>]*>', r"> \1 <", text)
    text = re.sub(r"</?(?:strong|em|a|span)\b[^>]*>", "", text)
    return re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]*>", " | ", text)))
