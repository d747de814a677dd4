"""An experimenter makes a study, edits and duplicates it, and walks through it as a participant would."""

from __future__ import annotations

import html
import io
import json
import re
import subprocess
import sys
import zipfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any

import httpx
import pytest
from sqlalchemy import Engine, event

from app.operations.studies import create, manage
from app.operations.studies.create import read_options
from app.settings import Settings
from app.simulation.participants import begin, next_trial
from app.store.database.engine import open_database
from app.store.database.keys import new_secret, utc_now
from app.store.participants.invitations import invitation_by_code
from app.store.studies.studies import lock_study
from app.store.trials import admission
from app.study.kinds import PAPER
from app.study.options.options import parse_options
from app.study.options.own_texts import LONGEST_TEXT
from app.study.options.platforms import WAYS
from app.study.options.practice import PracticeFilms
from app.study.options.study_file import LONGEST_FILE, parse_study_file
from app.web.admin.layout import unix
from tests.app.web.admin.dashboard_client import Dashboard, ends, signed_in

SIGNED_IN = """
import sys
from pathlib import Path
import httpx
from app.main import running_server
from app.operations.studies.manage import add_experimenter
from app.settings import Settings

settings = Settings(data_dir=Path(sys.argv[1]), database_url=None)
with running_server(settings) as url, httpx.Client(base_url=url, follow_redirects=True) as client:
    assert "app.analysis" not in sys.modules
    link = add_experimenter(settings, "Ada")["path"]
    client.get(link).raise_for_status()
    client.post(link, data={"form_token": client.cookies["entry"]}).raise_for_status()
sys.exit("app.analysis.report.write" not in sys.modules)  # the server ended once its background tasks were done
"""

CARD = r'<article class="card" aria-labelledby="study-([^"]+)">(.*?)</article>'
LONG_ENOUGH_S = 0.5  # for an edit that does not wait to be made
NewStudy = Callable[[], dict[str, Any]]


@pytest.mark.slow
def test_a_study_is_created_from_a_stimulus_set_and_pauses_until_it_is_opened(own_server: str, own: Settings) -> None:
    with signed_in(own_server, own, "Eva") as eva:
        assert "tiny" in eva.get("/admin/studies/new").text
        fields = {
            "name": "First",
            "stimulus_set": "tiny",
            "optional_stages": "interview",
            "consent": "I agree.\r\n\r\nReally.",
        }
        job = eva.act("/admin/studies/new", **fields)
        page = ends(eva, job.url.path)
        assert page.url.path == "/admin/studies/first"
        code = manage.list_studies(own)[0]["invitations"][0]
        assert eva.get(f"/s/{code}").status_code == 403
        assert "Close to new participants" in eva.act("/admin/studies/first/state", state="open").text
        assert eva.get(f"/s/{code}").status_code == 200
        for name, complaint in (("First", "there is already a study"), ("---", "with a letter or digit")):
            again = eva.act("/admin/studies/new", **{**fields, "name": name})
            assert again.status_code == 422
            assert complaint in again.text
            assert "Really." in again.text  # what was typed is still there


@pytest.mark.slow
def test_a_study_starts_from_a_preset_which_the_form_changes(own_server: str, own: Settings) -> None:
    with signed_in(own_server, own, "Eva") as eva:
        offered = eva.get("/admin/studies/new", params={"stimulus_set": "tiny"}).text
        assert all(f'name="way" value="{name}"' in offered for name in WAYS)
        filled = eva.get("/admin/studies/new", params={"stimulus_set": "tiny", "preset": "paper"}).text
        assert 'value="preset paper 3"' in filled
        refused = eva.act("/admin/studies/new", name="Second", stimulus_set="tiny", preset="papr")
        assert refused.status_code == 422
        assert "expected one of paper, quick, online" in refused.text
        fields = {"stimulus_set": "tiny", "preset": "paper", "consent": "Ours."}
        ends(eva, eva.act("/admin/studies/new", name="Like the paper", **fields).url.path)
        assert "The practice shows id_fa and pm_fb of ball" in eva.get("/admin/studies/like-the-paper").text
    options = parse_study_file(manage.export_study(own, "like-the-paper")).options
    preset = read_options(None, {}, PAPER)
    texts = {"de": {key: text for key, text in preset.texts["de"].items() if key != "study.consent"}}
    lent = (PracticeFilms(dataset="ball", a="id_fa", b="pm_fb"),)
    assert options == preset.but(consent="Ours.", consent_version="", texts=texts, practice_pairs=lent)


