from __future__ import annotations

from functools import cache
from typing import Any

import pytest

from app.files import packaged
from app.study.languages.language_pack import SHIPPED, LanguagePack, read_language_pack
from app.study.options.options import StudyOptions, parse_options
from app.study.options.wording import (
    changed_languages,
    check_languages,
    offered_languages,
    own_texts,
    refused_languages,
    wording,
)

QUESTION = {"name": "job", "kind": "choice", "options": ["x", "y"], "text": "Your job?", "labels": ["One", "Two"]}
GERMAN_QUESTION = {"questions.job.text": "Ihr Beruf?", "questions.job.labels": ["Eins", "Zwei"]}


@cache
def packs() -> dict[str, LanguagePack]:
    return {path.stem: read_language_pack(path) for path in sorted(packaged(SHIPPED).glob("*.json"))}


def offered(**content: Any) -> list[str]:
    return offered_languages(parse_options(content), packs())


def test_a_study_without_texts_of_its_own_is_offered_in_every_reviewed_language() -> None:
    assert offered() == ["en", "de"]


def test_languages_that_are_named_are_offered_in_that_order_drafts_too() -> None:
    assert offered(languages=["ar", "en"]) == ["ar", "en"]


def test_a_plain_text_counts_in_the_first_language_alone() -> None:
    assert offered(consent="We compare.") == ["en"]
    assert offered(consent="Wir vergleichen.", languages=["de", "en"]) == ["de"]


@pytest.mark.parametrize(
    ("content", "texts"),
    [
        ({"consent": "We compare."}, {"study.consent": "Wir vergleichen."}),
        ({"debriefing": "It was."}, {"study.debriefing": "Es war."}),
        ({"optional_stages": ["interview"], "questions": [QUESTION]}, GERMAN_QUESTION),
        ({"texts": {"en": {"trial": {"question": "Which looks real?"}}}}, {"trial.question": "Was sieht echt aus?"}),
    ],
)
def test_a_study_is_offered_in_a_language_once_it_says_all_its_own_texts_there(
    content: dict[str, Any], texts: dict[str, Any]
) -> None:
    options = parse_options({**content, "languages": ["en", "de"]})
    assert offered_languages(options, packs()) == ["en"]
    assert f"Deutsch lacks the study's own {min(texts)}" in refused_languages(options, packs())["de"]
    own = {**content.get("texts", {}), "de": texts}
    assert offered(**{**content, "languages": ["en", "de"], "texts": own}) == ["en", "de"]


def test_all_texts_of_a_session_come_from_one_language() -> None:
    options = parse_options(
        {
            "languages": ["en", "de"],
            "optional_stages": ["interview"],
            "consent": "We compare.",
            "questions": [QUESTION, {"name": "age", "kind": "number"}],
            "texts": {"de": {"study.consent": "Wir vergleichen.", "study.name": "Tempel", **GERMAN_QUESTION}},
        }
    )
    shown = wording(packs()["de"], options, "Temple").texts
    assert shown["study"] == {"name": "Tempel", "consent": "Wir vergleichen.", "debriefing": "", "images": {}}
    assert shown["questions"]["job"] == {"text": "Ihr Beruf?", "labels": ["Eins", "Zwei"]}
    assert shown["questions"]["age"]["text"] == "Wie alt sind Sie?"
    assert shown["trial"]["question"] == "Welcher ist besser?"


def test_own_texts_stand_in_place_of_those_of_the_studys_protocol() -> None:
    content = {"protocol": "ACR", "texts": {"en": {"trial": {"question": "How real was it?"}}}}
    shown = wording(packs()["en"], parse_options(content), "Name").texts
    assert shown["trial"]["question"] == "How real was it?"
    assert shown["trial"]["label"] == "Film {number} of {total}"
    with pytest.raises(ValueError, match=r"'protocols\.ACR\.trial\.question' is not known"):
        parse_options({"texts": {"en": {"protocols": {"ACR": {"trial": {"question": "How?"}}}}}})


def test_the_digest_changes_with_every_text() -> None:
    variants: list[dict[str, Any]] = [
        {},
        {"consent": "a"},
        {"debriefing": "a"},
        {"texts": {"en": {"trial.question": "Which?"}}},
        {"texts": {"en": {"study.name": "Another"}}},
        {"optional_stages": ["interview"]},
    ]
    digests = [wording(packs()["en"], parse_options(content), "Name").sha256 for content in variants]
    assert len(set(digests)) == len(variants)
    assert wording(packs()["en"], StudyOptions(), "Name").sha256 == digests[0]


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        ({"languages": "en"}, "expected a list of different tags"),
        ({"languages": ["en", "en"]}, "expected a list of different tags"),
        ({"texts": {"English": {}}}, "'English' is no language's tag"),
        ({"texts": {"en": "Hello"}}, "expected a table of each language"),
        ({"texts": {"en": {"trial": {"qestion": "Which?"}}}}, "'trial.qestion' is not known"),
        ({"texts": {"en": {"trial": {"label": "{n}"}}}}, "trial.label has the placeholders {n}"),
        ({"texts": {"en": {"trial": {"question": "<b>Which?</b>"}}}}, "has HTML"),
        ({"texts": {"en": {"welcome": {"points": ["One."]}}}}, "welcome.points has 1 texts, expected 3"),
        ({"texts": {"en": {"study": {"consent": ""}}}}, "study.consent: expected a text of 1 to 20000"),
        ({"texts": {"en": {"questions": {"job": {"text": "x"}}}}}, "of a question that the study asks"),
        ({"questions": [QUESTION], "texts": {"de": {"questions.job.labels": ["1"]}}}, "labels for its options"),
        ({"consent": "a", "texts": {"en": {"study.consent": "b"}}}, "consent differ; leave one out"),
    ],
)
def test_a_wrong_own_text_is_named(content: dict[str, Any], fault: str) -> None:
    with pytest.raises(ValueError) as refusal:
        parse_options(content)
    assert fault in str(refusal.value)


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        ({"languages": ["xx"]}, "there is no language pack 'xx'; expected some of ar, de"),
        ({"languages": ["de"], "texts": {"en": {"study.consent": "Yes"}}}, "complete in no language: Deutsch lacks"),
    ],
)
def test_a_study_that_nobody_could_read_is_refused(content: dict[str, Any], fault: str) -> None:
    with pytest.raises(ValueError) as refusal:
        check_languages(parse_options(content), packs())
    assert fault in str(refusal.value)


def test_every_text_stays_in_its_language_when_another_becomes_the_first() -> None:
    content = {"languages": ["en", "de"], "consent": "We compare.", "debriefing": "It was.", "questions": [QUESTION]}
    german = {"study.consent": "Wir vergleichen.", "study.debriefing": "Es war.", **GERMAN_QUESTION}
    before = parse_options({**content, "texts": {"de": german}})
    after = parse_options({**before.as_json(), **changed_languages(before, ["de", "en"])})
    assert after.consent == "Wir vergleichen."
    assert [own_texts(after, tag) for tag in ("en", "de")] == [own_texts(before, tag) for tag in ("en", "de")]


def test_a_language_without_a_questions_text_cannot_become_the_first() -> None:
    options = parse_options({"questions": [QUESTION]})
    with pytest.raises(ValueError, match=r"questions\.job\.text is missing in de"):
        changed_languages(options, ["de", "en"])
