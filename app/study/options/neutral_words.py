"""Choose words for films of anything, in place of the standard ones that speak of three-dimensional models."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import Any

from app.study.languages.language_pack import reviewed_languages
from app.study.options.options import StudyOptions
from app.study.options.own_texts import CONSENT, DEBRIEFING
from app.study.protocols import ACR, SHOWN_ALONE
from app.study.questions.answers import is_text_of

SENTENCES = "sentences"


def neutral_words(options: StudyOptions, languages: Sequence[str] | None = None) -> StudyOptions:
    """Return a study's options with neutral words, as own texts that can be edited; texts of its own stay.

    Only languages that the words were written in are changed, and of consents only the presets' sentences.

    Parameters
    ----------
    languages : to be changed; None: those that the study is offered in, which are the reviewed ones where it names none
    """
    words = _words()
    texts = {language: dict(said) for language, said in options.texts.items()}
    offered = languages or options.languages or tuple(dict.fromkeys((*reviewed_languages(), *texts)))
    asked = {question.name for question in options.questions if not question.text}
    for language in offered:
        if language not in words or language == SENTENCES:
            continue
        said = _said(words[language], options.protocol)
        ours = {key: text for key, text in said.items() if is_text_of(key, asked)}
        texts[language] = {**ours, **texts.get(language, {})}
    for by_key in texts.values():
        by_key |= {key: _reworded(str(by_key[key])) for key in (CONSENT, DEBRIEFING) if key in by_key}
    return options.but(texts=texts, consent=_reworded(options.consent), debriefing=_reworded(options.debriefing))


@cache
def _words() -> Mapping[str, Any]:
    text = files("app.study.options.presets").joinpath("neutral.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def _said(words: Mapping[str, Any], protocol: str) -> dict[str, Any]:
    """Return the words of a language in a protocol, by key."""
    name = ACR if protocol in SHOWN_ALONE else protocol
    is_text = {key: text for key, text in words.items() if "." in key}
    return {**is_text, **words.get(name, {})}


def _reworded(document: str) -> str:
    for before, after in _words()[SENTENCES].items():
        document = document.replace(before, after)
    return document