@pytest.mark.parametrize("name", ["../tiny", "", "unknown"])
def test_no_path_from_outside_reaches_the_file_system(own_server: str, own: Settings, name: str) -> None:
    with signed_in(own_server, own, "Eva") as eva:
        answer = eva.act("/admin/studies/new", name="Path", stimulus_set=name)
        assert answer.status_code in (404, 422)


@pytest.mark.slow
def test_a_viewer_is_led_to_no_page_that_is_refused(server: str, settings: Settings, taken: dict[str, Any]) -> None:
    base = f"/admin/studies/{taken['slug']}"
    with signed_in(server, settings, "Vera Viewer", "viewer") as vera:
        analysed = vera.get(f"/api/v1/studies/{taken['slug']}/analysis")  # waits for the analysis, as pages do not
        assert analysed.status_code == 200
        seen, left = set(), ["/admin", f"{base}/design?participants=10"]
        while left:
            path = left.pop()
            answer = vera.get(path)
            assert answer.status_code == 200, path
            if "text/html" in answer.headers["content-type"]:
                links = {html.unescape(link).partition("#")[0] for link in re.findall(r'href="(/[^"]+)"', answer.text)}
                here = {link for link in links if base in link or taken["slug"] in link or "studies" not in link}
                left.extend(link for link in here - seen if "figures" not in link)
                seen |= here
    assert f"{base}/results" in seen
    assert f"/api/v1/studies/{taken['slug']}/votes?format=csv" in seen


SAVED = '<p class="hint" role="status">Saved.</p>'
TYPED = "What we wanted to find out, in many words.\r\n\r\nThank you <all>."
SHOWN = TYPED.replace("<all>", "&lt;all&gt;")


@pytest.mark.parametrize(("revision", "status"), [("7", 409), ("none", 422)])
def test_what_was_typed_is_shown_again_where_it_is_not_kept(
    experimenter: Dashboard, new_study: NewStudy, revision: str, status: int
) -> None:
    path = f"/admin/studies/{new_study()['slug']}/edit"
    refused = experimenter.act(path, name="N", revision=revision, debriefing=TYPED)
    assert refused.status_code == status
    assert unix(SHOWN) in unix(refused.text)  # a textarea's lines end as they like
    assert 'aria-label="Dashboard"' in refused.text  # the navigation is still there


def test_the_page_of_a_refused_form_says_why_and_holds_what_was_sent(
    experimenter: Dashboard, new_study: NewStudy
) -> None:
    path = f"/admin/studies/{new_study()['slug']}/invitations"
    page = experimenter.get(path).text
    unseen = dict(re.findall(r'type="hidden" name="(\w+)" value="([^"]*)"', page))
    came_from = {"Referer": f"{experimenter.base_url}{path}"}
    typed = {"form_token": unseen["form_token"], "places": "-3", "number": "2", "label": 'A "new" <name>'}
    refused = experimenter.post(path, data=typed, headers=came_from)
    assert refused.status_code == 422
    refusal = "The form is not as expected: places is '-3', expected a whole number from 1 to 100000."
    assert f">{refusal}<" in html.unescape(refused.text)
    told = refused_form(refused.text)
    assert (told["action"], told["field"]) == (path, "places")
    assert json.loads(told["typed"]) == [["places", "-3"], ["number", "2"], ["label", 'A "new" <name>']]
    assert 'value="A &#34;new&#34; &lt;name&gt;" readonly>' in refused.text  # short, and to be copied all the same
    groups = {**unseen, "groups": "near: nowhere\nfar <2>"}
    refused = experimenter.post(f"{path}/groups", data=groups, headers=came_from)
    assert refused.status_code == 422
    assert ["groups", groups["groups"]] in json.loads(refused_form(refused.text)["typed"])
    assert "near: nowhere\nfar &lt;2&gt;</textarea>" in refused.text  # to be copied where no script runs


def refused_form(page: str) -> dict[str, str]:
    """What a page tells its script of a refused form."""
    (element,) = re.findall('<p class="warning" id="refused"[^>]*>', page)
    told = re.findall(r"""data-(\w+)=(?:"([^"]*)"|'([^']*)')""", element)
    return {name: html.unescape(first or second) for name, first, second in told}


