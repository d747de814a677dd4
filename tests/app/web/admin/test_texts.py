"""An experimenter edits a study's texts in each language."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import httpx

from app.operations import manage
from app.settings import Settings
from app.study.options import StudyOptions
from app.study.study_file import parse_study_file
from tests.app.web.admin.dashboard_client import Dashboard

NewStudy = Callable[[], dict[str, Any]]


def save(dashboard: Dashboard, base: str, language: str, texts: dict[str, str]) -> httpx.Response:
    revision = re.findall(r'name="revision" value="(\d+)"', dashboard.get(f"{base}/edit").text)[0]
    fields = {"revision": revision, "language": language, "key": list(texts), "own": list(texts.values())}
    return dashboard.act(f"{base}/texts", **fields)


def options_of(settings: Settings, slug: str) -> StudyOptions:
    return parse_study_file(manage.export_study(settings, slug)).options


def test_texts_are_saved_by_language_and_previewed(
    experimenter: Dashboard, settings: Settings, new_study: NewStudy
) -> None:
    slug = new_study()["slug"]
    base = f"/admin/studies/{slug}"
    english = {"study.consent": "One.\r\n\r\n- *two*", "trial.question": "Which looks real?", "welcome.heading": ""}
    page = save(experimenter, base, "en", english).text
    assert "<li><em>two</em></li>" in page
    assert "not offered</strong>, because Deutsch lacks the study&#39;s own study.consent, trial.question" in page
    german = {
        "study.consent": "Eins.",
        "trial.question": "Was sieht echt aus?",
        "welcome.points": "Eins\r\nZwei\r\nDrei",
        "instructions.see.body": "one: Ein Paar\r\nother: {total} Paare",
    }
    save(experimenter, base, "de", german)
    options = options_of(settings, slug)
    assert options.consent == "One.\n\n- *two*"
    assert options.texts == {
        "en": {"trial.question": "Which looks real?"},
        "de": {
            "study.consent": "Eins.",
            "trial.question": "Was sieht echt aus?",
            "welcome.points": ["Eins", "Zwei", "Drei"],
            "instructions.see.body": {"by": "total", "one": "Ein Paar", "other": "{total} Paare"},
        },
    }
    shown = experimenter.get(f"{base}/texts", params={"language": "de"}).text
    assert "Eins\nZwei\nDrei</textarea>" in shown
    assert "one: Ein Paar\nother: {total} Paare</textarea>" in shown


def test_a_text_with_an_unknown_placeholder_is_refused(experimenter: Dashboard, new_study: NewStudy) -> None:
    refused = save(experimenter, f"/admin/studies/{new_study()['slug']}", "en", {"trial.label": "Pair {n}"})
    assert refused.status_code == 422
    assert "trial.label has the placeholders {n}" in refused.text


def test_languages_are_chosen_and_drafts_are_marked(
    experimenter: Dashboard, settings: Settings, new_study: NewStudy
) -> None:
    slug = new_study()["slug"]
    page = experimenter.act(f"/admin/studies/{slug}/texts/languages", revision="1", named="ar, en").text
    assert options_of(settings, slug).languages == ("ar", "en")
    assert "draft: not yet reviewed by a native speaker" in page
    refused = experimenter.act(f"/admin/studies/{slug}/texts/languages", revision="2", named="xx")
    assert refused.status_code == 422
    assert "there is no language pack &#39;xx&#39;" in refused.text


def test_texts_are_frozen_once_somebody_has_begun(
    experimenter: Dashboard, client: httpx.Client, settings: Settings, new_study: NewStudy
) -> None:
    study = new_study()
    client.post(f"/api/v1/studies/{study['slug']}/sessions", json={"invitation": study["invitation"]})
    refused = save(experimenter, f"/admin/studies/{study['slug']}", "en", {"trial.question": "Which?"})
    assert refused.status_code == 409
    assert "Participants have begun, so texts cannot change" in refused.text
    assert options_of(settings, study["slug"]).texts == {}
