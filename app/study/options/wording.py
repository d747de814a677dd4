"""Compose the texts that a study's participants read in a language: the language's pack with the study's own texts.

A study's own texts are its consent, its debriefing, its questions' wording, and whatever it says in place of the pack's
texts. A study is offered only in languages in which it has all of them, so that no session mixes languages.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from app.study.languages.language_pack import (
    MODEL,
    LanguagePack,
    Text,
    model_texts,
    nested_texts,
)
from app.study.options.options import StudyOptions
from app.study.options.own_texts import CONSENT, DEBRIEFING, NAME
from app.study.protocols import Protocol, texts_of
from app.study.questions.answers import QUESTIONS, AskedQuestion, pack_labels, worded_questions
from app.study.questions.questionnaire import Question

PHONES = "phones"
TOLD_IN_CONSENT = {  # what the presets' consents say, and by which words in their languages
    "screening": ("tests of the eyes", ("how sharply you see", "wie scharf Sie sehen")),
    "practice": ("practice", ("you practise", "Sie üben")),
    "interview": ("questions at the end", ("ask you a few questions", "stellen wir Ihnen einige Fragen")),
    PHONES: ("the need of a computer", ("You need a computer", "Sie brauchen einen Computer")),
}


@dataclass(frozen=True)
class Wording:
    """All texts of a study in one language.

    Parameters
    ----------
    language : of the pack
    texts : nested as in a pack; `study` has name, consent and debriefing, `questions` text and labels of each question
    sha256 : of language and texts, and of the study's images, whose digests are `study.images`
    """

    language: str
    texts: Mapping[str, Any]
    sha256: str


def wording(pack: LanguagePack, options: StudyOptions, name: str, images: Mapping[str, str] | None = None) -> Wording:
    """Compose a study's texts in the language of a pack.

    Parameters
    ----------
    pack : of a language that the study is offered in, see `offered_languages`
    options : the study's
    name : the study's, used where it has none in this language
    images : SHA-256 of the study's images, by name
    """
    said = own_texts(options, pack.tag)
    texts = nested_texts({**protocol_texts(pack, options.protocol), **_of_pack(said)})
    texts["study"] = {
        "name": said.get(NAME, name),
        "consent": said.get(CONSENT, ""),
        "debriefing": said.get(DEBRIEFING, ""),
        "images": dict(images or {}),
    }
    texts[QUESTIONS] = {question.name: _asked(question, pack, said) for question in options.questions}
    return Wording(pack.tag, texts, texts_digest(pack.tag, texts))


def texts_digest(language: str, texts: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a language and the texts of a study in it."""
    content = json.dumps([language, texts], ensure_ascii=False, sort_keys=True)
    return hashlib.sha256(content.encode()).hexdigest()


def protocol_texts(pack: LanguagePack, protocol: Protocol) -> dict[str, Text]:
    """Return a pack's texts for a protocol by key, without the questions of the interview."""
    return {key: text for key, text in texts_of(pack.texts, protocol).items() if key.partition(".")[0] != QUESTIONS}


def _of_pack(said: Mapping[str, Text]) -> dict[str, Text]:
    """Return those of a study's own texts that stand in place of a pack's."""
    return {key: text for key, text in said.items() if key.partition(".")[0] not in (QUESTIONS, "study")}


def own_texts(options: StudyOptions, language: str) -> dict[str, Text]:
    """Return a study's own texts in a language, by key; the plain options count in its first language."""
    plain = _plain_texts(options) if language == first_language(options) else {}
    return {**plain, **options.texts.get(language, {})}


def asked_questions(options: StudyOptions) -> dict[str, AskedQuestion]:
    """Return a study's questions by name, worded for its experimenters: in English, else in its first language."""
    said = {**own_texts(options, first_language(options)), **own_texts(options, MODEL)}
    return worded_questions(options.questions, said)


def consent_in(options: StudyOptions, language: str) -> str:
    """Return the text that a participant agrees to in a language; empty: no consent is asked for."""
    return str(own_texts(options, language).get(CONSENT, ""))


def beyond_the_study(options: StudyOptions) -> str:
    """Return a sentence if a preset's consent tells, in any language, of what the study leaves out; else nothing."""
    consents = [consent_in(options, language) for language in {first_language(options), *options.texts}]
    told = [
        what
        for stage, (what, phrases) in TOLD_IN_CONSENT.items()
        if (options.phones if stage == PHONES else stage not in options.optional_stages)
        and any(phrase in consent for phrase in phrases for consent in consents)
    ]
    return f"the consent speaks of {', '.join(told)}, which this study does not have; change it" if told else ""