def test_what_was_typed_outlives_the_session(experimenter: Dashboard, new_study: NewStudy) -> None:
    path = f"/admin/studies/{new_study()['slug']}/edit"
    form_token = experimenter.form_token
    experimenter.act("/admin/logout")
    refused = experimenter.post(path, data={"form_token": form_token, "revision": "1", "name": "N", "consent": TYPED})
    assert refused.status_code == 401
    assert SHOWN in refused.text
    assert form_token not in refused.text


def test_a_password_that_is_refused_is_not_shown_again(experimenter: Dashboard) -> None:
    long = "a long password of many words"
    refused = experimenter.act("/admin/account/password", current=long, password=long, again=f"{long} other")
    assert refused.status_code == 422
    assert long not in refused.text


def test_a_form_edits_a_study_and_two_editors_are_told_of_each_other(
    experimenter: Dashboard, new_study: NewStudy
) -> None:
    base = f"/admin/studies/{new_study()['slug']}"
    page = experimenter.get(f"{base}/edit").text
    revision = re.findall(r'name="revision" value="(\d+)"', page)[0]
    fields = {"name": "Renamed", "exposure_s": "1.5", "optional_stages": "interview", "consent": "One.\r\n\r\nTwo."}
    edited = experimenter.act(f"{base}/edit", revision=revision, **fields)
    assert "Renamed" in edited.text
    assert 'value="1.5"' in edited.text
    assert SAVED in edited.text
    assert SAVED not in page
    late = experimenter.act(f"{base}/edit", revision=revision, **fields | {"name": "Overwritten"})
    assert late.status_code == 409
    assert "Somebody else has changed this study" in late.text
    assert "Renamed" in experimenter.get(base).text
    log = experimenter.get("/admin/audit").text
    assert "study edited" in log
    assert "edit refused" in log


def test_two_editors_at_once_lose_nothing_that_they_typed(experimenter: Dashboard, new_study: NewStudy) -> None:
    base = f"/admin/studies/{new_study()['slug']}"
    page = experimenter.get(f"{base}/edit").text
    revision = re.findall(r'name="revision" value="(\d+)"', page)[0]
    was = html.unescape(re.findall(r'name="was" value="([^"]+)"', page)[0])
    first = {"name": "By the first", "exposure_s": "0.4", "break_every": "7"}
    assert SAVED in experimenter.act(f"{base}/edit", revision=revision, was=was, **first).text
    second = {"name": "By the second", "exposure_s": "0.4", "break_every": "25", "consent": "Typed for long."}
    late = experimenter.act(f"{base}/edit", revision=revision, was=was, **second)
    assert late.status_code == 409
    assert re.search("<th[^>]*>Name</th><td[^>]*>By the second</td><td[^>]*>By the first</td>", late.text)
    assert "Break after so many trials" in late.text.partition("taken over: ")[2][:200]
    assert 'name="break_every" step="1" min="0" max="10000" value="7"' in late.text
    assert "Typed for long." in late.text
    revision = re.findall(r'name="revision" value="(\d+)"', late.text)[0]
    again = experimenter.act(f"{base}/edit", revision=revision, **second | {"break_every": "7"})
    assert SAVED in again.text
    assert "By the second" in again.text


@pytest.mark.slow
def test_a_file_that_comes_too_late_is_given_back_beside_what_the_other_saved(
    experimenter: Dashboard, new_study: NewStudy
) -> None:
    base = f"/admin/studies/{new_study()['slug']}"
    page = experimenter.get(f"{base}/edit").text
    was = html.unescape(re.findall(r'name="was" value="([^"]+)"', page)[0])
    first = {"name": "By the first", "exposure_s": "0.4", "break_every": "7"}
    assert SAVED in experimenter.act(f"{base}/edit", revision="1", was=was, **first).text
    text = 'name = "By file"\n[options]\nbreak_every = 25\nconsent = "Typed for long."\n'
    late = experimenter.act(f"{base}/edit/file", revision="1", was=was, text=text)
    assert late.status_code == 409
    assert re.search("<th[^>]*>Name</th><td[^>]*>By file</td><td[^>]*>By the first</td>", late.text)
    assert "Break after so many trials" in late.text.partition("taken over: ")[2][:200]
    assert text.strip() in html.unescape(late.text)


