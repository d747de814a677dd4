"""A participant reads one language from the entrance to the debriefing, and what was read is recorded."""

from __future__ import annotations

import hashlib
import html
import io
import json
import re
import zipfile
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

import httpx
import pytest

from app.files import packaged
from app.main import running_server
from app.operations.studies.create import create_study
from app.settings import Settings
from app.store.participants.invitations import Invitation
from app.study.languages.language_pack import PLACEHOLDER, SHIPPED, model_texts
from app.study.options.options import parse_options

BOTH = {
    "languages": ["en", "de"],
    "consent": "We *compare*.\n\n<script>x</script>",
    "debriefing": "It was.",
    "texts": {"de": {"study": {"consent": "Wir vergleichen.", "debriefing": "Es war."}}},
}
NewStudy = Callable[[dict[str, Any]], dict[str, Any]]


@pytest.fixture(scope="module")
def study_with(settings: Settings, stimulus_set: Path) -> NewStudy:
    numbers = count(1)

    def create(content: dict[str, Any]) -> dict[str, Any]:
        name = f"In languages {next(numbers)}"
        return create_study(settings, stimulus_set, name, exposure_s=0.4, options=parse_options(content))

    return create


def begin(client: httpx.Client, study: dict[str, Any], **more: Any) -> httpx.Response:
    body = {"invitation": study["invitation"], **more}
    return client.post(f"/api/v1/studies/{study['slug']}/sessions", json=body)


def language_of(page: str) -> tuple[str, str]:
    found = re.search(r'<html lang="([^"]+)" dir="([^"]+)"', page)
    assert found
    return found[1], found[2]


def digest_on(page: str) -> str:
    return re.findall(r'data-texts-sha256="(\w{64})"', page)[0]


def test_a_study_in_one_language_lets_nobody_choose(client: httpx.Client, study_with: NewStudy) -> None:
    study = study_with({"languages": ["ar"]})
    page = client.get(study["path"], params={"language": "en"}).text
    assert language_of(page) == ("ar", "rtl")
    assert 'class="languages"' not in page


@pytest.mark.slow
def test_a_browser_reads_its_own_language_where_the_study_has_it(client: httpx.Client, study_with: NewStudy) -> None:
    study = study_with({"languages": ["en", "fr"]})
    french = client.get(study["path"], headers={"Accept-Language": "fr-CA,de;q=0.9"}).text
    german = client.get(study["path"], headers={"Accept-Language": "de"}).text
    assert (language_of(french), language_of(german)) == (("fr", "ltr"), ("en", "ltr"))
    assert french.count('hreflang="') == 2


def test_the_consent_is_markdown_in_the_pages_language(client: httpx.Client, study_with: NewStudy) -> None:
    study = study_with(BOTH)
    english = client.get(study["path"], params={"language": "en"}).text
    german = client.get(study["path"], params={"language": "de"}).text
    assert "<p>We <em>compare</em>.</p>\n<p>&lt;script&gt;x&lt;/script&gt;</p>" in english
    assert "<p>Wir vergleichen.</p>" in german
    assert "We <em>compare" not in german


def test_a_session_stays_in_its_language_whatever_is_asked_for_later(
    client: httpx.Client, study_with: NewStudy
) -> None:
    study = study_with(BOTH)
    assert begin(client, study, language="de").json()["language"] == "de"
    page = client.get(study["path"], params={"language": "en"}, headers={"Accept-Language": "en"}).text
    assert language_of(page) == ("de", "ltr")
    assert 'hreflang="' not in page


def test_consent_is_given_to_the_text_in_the_sessions_language(client: httpx.Client, study_with: NewStudy) -> None:
    study = study_with({**BOTH, "consent_version": "1"})
    begin(client, study, language="de")
    asked = client.get("/api/v1/session/asked").json()["consent"]
    assert asked == {"version": "1", "sha256": hashlib.sha256(b"Wir vergleichen.").hexdigest()}
    english = {"version": "1", "sha256": hashlib.sha256(BOTH["consent"].encode()).hexdigest()}
    path = "/api/v1/session/stages/introduction"
    assert client.put(path, json={"data": {"language": "en", "consent": english}}).status_code == 422
    assert client.put(path, json={"data": {"language": "de", "consent": asked}}).status_code == 200


def test_nobody_begins_in_a_language_that_the_study_is_not_offered_in(
    client: httpx.Client, study_with: NewStudy
) -> None:
    refused = begin(client, study_with({"consent": "We compare."}), language="de")
    assert refused.status_code == 422
    assert "not offered in 'de'; expected one of en" in refused.json()["detail"]


