"""The form of a new study is kept as it is typed, follows the way in which people take part, and is lost by nothing."""

from __future__ import annotations

import re
import shutil
import subprocess
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import pytest

from app.intake.stimuli import read_manifest
from app.operations.studies import creation, forecast, manage
from app.operations.studies.drafts import Draft
from app.operations.studies.stimulus_sets import KnownSet
from app.settings import Settings
from app.study.options.option_table import SETTINGS
from app.study.options.own_texts import LONGEST_TEXT
from app.study.options.study_file import LONGEST_FILE, parse_study_file
from tests.app.tiny_stimuli import write_set
from tests.app.web.admin.dashboard_client import Dashboard, ends, signed_in
from tests.study_server import StudyServer

NEW = "/admin/studies/new"
DRAFTS = "/api/v1/drafts"
FORM = f"{NEW}?stimulus_set=tiny"


@pytest.fixture
def eva(own_server: str, own: Settings) -> Iterator[Dashboard]:
    with signed_in(own_server, own, "Eva") as dashboard:
        yield dashboard


def value_of(page: str, name: str) -> str:
    found = re.search(rf'name="{re.escape(name)}"[^>]*? value="([^"]*)"', page)
    assert found, name
    return unescape(found[1])


def typed(page: str, **changes: Any) -> dict[str, Any]:
    """The page's form as a browser would send it, with some fields changed."""
    hidden = {name: value_of(page, name) for name in ("stimulus_set", "preset", "platform", "was")}
    chosen = re.search(r'name="way" value="(\w+)" checked', page)
    return {**hidden, "way": chosen[1] if chosen else "", **changes}


def test_films_are_said_to_be_as_long_as_the_shortest_and_the_longest(tmp_path: Path) -> None:
    write_set(tmp_path, ("ball", "box"), ("id_fa", "pm_fb"))
    content = read_manifest(tmp_path)
    assert KnownSet("tiny", content, is_here=True).size == "64×48, 0.4 s"
    *others, last = content.stimuli
    longer = replace(content, stimuli=(*others, last.model_copy(update={"n_frames": last.n_frames + 5})))
    assert KnownSet("tiny", longer, is_here=True).size == "64×48, 0.4 to 0.6 s"


@pytest.mark.slow
def test_what_was_typed_is_kept_and_stays_when_people_take_part_elsewhere(eva: Dashboard) -> None:
    plan = eva.act(f"{NEW}/draft", **typed(eva.get(FORM).text, name="Kept", break_every="7")).text
    assert "What it will be" in plan
    assert "Kept" in eva.get(NEW).text
    page = eva.get(FORM).text
    assert (value_of(page, "name"), value_of(page, "break_every")) == ("Kept", "7")
    eva.act(f"{NEW}/draft", **typed(page, name="Kept", break_every="7", way="home"))
    page = eva.get(FORM).text
    assert re.search(r'name="way" value="home" checked', page)
    assert value_of(page, "break_every") == "7"
    assert "checked" in re.findall(r'name="optional_stages" value="screening"([^>]*)>', page)[0]
    eva.act(f"{NEW}/drop", stimulus_set="tiny")
    assert value_of(eva.get(FORM).text, "name") == ""


def test_texts_as_long_as_their_fields_are_kept_in_every_alphabet(eva: Dashboard) -> None:
    headers = {"X-CSRF-Token": eva.form_token, "Accept": "application/json"}
    texts = {"consent": "您" * LONGEST_TEXT, "debriefing": "谢" * LONGEST_TEXT}
    assert eva.act(f"{NEW}/draft", **typed(eva.get(FORM).text, name="Long", **texts)).status_code == 200
    assert texts["debriefing"] in eva.get(FORM).text
    kept = eva.put(f"{DRAFTS}/tiny", json={"typed": {"name": "Long", **texts}}, headers=headers)
    assert kept.json()["study"]["options"]["consent"] == texts["consent"]
    eva.act(f"{NEW}/drop", stimulus_set="tiny")
    refused = eva.act(f"{NEW}/file", stimulus_set="tiny", text="谢" * LONGEST_FILE)
    assert refused.status_code == 422, "it is read, and is no study file"