@pytest.mark.slow
def test_a_file_edits_a_study_and_bad_files_change_nothing(experimenter: Dashboard, new_study: NewStudy) -> None:
    base = f"/admin/studies/{new_study()['slug']}"
    good = 'name = "By file"\nexposure_s = 2\n[options]\nbreak_every = 5\n'
    assert "break_every = 5" in experimenter.act(f"{base}/edit/file", revision="1", text=good).text
    unknown = 'name = "x"\nexposure_s = 2\ncolour = "red"'
    for text in ("name = ", unknown, good + "unknown = 1", 'name = ""\nexposure_s=1'):
        refused = experimenter.act(f"{base}/edit/file", revision="2", text=text)
        assert refused.status_code == 422
        assert "Nothing was changed" in refused.text
    assert "By file" in experimenter.get(base).text


@pytest.mark.slow
def test_a_file_that_would_take_gigabytes_to_read_is_refused(experimenter: Dashboard, new_study: NewStudy) -> None:
    base = f"/admin/studies/{new_study()['slug']}"
    refused = experimenter.act(f"{base}/edit/file", revision="1", text="a." * 39_000 + "a = 1")
    assert refused.status_code == 422
    assert "words are joined by dots" in refused.text


@pytest.mark.slow
def test_the_longest_texts_of_a_study_are_taken_in_any_alphabet(experimenter: Dashboard, new_study: NewStudy) -> None:
    letter = "𝄞"
    base = f"/admin/studies/{new_study()['slug']}"
    texts = {"consent": letter * LONGEST_TEXT, "debriefing": letter * LONGEST_TEXT}
    answer = experimenter.act(f"{base}/edit", revision="1", name="Long", consent_version="1", **texts)
    assert answer.status_code == 200
    assert answer.text.count(texts["consent"]) > 1
    assert f'maxlength="{LONGEST_FILE}"' in answer.text
    shortest = 'name = "Long"\nexposure_s = 2\n# '
    commented = shortest + letter * (LONGEST_FILE - len(shortest))
    assert experimenter.act(f"{base}/edit/file", revision="2", text=commented).status_code == 200
    assert experimenter.act(f"{base}/edit/file", revision="3", text=f"{commented}.").status_code == 422


def test_what_participants_see_stays_once_somebody_has_begun(
    experimenter: Dashboard, client: httpx.Client, new_study: NewStudy
) -> None:
    study = new_study()
    begin(client, study["slug"], study["invitation"])
    base = f"/admin/studies/{study['slug']}"
    refused = experimenter.act(f"{base}/edit", revision="1", name="Same", exposure_s="9")
    assert refused.status_code == 409
    assert "Seconds a pair or film is shown (exposure_s) cannot change" in refused.text
    allowed = experimenter.act(f"{base}/edit", revision="1", name="Same", debriefing="Thank you.")
    assert "Thank you." in allowed.text


@pytest.mark.slow
def test_a_lab_sheet_is_noted_at_any_time_and_exported(
    experimenter: Dashboard, client: httpx.Client, new_study: NewStudy, settings: Settings
) -> None:
    study = new_study()
    begin(client, study["slug"], study["invitation"])
    base = f"/admin/studies/{study['slug']}"
    noted = {"display": "ASUS | VG278", "size_inch": "27", "white_point": "5000 K", "distance_cm": ""}
    fields = {f"lab_sheet.{key}": value for key, value in noted.items()}
    page = experimenter.act(f"{base}/edit", revision="1", name="Same", **fields).text
    assert 'name="lab_sheet.size_inch" step="any" min="1" max="500" value="27"' in page
    sheet = {"display": "ASUS | VG278", "size_inch": 27.0, "white_point": "5000 K"}
    assert experimenter.get(f"/api/v1/studies/{study['slug']}").json()["lab_sheet"] == sheet
    assert parse_study_file(manage.export_study(settings, study["slug"])).options.lab_sheet.as_json() == sheet
    with zipfile.ZipFile(
        io.BytesIO(experimenter.get(f"/api/v1/studies/{study['slug']}/archive.zip").content)
    ) as archive:
        dictionary = archive.read(f"{study['slug']}/README.md").decode()
    assert "| Display | ASUS \\| VG278 |\n| Size, inch | 27 |\n" in dictionary
    refused = experimenter.act(f"{base}/edit", revision="2", name="Same", **{"lab_sheet.size_inch": "0"})
    assert refused.status_code == 422
    assert "Size, inch is 0, expected a number from 1 to 500" in refused.text
    endless = experimenter.act(f"{base}/edit", revision="2", name="Same", **{"lab_sheet.size_inch": "1e400"})
    assert endless.status_code == 422
    assert "Size, inch is &#39;1e400&#39;, expected a number" in endless.text


