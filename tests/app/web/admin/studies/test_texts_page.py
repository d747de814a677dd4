"""An experimenter edits a study's texts in each language."""

from __future__ import annotations

import html
import io
import re
import zipfile
from collections.abc import Callable
from typing import Any

import httpx
import pytest

from app.operations.studies import manage
from app.settings import Settings
from app.study.options.options import StudyOptions
from app.study.options.study_file import parse_study_file
from app.study.trial.image import LARGEST_IMAGE
from tests.app.web.admin.dashboard_client import Dashboard

PNG = b"\x89PNG\r\n\x1a\n" + bytes(8)
KEY = r'<th scope="row"><code>([^<]+)</code>'
SAID = r'<textarea class="field" name="said" rows="2"[^>]*>\n(.*?)</textarea>'
NewStudy = Callable[[], dict[str, Any]]


def save(dashboard: Dashboard, base: str, language: str, texts: dict[str, str]) -> httpx.Response:
    revision = re.findall(r'name="revision" value="(\d+)"', dashboard.get(f"{base}/edit").text)[0]
    fields = {"revision": revision, "language": language, "key": list(texts), "said": list(texts.values())}
    return dashboard.act(f"{base}/texts", **fields)


def options_of(settings: Settings, slug: str) -> StudyOptions:
    return parse_study_file(manage.export_study(settings, slug)).options


@pytest.mark.slow
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


@pytest.mark.slow
def test_texts_that_two_people_type_at_once_are_kept_beside_what_the_other_has_saved(
    experimenter: Dashboard, settings: Settings, new_study: NewStudy
) -> None:
    base = f"/admin/studies/{new_study()['slug']}"
    opened = experimenter.get(f"{base}/texts").text
    fields = {name: re.findall(rf'name="{name}" value="([^"]*)"', opened)[-1] for name in ("revision", "was")}
    theirs = {"trial.question": "Theirs?", "thanks.heading": "Theirs too"}
    mine = {"trial.question": "Mine?", "welcome.heading": "Only mine", "thanks.heading": ""}
    save(experimenter, base, "en", theirs)
    typed = {"language": "en", "key": list(mine), "said": list(mine.values()), "was": html.unescape(fields["was"])}
    refused = experimenter.act(f"{base}/texts", revision=fields["revision"], **typed)
    assert refused.status_code == 409
    clash = re.search(r"<tbody>(<tr><th scope=.row.>trial.question.*?)</tbody>", refused.text)
    assert clash
    assert re.findall(r">([^<>]+)<", clash[1]) == ["trial.question", "Mine?", "Theirs?"]
    assert "taken over: thanks.heading" in refused.text
    shown = dict(zip(*(re.findall(found, refused.text, re.DOTALL) for found in (KEY, SAID)), strict=True))
    assert {shown[key] for key in theirs | mine} == {"Mine?", "Only mine", "Theirs too"}
    save(experimenter, base, "en", {key: shown[key] for key in theirs | mine})
    assert options_of(settings, base.rpartition("/")[2]).texts["en"] == {
        "trial.question": "Mine?",
        "welcome.heading": "Only mine",
        "thanks.heading": "Theirs too",
    }


@pytest.mark.slow
def test_languages_are_chosen_and_drafts_are_marked(
    experimenter: Dashboard, settings: Settings, new_study: NewStudy
) -> None:
    slug = new_study()["slug"]
    page = experimenter.act(f"/admin/studies/{slug}/texts/languages", revision="1", named="ar, English").text
    assert options_of(settings, slug).languages == ("ar", "en")
    assert "draft: not yet reviewed by a native speaker" in page
    experimenter.headers["Referer"] = str(experimenter.base_url.join(f"/admin/studies/{slug}/texts?saved=1"))
    refused = experimenter.act(f"/admin/studies/{slug}/texts/languages", revision="2", named="en, German")
    del experimenter.headers["Referer"]
    assert refused.status_code == 422
    assert "German is no language here; expected some of ar (العربية), de (Deutsch), en (English)" in refused.text
    assert "Offered in" in refused.text  # on the page that it came from
    assert "Saved." not in refused.text


@pytest.mark.slow
def test_an_image_is_kept_with_the_study_and_shown_in_its_consent(
    experimenter: Dashboard, client: httpx.Client, analyst: httpx.Client, new_study: NewStudy
) -> None:
    study = new_study()
    base = f"/admin/studies/{study['slug']}"
    form = {"form_token": experimenter.form_token}
    upload = f"{base}/texts/images"
    page = experimenter.post(upload, data=form, files={"image": ("room.png", PNG)}).text
    assert "Remove room.png" in page
    save(experimenter, base, "en", {"study.consent": "![The room](room.png)"})
    shown = client.get(study["path"]).text
    address = re.findall(r'<img src="(/images/[0-9a-f]{64})" alt="The room">', shown)[0]
    image = client.get(address)
    assert (image.content, image.headers["content-type"]) == (PNG, "image/png")
    with zipfile.ZipFile(io.BytesIO(analyst.get(f"/api/v1/studies/{study['slug']}/archive.zip").content)) as archive:
        assert archive.read(f"{study['slug']}/images/room.png") == PNG
    copy = experimenter.act(f"{base}/duplicate", name=f"Copy of {study['slug']}").url.path
    assert "Remove room.png" in experimenter.get(f"{copy}/texts").text
    assert "Remove room.png" not in experimenter.act(f"{upload}/room.png/remove").text


@pytest.mark.parametrize(
    ("name", "content", "fault"),
    [
        ("a room.png", PNG, "the image&#39;s name is &#39;a room.png&#39;"),
        ("room.svg", b"<svg onload='x'/>", "room.svg is no image that browsers show, expected PNG"),
        ("room.png", PNG + bytes(LARGEST_IMAGE), "expected at most 1048576"),
    ],
)
def test_what_is_no_image_is_refused(
    experimenter: Dashboard, new_study: NewStudy, name: str, content: bytes, fault: str
) -> None:
    path = f"/admin/studies/{new_study()['slug']}/texts/images"
    answer = experimenter.post(path, data={"form_token": experimenter.form_token}, files={"image": (name, content)})
    assert answer.status_code == 422
    assert fault in answer.text


def test_texts_are_frozen_once_somebody_has_begun(
    experimenter: Dashboard, client: httpx.Client, settings: Settings, new_study: NewStudy
) -> None:
    study = new_study()
    client.post(f"/api/v1/studies/{study['slug']}/sessions", json={"invitation": study["invitation"]})
    refused = save(experimenter, f"/admin/studies/{study['slug']}", "en", {"trial.question": "Which?"})
    assert refused.status_code == 409
    assert "texts cannot change, because participants have begun" in refused.text
    assert options_of(settings, study["slug"]).texts == {}