def test_a_program_keeps_reads_and_drops_the_form_that_its_person_sees(eva: Dashboard) -> None:
    headers = {"X-CSRF-Token": eva.form_token, "Accept": "application/json"}
    content = {"preset": "online", "platform": "prolific", "typed": {"name": "By program", "break_every": 3}}
    kept = eva.put(f"{DRAFTS}/tiny", json=content, headers=headers).json()
    assert "Prolific: Code of a completed study is empty" in kept["hindrance"]
    assert kept["study"] is None
    content["answers"] = {"prolific.code": "DONE1"}
    kept = eva.put(f"{DRAFTS}/tiny", json=content, headers=headers).json()
    assert (kept["hindrance"], kept["study"]["name"], kept["study"]["options"]["break_every"]) == ("", "By program", 3)
    assert kept["study"]["options"]["outside"]["code"] == "DONE1"
    assert kept["n_pairs"] == 6
    assert kept["minutes"]["screening"] > 0
    page = eva.get(FORM).text
    assert (value_of(page, "name"), value_of(page, "break_every")) == ("By program", "3")
    listed = eva.get(DRAFTS, headers=headers).json()
    assert [(draft["stimulus_set"], draft["typed"]) for draft in listed] == [("tiny", content["typed"])]
    assert eva.get(f"{DRAFTS}/tiny", headers=headers).json() == kept
    assert [eva.delete(f"{DRAFTS}/tiny", headers=headers).status_code for _ in range(2)] == [204, 204]
    assert eva.get(f"{DRAFTS}/tiny", headers=headers).status_code == 404
    assert value_of(eva.get(FORM).text, "name") == ""


def fault_of(name: str, value: object) -> str:
    try:
        Draft.given({"typed": {name: value}})
    except ValueError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(
    "value", [None, True, -1, 1e300, "x", [], ["x"], [1], [{}], [{"name": ["x"]}], [{"name": "x", "minimum": 1}], {}]
)
def test_what_a_program_keeps_can_be_shown_or_is_refused_by_name(eva: Dashboard, value: object) -> None:
    headers = {"X-CSRF-Token": eva.form_token, "Accept": "application/json"}
    faults = {setting.name: fault_of(setting.name, value) for setting in SETTINGS}
    assert all(f"{name.rpartition('.')[2]} is " in fault for name, fault in faults.items() if fault)
    accepted = {name: value for name, fault in faults.items() if not fault}
    assert eva.put(f"{DRAFTS}/tiny", json={"typed": accepted}, headers=headers).status_code == 200
    assert eva.get(FORM).status_code == 200
    eva.act(f"{NEW}/drop", stimulus_set="tiny")


def test_nobody_sees_the_form_of_somebody_else(eva: Dashboard, own_server: str, own: Settings) -> None:
    eva.act(f"{NEW}/draft", **typed(eva.get(FORM).text, name="Only mine"))
    with signed_in(own_server, own, "Zoe") as zoe:
        assert "Only mine" not in zoe.get(NEW).text
        assert value_of(zoe.get(FORM).text, "name") == ""


@pytest.mark.slow
def test_a_name_that_gives_conditions_away_is_warned_of_before_and_after_it_is_given(eva: Dashboard) -> None:
    warning = "holds id_fa, pm_fb, and participants see it, also in the study&#39;s address"
    form = eva.get(FORM).text
    assert warning in eva.act(f"{NEW}/draft", **typed(form, name="ID_FA or pm_fb")).text
    assert "participants see it" not in eva.act(f"{NEW}/draft", **typed(form, name="Bid_fair")).text
    ends(eva, eva.act(NEW, **typed(form, name="ID_FA or pm_fb")).url.path)
    for page in ("", "/edit"):
        assert warning in eva.get(f"/admin/studies/id-fa-or-pm-fb{page}").text