@pytest.mark.slow
def test_an_edit_waits_for_who_begins_at_that_moment(
    experimenter: Dashboard, settings: Settings, new_study: NewStudy
) -> None:
    study = new_study()
    fields = {"form_token": experimenter.form_token, "revision": "1", "name": "Same", "exposure_s": "9"}
    database = open_database(settings.url)
    with ThreadPoolExecutor(1) as pool:
        with database.writing() as connection:
            invitation = invitation_by_code(connection, study["invitation"])
            assert invitation is not None
            begun = lock_study(connection, invitation.study_id)
            admission._admit(connection, begun, invitation, new_secret(), admission.Admission(), utc_now())
            edit = pool.submit(experimenter.post, f"/admin/studies/{study['slug']}/edit", data=fields)
            wait([edit], LONG_ENOUGH_S)
        assert edit.result().status_code == 409
    database.dispose()
    assert "Seconds a pair or film is shown (exposure_s) cannot change" in edit.result().text


@pytest.mark.slow
def test_a_duplicate_has_the_pairs_and_nobody_in_it(
    experimenter: Dashboard, analyst: httpx.Client, taken: dict[str, Any]
) -> None:
    experimenter.act(f"/admin/studies/{taken['slug']}/duplicate", name=f"{taken['name']} twin")
    twin = analyst.get(f"/api/v1/studies/{taken['slug']}-twin").json()
    assert (twin["state"], twin["n_pairs"], twin["n_started"]) == ("paused", 6, 0)
    assert twin["conditions"] == analyst.get(f"/api/v1/studies/{taken['slug']}").json()["conditions"]


def test_studies_are_counted_in_one_query_however_many_there_are(
    experimenter: Dashboard, study: dict[str, Any], taken: dict[str, Any]
) -> None:
    asked: list[str] = []

    def note(_connection: Any, _cursor: Any, statement: str, *_: Any) -> None:
        asked.append(statement)

    event.listen(Engine, "before_cursor_execute", note)
    try:
        page = experimenter.get("/admin").text
    finally:
        event.remove(Engine, "before_cursor_execute", note)
    assert len([statement for statement in asked if "n_votes" in statement]) == 1
    cards = {name: re.findall(r"<dd>(\d+)", card) for name, card in re.findall(CARD, page, re.DOTALL)}
    assert cards[study["slug"]][2:4] == ["6", "3"]
    assert cards[taken["slug"]][:4] == ["4", "24", "6", "3"]


@pytest.mark.slow
def test_a_preview_walks_the_whole_study_and_leaves_no_vote(
    experimenter: Dashboard, analyst: httpx.Client, vote_body: Callable[..., dict[str, Any]], new_study: NewStudy
) -> None:
    study = new_study()
    base = f"/admin/studies/{study['slug']}"
    for _ in range(2):
        page = experimenter.act(f"{base}/preview")
        assert page.url.path.startswith("/s/")
        assert 'data-state="mine"' in page.text
        token = experimenter.cookies["session"]
        bearer = {"Authorization": f"Bearer {token}"}
        with httpx.Client(base_url=experimenter.base_url, headers=bearer) as walker:
            walker.put("/api/v1/session/stages/introduction", json={"data": {}})
            for _ in range(6):
                trial = next_trial(walker, token)
                assert trial is not None
                assert walker.put(f"/api/v1/session/trials/{trial['trial']}/vote", json=vote_body(trial)).is_success
            assert walker.get("/api/v1/session").json()["stage"] == "finished"
    summary = analyst.get(f"/api/v1/studies/{study['slug']}").json()
    assert (summary["n_started"], summary["n_votes"]) == (0, 0)
    assert analyst.get(f"/api/v1/studies/{study['slug']}/votes").json() == []
    assert "Nobody has begun yet" in experimenter.get(base).text
    begun = begin(analyst, study["slug"], study["invitation"])
    assert analyst.get(f"/api/v1/studies/{study['slug']}/trials", params={"session": begun["session"]}).json()
    assert "P001" in experimenter.get(base).text