def test_nobody_begins_with_other_texts_than_the_page_showed(client: httpx.Client, study_with: NewStudy) -> None:
    study = study_with(BOTH)
    shown = digest_on(client.get(study["path"]).text)
    assert begin(client, study, language="en", texts_sha256="0" * 64).status_code == 412
    assert begin(client, study, language="en", texts_sha256=shown).status_code == 201


@pytest.mark.slow
def test_what_was_read_is_in_the_participants_table_and_the_archive(
    client: httpx.Client, analyst: httpx.Client, study_with: NewStudy
) -> None:
    study = study_with(BOTH)
    shown = digest_on(client.get(study["path"], params={"language": "de"}).text)
    begin(client, study, language="de", texts_sha256=shown)
    begin(client, study)  # a client with texts of its own
    rows = analyst.get(f"/api/v1/studies/{study['slug']}/participants").json()
    assert [(row["language"], row["texts_sha256"]) for row in rows] == [("de", shown), (None, None)]
    content = analyst.get(f"/api/v1/studies/{study['slug']}/archive.zip").content
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        (texts,) = json.loads(archive.read(f"{study['slug']}/texts.json"))
    assert (texts["sha256"], texts["language"]) == (shown, "de")
    assert texts["content"]["study"]["consent"] == "Wir vergleichen."
    again = json.dumps(["de", texts["content"]], ensure_ascii=False, sort_keys=True)
    assert hashlib.sha256(again.encode()).hexdigest() == shown


@pytest.mark.slow
def test_a_pack_in_the_data_folder_is_used_once_it_is_whole(tmp_path: Path, stimulus_set: Path) -> None:
    settings = Settings(data_dir=tmp_path / "server")
    whole = json.loads((packaged(SHIPPED) / "de.json").read_text(encoding="utf-8"))
    settings.languages_dir.mkdir(parents=True)
    for tag, pack in (("it", {**whole, "language": "Italiano"}), ("pl", {"language": "Polski"})):
        (settings.languages_dir / f"{tag}.json").write_text(json.dumps(pack), encoding="utf-8")
    study = create_study(settings, stimulus_set, "A", exposure_s=0.4, options=parse_options({"languages": ["it"]}))
    with pytest.raises(ValueError, match="there is no language pack 'pl'"):
        create_study(settings, stimulus_set, "B", exposure_s=0.4, options=parse_options({"languages": ["pl"]}))
    with running_server(settings) as url:
        assert language_of(httpx.get(url + study["path"], timeout=60).text) == ("it", "ltr")


STAGES = {"optional_stages": ["screening", "practice", "interview"], "comprehension": True, "languages": ["en"]}
TRAINED = {"name": "trained", "kind": "choice", "options": ["yes", "no"]}
EVERYTHING: tuple[dict[str, Any], ...] = (  # between them, the studies show whatever a pack can say
    {"consent": "We compare.", "consent_version": "1", "reference": "id_fa", "spoken_questions": ["Why?"]},
    {"free_exposure": True, "outside": {"id": "pid"}, "privacy": {"keep_days": 9, "contact": "a@b.org"}},
    {"protocol": "ACR", "phones": False},
    {"protocol": "ACR", "scale": "slider", "free_exposure": True},
    {"protocol": "DCR", "reference": "id_fa", "free_exposure": True},
    {"protocol": "DCR", "reference": "id_fa"},
    {"protocol": "CCR", "questions": [{**TRAINED, "required": True}, {"name": "age", "kind": "number"}]},
)


@pytest.mark.slow
def test_every_text_of_a_pack_stands_on_some_page(
    client: httpx.Client, study_with: NewStudy, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Invitation, "is_named", True)
    pages = [client.get("/").text]
    for options in EVERYTHING:
        path = study_with(STAGES | options)["path"]
        pages += [client.get(path, params={"pid": "one"}).text, client.get(f"{path}/privacy").text]
    escaped = html.unescape(" ".join(pages))
    shown = re.sub(r"\\u([0-9a-f]{4})", lambda code: chr(int(code[1], 16)), escaped)  # of texts within JSON

    def is_shown(text: str) -> bool:
        return re.search("[^<>]*?".join(map(re.escape, PLACEHOLDER.split(text)[::2])), shown) is not None

    texts = {key: [text] if isinstance(text, str) else list(text) for key, text in model_texts().items()}
    assert [key for key, parts in texts.items() if not all(map(is_shown, parts))] == []