@pytest.mark.slow
def test_a_warning_of_a_name_leads_to_where_the_name_and_then_the_address_change(eva: Dashboard) -> None:
    name = "Id_fa and others"
    form = eva.get(FORM).text
    assert 'href="#setting-name"' in eva.act(f"{NEW}/draft", **typed(form, name=name)).text
    assert 'id="setting-name"' in form
    ends(eva, eva.act(NEW, **typed(form, name=name)).url.path)
    study = "/admin/studies/id-fa-and-others"
    assert f'href="{study}/edit#setting-name"' in eva.get(study).text
    edited = eva.get(f"{study}/edit").text
    assert 'id="setting-name"' in edited
    hidden = {key: value_of(edited, key) for key in ("revision", "was")}
    assert "Change it to /admin/studies/plain" in eva.act(f"{study}/edit", **hidden, name="Plain").text


def test_a_consent_that_tells_of_stages_left_out_is_named_while_the_form_is_typed(eva: Dashboard) -> None:
    page = eva.get(f"{FORM}&preset=online").text
    told = "The consent speaks of tests of the eyes, which this study does not have"
    whole = typed(page, optional_stages=["screening", "practice", "interview"])
    assert told not in eva.act(f"{NEW}/draft", **whole).text
    assert told in eva.act(f"{NEW}/draft", **whole | {"optional_stages": ["practice", "interview"]}).text


def test_films_that_cannot_be_read_are_named_with_the_reason(eva: Dashboard, own: Settings) -> None:
    broken, empty = own.sets_dir / "broken", own.sets_dir / "empty"
    write_set(broken, ["ball"], ["id_fa", "id_fb"])
    (broken / "manifest.json").write_text("{", encoding="utf-8")
    empty.mkdir()
    try:
        for page in (eva.get(NEW).text, eva.get("/admin/sets").text):
            assert re.search(r"<strong>broken</strong> .*manifest.json: is not readable as JSON", page)
            assert re.search(r"<strong>empty</strong> .*there is no such file", page)
            assert f"{own.sets_dir}/broken" not in page
            assert f"{own.sets_dir}/empty" not in page
    finally:
        shutil.rmtree(broken)
        empty.rmdir()
    assert "cannot be read" not in eva.get(NEW).text


def test_the_answers_of_a_platform_fill_the_link_and_every_way_back(eva: Dashboard, own: Settings) -> None:
    page = eva.get(FORM, params={"stimulus_set": "tiny", "preset": "quick", "platform": "prolific"}).text
    fields = typed(page, name="Paid", preset="quick", platform="prolific")
    refused = eva.act(NEW, **fields)
    assert refused.status_code == 422
    assert "Prolific: Code of a completed study is empty" in refused.text
    answers = {"answer.prolific.code": "DONE1", "answer.prolific.YOUR-SCREENED-OUT-CODE": "OUT2"}
    assert ends(eva, eva.act(NEW, **fields, **answers).url.path).url.path == "/admin/studies/paid"
    outside = parse_study_file(manage.export_study(own, "paid")).options.outside
    assert (outside.id, outside.keep, outside.code) == ("PROLIFIC_PID", ("STUDY_ID", "SESSION_ID"), "DONE1")
    assert outside.address("complete", None, outside.code).endswith("cc=DONE1")
    assert outside.screened_out_url.endswith("cc=OUT2")
    assert outside.timed_out_url == ""  # its code was left empty
    assert "not created yet" not in eva.get("/admin").text