@pytest.mark.slow
def test_stimuli_are_seen_and_a_damaged_film_is_found(own_server: str, own: Settings, stimulus_set: Path) -> None:
    create.create_study(own, stimulus_set, "Films", exposure_s=0.4)
    with signed_in(own_server, own, "Eva") as eva:
        page = eva.get("/admin/studies/films/stimuli").text
        stills = re.findall(r'src="(/admin/studies/films/stimuli/[^"]+\.jpg)"', page)
        assert len(stills) == 6
        assert eva.get(stills[0]).content.startswith(b"\xff\xd8")
        begun = eva.act("/admin/studies/films/stimuli")
        assert "films were decoded to their last picture" in ends(eva, str(begun.url.path)).text
        films = {path: path.read_bytes() for path in own.media_dir.glob("*.mp4")}
        for damaged, content in films.items():
            damaged.write_bytes(content + b"x")
        begun = eva.act("/admin/studies/films/stimuli")
        assert "not what it was" in ends(eva, str(begun.url.path)).text
        for damaged, content in films.items():
            damaged.write_bytes(content)


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, {"protocol": "ACR"}, {"pair_films": "decoded"}], ids=str)
def test_two_films_in_one_are_told_of_only_where_there_are(
    own_server: str, own: Settings, stimulus_set: Path, options: dict[str, Any]
) -> None:
    name = f"Films of {len(str(options))}"
    slug = create.create_study(own, stimulus_set, name, exposure_s=0.4, options=parse_options(options))["slug"]
    with signed_in(own_server, own, "Eva") as eva:
        ends(eva, str(eva.act(f"/admin/studies/{slug}/stimuli").url.path))
        page = eva.get(f"/admin/studies/{slug}/stimuli").text
        assert ("Both halves of a pair" in page, "Films of pairs" in page) == (not options, not options)


@pytest.mark.slow
@pytest.mark.slow
def test_the_design_calls_no_orders_as_planned_before_anybody_has_begun(
    experimenter: Dashboard, new_study: NewStudy
) -> None:
    page = experimenter.get(f"/admin/studies/{new_study()['slug']}/design").text
    assert "nobody has begun" in page
    assert "as planned" not in page


def test_the_design_tells_balance_duration_and_power(experimenter: Dashboard, taken: dict[str, Any]) -> None:
    page = experimenter.design(f"/admin/studies/{taken['slug']}/design", participants=6, effect=1)
    assert "as planned" in page
    assert re.search(r"detected in \d+ % of studies on\s+one dataset", page)
    assert experimenter.get(f"/admin/studies/{taken['slug']}/design?participants=1e9").status_code == 422


@pytest.mark.slow
def test_what_scores_need_is_loaded_once_somebody_has_signed_in(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-c", SIGNED_IN, str(tmp_path)], check=True, timeout=120)


def test_a_renamed_study_is_offered_the_address_of_its_name_and_stays_where_it_was_seen(
    experimenter: Dashboard, settings: Settings, new_study: NewStudy
) -> None:
    slug = new_study()["slug"]
    manage.add_experimenter(settings, "Reader of one", "viewer", [slug])
    page = experimenter.get(f"/admin/studies/{slug}/edit").text
    assert "is not that of its name" not in page
    revision = re.search(r'name="revision" value="(\d+)"', page)
    assert revision
    new = f"Renamed {slug}"
    page = experimenter.act(f"/admin/studies/{slug}/edit", revision=revision[1], name=new).text
    assert f"Change it to /admin/studies/renamed-{slug}" in page
    moved = experimenter.act(f"/admin/studies/{slug}/address")
    assert (moved.status_code, moved.url.path) == (200, f"/admin/studies/renamed-{slug}/edit")
    assert experimenter.get(f"/admin/studies/{slug}").status_code == 404
    (reader,) = (each for each in manage.list_experimenters(settings) if each["name"] == "Reader of one")
    assert reader["studies"] == (f"renamed-{slug}",)