def first_language(options: StudyOptions) -> str:
    """Return the language of the study's plain texts: the first it names, else English."""
    return options.languages[0] if options.languages else MODEL


def missing_texts(options: StudyOptions, language: str) -> list[str]:
    """Return the keys of a study's own texts that it lacks in a language, in order.

    Whatever the study says itself in one language, it must say in every language that it is offered in.
    """
    said = {first_language(options): None, **dict.fromkeys(options.texts)}
    needed = {key for tag in said for key in own_texts(options, tag)} - {NAME}
    return sorted(needed - set(own_texts(options, language)))


def offered_languages(options: StudyOptions, packs: Mapping[str, LanguagePack]) -> list[str]:
    """Return the languages in which a participant can take a study; the first is its main one.

    Without the option `languages`, they are all reviewed ones, and those of the study's own texts.
    """
    return [tag for tag, refusal in refused_languages(options, packs).items() if not refusal]


def refused_languages(options: StudyOptions, packs: Mapping[str, LanguagePack]) -> dict[str, str]:
    """Return why a study is not offered in each of its languages, in one sentence; empty: it is offered."""
    reviewed = [tag for tag, pack in packs.items() if pack.status == "reviewed"]
    named = options.languages or tuple(dict.fromkeys([first_language(options), *reviewed, *options.texts]))
    return {tag: _refusal(options, packs, tag) for tag in named}


def check_languages(options: StudyOptions, packs: Mapping[str, LanguagePack]) -> None:
    """Check that a study can be taken in some language, and names no language without a pack.

    Raises
    ------
    ValueError
        Naming the language and what it lacks.
    """
    if unknown := [tag for tag in (*options.languages, *options.texts) if tag not in packs]:
        raise ValueError(f"there is no language pack {unknown[0]!r}; expected some of {', '.join(packs)}")
    if not offered_languages(options, packs):
        raise ValueError(
            f"the study is complete in no language: {'; '.join(refused_languages(options, packs).values())}"
        )


def changed_languages(options: StudyOptions, languages: Sequence[str]) -> dict[str, Any]:
    """Return the options that change with `languages`; every text stays in its language.

    Raises
    ------
    ValueError
        If the new first language lacks a question's text, which the study cannot do without.
    """
    before, after = first_language(options), languages[0] if languages else MODEL
    changes: dict[str, Any] = {"languages": list(languages)}
    if before == after:
        return changes
    texts = {**options.texts, before: own_texts(options, before)}
    first = dict(texts.get(after, {}))
    questions = []
    for question in options.questions:
        parts = [f"{QUESTIONS}.{question.name}.{part}" for part in ("text", "labels")]
        if lacking := [part for part in parts if part in texts[before] and part not in first]:
            raise ValueError(f"{lacking[0]} is missing in {after}, which cannot be the first language without it")
        text, labels = str(first.pop(parts[0], "")), tuple(first.pop(parts[1], ()))
        questions.append(question.but(text=text, labels=labels).as_json())
    return {**changes, "texts": {**texts, after: first}, "consent": "", "debriefing": "", "questions": questions}


def _plain_texts(options: StudyOptions) -> dict[str, Text]:
    texts: dict[str, Text] = {CONSENT: options.consent, DEBRIEFING: options.debriefing}
    for question in options.questions:
        texts[f"{QUESTIONS}.{question.name}.text"] = question.text
        texts[f"{QUESTIONS}.{question.name}.labels"] = list(question.labels) or _bare_options(question)
    return {key: text for key, text in texts.items() if text}


def _bare_options(question: Question) -> list[str]:
    """Return the options of a choice that no pack has labels for; they are shown as they are stored."""
    if question.kind != "choice" or pack_labels(question, model_texts()):
        return []
    return list(question.options)


def _asked(question: Question, pack: LanguagePack, said: Mapping[str, Text]) -> dict[str, Any]:
    before = f"{QUESTIONS}.{question.name}."
    return {
        "text": said.get(f"{before}text") or pack.texts[f"{before}text"],
        "labels": said.get(f"{before}labels") or pack_labels(question, pack.texts),
    }


def _refusal(options: StudyOptions, packs: Mapping[str, LanguagePack], tag: str) -> str:
    if tag not in packs:
        return f"{tag} has no language pack that can be used"
    if missing := missing_texts(options, tag):
        more = f" and {len(missing) - 3} more" if len(missing) > 3 else ""
        return f"{packs[tag].name} lacks the study's own {', '.join(missing[:3])}{more}"
    return ""