def test_a_study_that_could_not_be_made_leads_back_to_its_form(eva: Dashboard, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise ValueError("the disk is full")

    monkeypatch.setattr(creation, "create_study", fail)
    failed = ends(eva, eva.act(NEW, **typed(eva.get(FORM).text, name="Unlucky", break_every="9")).url.path).text
    assert "the disk is full" in failed
    back = re.search(r'href="([^"]+)">Back to the form', failed)
    assert back
    page = eva.get(unescape(back[1])).text
    assert (value_of(page, "name"), value_of(page, "break_every")) == ("Unlucky", "9")


def test_a_form_whose_study_is_being_created_is_not_named_as_left(
    eva: Dashboard, monkeypatch: pytest.MonkeyPatch
) -> None:
    may_go_on, create_study = threading.Event(), creation.create_study

    def wait_and_create(*args: Any, **settings: Any) -> dict[str, Any]:
        may_go_on.wait(60)
        return create_study(*args, **settings)

    monkeypatch.setattr(creation, "create_study", wait_and_create)
    task = eva.act(NEW, **typed(eva.get(FORM).text, name="Slow"))
    try:
        assert "Creating the study Slow" in eva.get("/admin").text
        assert "not created yet" not in eva.get("/admin").text
    finally:
        may_go_on.set()
    ends(eva, task.url.path)


def test_what_cannot_be_made_is_said_in_the_words_of_the_form_while_it_is_typed(eva: Dashboard) -> None:
    plan = eva.act(f"{NEW}/draft", **typed(eva.get(FORM).text, protocol="ACR-HR")).text
    assert "It cannot be created yet" in plan
    assert "reference" in plan
    hasty = typed(eva.get(FORM).text, name="Hasty", minimum_viewing_s="3")
    refused = eva.act(NEW, **hasty)  # before any film is made
    assert refused.status_code == 422
    assert "Minimum viewing, s is 3, and a pair is shown for 0.4 s" in refused.text


@pytest.mark.slow
def test_of_very_many_pairs_no_film_is_made_unless_it_is_wanted(
    eva: Dashboard, own: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(forecast, "MOST_PAIR_FILMS", 5)
    write_set(own.sets_dir / "many", ["ball"], ["id_fa", "id_fb", "pm_fa", "pm_fb"])
    form = eva.get(f"{NEW}?stimulus_set=many").text
    of_pairs, single = re.findall(r'name="films-of-pairs".*?</label>', form, re.DOTALL)
    assert re.search(r"A film of each pair</strong>: 10 films, about", of_pairs)  # four are single ones, the fallback
    assert re.search(r"checked>.*Single films</strong>: 4 films, about .* turned away", single, re.DOTALL)
    wanted = eva.post(f"{NEW}/draft", data={"form_token": eva.form_token, **typed(form, pair_films="made")}).text
    assert re.search(r'value="made" checked>', wanted)


@pytest.mark.slow
@pytest.mark.parametrize("way", ["laboratory", "home", "prolific", "sona", "mturk", "cint"])
def test_single_films_are_offered_before_the_platform_has_said_its_codes(
    eva: Dashboard, own: Settings, way: str
) -> None:
    write_set(own.sets_dir / "several", ["ball"], ["id_fa", "id_fb", "pm_fa", "pm_fb"])
    several = f"{NEW}?stimulus_set=several"
    eva.act(f"{NEW}/draft", **typed(eva.get(several).text, way=way))
    form = eva.get(several).text
    assert len(re.findall(r'name="films-of-pairs"', form)) == 2


@pytest.mark.slow
def test_a_server_that_is_killed_while_it_makes_a_study_makes_it_without_a_click(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    write_set(settings.sets_dir / "tiny", ["ball", "box"], ["id_fa", "id_fb", "pm_fa", "pm_fb"])
    with (
        StudyServer(tmp_path, log=subprocess.DEVNULL) as server,
        signed_in(server.base_url, settings, "Eva") as eva,
    ):
        task = eva.act(NEW, **typed(eva.get(FORM).text, name="Killed", break_every="9")).url.path
        while len(list(settings.media_dir.glob("[!.]*.mp4"))) < 2:  # of 20 films
            time.sleep(0.01)
        server.kill()
        assert len(list(settings.media_dir.glob("[!.]*.mp4"))) < 20, "it was killed too late"
        while (page := eva.get(task)).url.path == task:
            assert 'role="alert"' not in page.text
            time.sleep(0.1)
        assert page.url.path == "/admin/studies/killed"
        kept = {path.name for path in settings.media_dir.glob("[!.]*.mp4")}  # not what was half written
        assert len(kept) == 20
    assert parse_study_file(manage.export_study(settings, "killed")).options.break_every == 9
