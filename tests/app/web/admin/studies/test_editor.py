"""Every setting of a study takes effect, or is refused with the reason; a stimulus set is looked after."""

from __future__ import annotations

import html
import re
import shutil
from collections.abc import Callable, Iterator
from datetime import timedelta
from pathlib import Path
from typing import Any

import httpx
import pytest

from app.files import file_digest
from app.main import running_server
from app.operations.studies import manage
from app.operations.studies.create import create_study
from app.operations.studies.edit import remake_films
from app.settings import Settings
from app.simulation.participants import begin, next_trial
from app.store.database.engine import open_database
from app.store.database.keys import utc_now
from app.store.trials.deletion import studies_to_forget
from app.study.options.options import StudyOptions, parse_options
from app.study.options.study_file import parse_study_file
from app.web.admin.studies import edit_page
from tests.app.web.admin.dashboard_client import Dashboard, ends, signed_in

pytestmark = pytest.mark.slow

NewStudy = Callable[[], dict[str, Any]]


@pytest.fixture(scope="module")
def eva(tmp_path_factory: pytest.TempPathFactory, stimulus_set: Path) -> Iterator[tuple[Dashboard, Settings]]:
    """An experimenter of a server with one stimulus set."""
    settings = Settings(data_dir=tmp_path_factory.mktemp("editor"))
    shutil.copytree(stimulus_set.parent, settings.sets_dir / "tiny")
    with running_server(settings) as url, signed_in(url, settings, "Eva", "experimenter") as dashboard:
        yield dashboard, settings


@pytest.fixture
def own_set(tmp_path: Path, stimulus_set: Path) -> Iterator[tuple[Dashboard, Settings]]:
    """The same, with a set of its own to change."""
    settings = Settings(data_dir=tmp_path)
    shutil.copytree(stimulus_set.parent, settings.sets_dir / "tiny")
    with running_server(settings) as url, signed_in(url, settings, "Eva", "experimenter") as dashboard:
        yield dashboard, settings


def made(settings: Settings, name: str, **options: Any) -> str:
    created = create_study(
        settings, settings.sets_dir / "tiny", name, exposure_s=0.4, seed=1, options=parse_options(options)
    )
    return f"/admin/studies/{created['slug']}"


def revision(dashboard: Dashboard, base: str) -> str:
    return re.findall(r'name="revision" value="(\d+)"', dashboard.get(f"{base}/edit").text)[0]


def edit(dashboard: Dashboard, base: str, options: str) -> httpx.Response:
    """Upload a study file with these options; where films are made, wait until they are."""
    text = f'name = "Edited"\nexposure_s = 0.4\n[options]\n{options}\n'
    answer = dashboard.act(f"{base}/edit/file", revision=revision(dashboard, base), text=text)
    return ends(dashboard, answer.url.path) if "/tasks/" in answer.url.path else answer


def options_of(settings: Settings, base: str) -> StudyOptions:
    return parse_study_file(manage.export_study(settings, base.rpartition("/")[2])).options


def trials_of(dashboard: Dashboard, settings: Settings, base: str) -> list[dict[str, Any]]:
    """The trials of a participant who begins now."""
    slug = base.rpartition("/")[2]
    (study,) = [each for each in manage.list_studies(settings) if each["slug"] == slug]
    token = manage.add_token(settings, "trials")["token"]
    with httpx.Client(base_url=dashboard.base_url, headers={"Authorization": f"Bearer {token}"}) as client:
        begun = begin(client, slug, study["invitations"][0])
        assert next_trial(client, begun["token"])
        rows: list[dict[str, Any]] = client.get(f"/api/v1/studies/{slug}/trials").json()
        return rows


def test_an_option_of_the_films_takes_effect_after_creation(eva: tuple[Dashboard, Settings]) -> None:
    dashboard, settings = eva
    base = made(settings, "Remade")
    dashboard.act(f"{base}/preview")  # shows pairs that go
    wanted = 'reference = "pm_fb"\nidentical_pairs = 1\nsecond_codec = "vp9"\noptional_stages = ["practice"]'
    assert edit(dashboard, base, wanted).url.path == f"{base}/edit"
    options = options_of(settings, base)
    assert (options.reference, options.identical_pairs, options.second_codec) == ("pm_fb", 1, "vp9")
    assert options.practice_pairs
    assert "films were decoded" in ends(dashboard, dashboard.act(f"{base}/stimuli").url.path).text
    trials = trials_of(dashboard, settings, base)
    assert len(trials) == 4  # in each of two datasets, a pair and an identical one
    assert {trial["role"] for trial in trials} == {"main", "identical"}
    assert "pm_fb" not in {trial["item_a"] for trial in trials}
    assert "made again" in dashboard.get("/admin/audit").text


def test_films_made_again_too_late_say_what_was_typed_beside_what_the_other_saved(
    eva: tuple[Dashboard, Settings], monkeypatch: pytest.MonkeyPatch
) -> None:
    dashboard, settings = eva
    base = made(settings, "Late")
    seen = revision(dashboard, base)

    def make(*arguments: Any) -> None:
        assert edit(dashboard, base, "break_every = 7").status_code == 200
        remake_films(*arguments)

    monkeypatch.setattr(edit_page, "remake_films", make)
    text = '[options]\nreference = "pm_fb"\nbreak_every = 9\n'
    told = dashboard.act(f"{base}/edit/file", revision=seen, text=f'name = "Late"\nexposure_s = 0.4\n{text}')
    late = ends(dashboard, told.url.path).text
    assert "Break after so many trials: 9 (7)" in late
    assert "Reference: pm_fb (none)" in late


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ('reference = "nobody"', "the reference &#39;nobody&#39; is not among them"),
        ('without = ["id_fa", "id_fb"]', "expected at least two to compare"),
    ],
)
def test_an_option_that_the_films_do_not_fit_changes_nothing(
    eva: tuple[Dashboard, Settings], options: str, complaint: str
) -> None:
    dashboard, settings = eva
    name = re.sub(r"\W+", " ", options)
    base = made(settings, name)
    assert complaint in edit(dashboard, base, options).text
    assert options_of(settings, base) == StudyOptions()


OF_FILMS = """reference = "pm_fb"
identical_pairs = 1
second_codec = "vp9"
fallback = ""
protocol = "CCR"
without = ["id_fa"]
practice_dataset = "box"
optional_stages = ["practice"]"""


def test_days_to_keep_that_are_over_would_delete_at_once_and_are_refused(eva: tuple[Dashboard, Settings]) -> None:
    dashboard, settings = eva
    base = made(settings, "Kept")
    assert edit(dashboard, base, "privacy.keep_days = 30").status_code == 200
    refused = edit(dashboard, base, "privacy.keep_days = 30\nlimits.open_until = 2025-01-01T00:00:00Z")
    assert refused.status_code == 422
    assert "would be deleted within the hour" in html.unescape(refused.text)
    days = int(re.findall(r"expected (\d+) or more", refused.text)[0])
    assert options_of(settings, base).limits.open_until == ""
    in_a_day = f"privacy.keep_days = {days}\nlimits.open_until = 2025-01-01T00:00:00Z"
    assert edit(dashboard, base, in_a_day).status_code == 200
    with open_database(settings.url) as database, database.reading() as connection:
        assert studies_to_forget(connection, utc_now()) == []
        assert len(studies_to_forget(connection, utc_now() + timedelta(days=1))) == 1


def test_films_that_cannot_be_made_again_are_named(eva: tuple[Dashboard, Settings]) -> None:
    """The study's set is not on the server any more."""
    dashboard, settings = eva
    base = f"/admin/studies/{lost(settings)}"
    for line in OF_FILMS.splitlines():
        refused = edit(dashboard, base, line)
        assert refused.status_code == 409
        name = line.partition(" ")[0]
        assert re.search(rf"\({name}\) cannot change, because the films would have to be made again", refused.text)
    assert 'name="second_codec" disabled' in dashboard.get(f"{base}/edit").text


def lost(settings: Settings) -> str:
    """The study of a set that was deleted since."""
    if not any(each["slug"] == "lost" for each in manage.list_studies(settings)):
        shutil.copytree(settings.sets_dir / "tiny", settings.data_dir / "away")
        manifest = settings.data_dir / "away" / "manifest.json"
        manifest.write_text(manifest.read_text(encoding="utf-8").replace('"tiny"', '"away"'), encoding="utf-8")
        create_study(settings, settings.data_dir / "away", "Lost", exposure_s=0.4)
        shutil.rmtree(settings.data_dir / "away")
    return "lost"


def test_a_preview_says_so_jumps_to_any_stage_and_is_left(eva: tuple[Dashboard, Settings]) -> None:
    dashboard, settings = eva
    base = made(settings, "Previewed", optional_stages=["screening", "interview"], consent="I agree.")
    page = dashboard.act(f"{base}/preview")
    assert "Preview: nothing is kept" in page.text
    for stage in ("interview", "trial", "finished", "screening", "introduction"):
        page = dashboard.enter(f"{page.url.path}/preview", stage=stage)
        assert dashboard.get("/api/v1/session").json()["stage"] == stage
    refused = dashboard.enter(f"{page.url.path}/preview", stage="practice")
    assert "The study has no stage &#39;practice&#39;" in refused.text
    assert dashboard.enter(f"{page.url.path}/preview", stage="leave").url.path == base
    assert "session" not in dashboard.cookies
    assert dashboard.enter(f"{page.url.path}/preview", stage="trial").status_code == 404
    assert "Nobody has begun yet" in dashboard.get(base).text


def test_a_participant_sees_no_banner_and_cannot_jump(eva: tuple[Dashboard, Settings]) -> None:
    dashboard, settings = eva
    base = made(settings, "Taken")
    (study,) = [each for each in manage.list_studies(settings) if base.endswith(each["slug"])]
    with Dashboard(str(dashboard.base_url)) as visitor:
        begin(visitor, study["slug"], study["invitations"][0])
        page = visitor.get(f"/s/{study['invitations'][0]}")
        assert 'data-state="mine"' in page.text
        assert "Preview" not in page.text
        assert visitor.enter(f"{page.url.path}/preview", stage="finished").status_code == 404


def test_a_form_edits_questions_in_their_order_and_shows_what_is_wrong(eva: tuple[Dashboard, Settings]) -> None:
    dashboard, settings = eva
    base = made(settings, "Asked", optional_stages=["interview"])
    texts = {"de": {"questions.age.text": "Wie alt?"}}
    assert edit(
        dashboard, base, 'optional_stages = ["interview"]\n[options.texts.de]\n"questions.age.text" = "Wie alt?"'
    )
    assert options_of(settings, base).texts == texts
    rows = {
        "questions.name": ["why", "eyes", ""],
        "questions.kind": ["text", "choice", "text"],
        "questions.text": ["Why?", "Which eye?", ""],
        "questions.options": ["", "left\r\nright", ""],
        "questions.labels": ["", "", ""],
        "questions.minimum": ["", "", ""],
        "questions.maximum": ["", "", ""],
        "questions.required": ["true", "", ""],
    }
    saved = dashboard.act(f"{base}/edit", revision=revision(dashboard, base), **rows)
    assert saved.status_code == 200
    options = options_of(settings, base)
    assert [(each.name, each.kind, each.required) for each in options.questions] == [
        ("why", "text", True),
        ("eyes", "choice", False),
    ]
    assert options.questions[1].options == ("left", "right")
    assert options.texts == {}  # of the question that is not asked any more
    rows["questions.options"][1] = "left"
    refused = dashboard.act(f"{base}/edit", revision=revision(dashboard, base), **rows)
    assert refused.status_code == 422
    assert "question eyes: a choice needs at least two options" in refused.text
    assert 'value="Which eye?"' in refused.text  # what was typed is still there
    unknown = dashboard.act(f"{base}/edit", revision=revision(dashboard, base), colour="red")
    assert "The form has the field &#39;colour&#39;, which is no setting of a study" in unknown.text


@pytest.mark.parametrize(
    ("typed", "told"),
    [
        ({"screening.distance_cm": "1"}, "Fixed distance, cm is 1, expected a number from 20 to 600"),
        ({"screening.distance_cm": "60"}, "Fixed distance, cm is 60, but the viewing distance is &#39;typed&#39;"),
        ({"scale": "77"}, "Scale is 77, expected one of 5, 9, 11"),
        ({"scale": "9"}, "Scale is 9, but protocol PC always has three answers"),
    ],
)
def test_a_value_that_has_no_effect_is_refused_by_its_label_and_not_dropped(
    own_set: tuple[Dashboard, Settings], typed: dict[str, str], told: str
) -> None:
    dashboard, settings = own_set
    base = made(settings, f"Dropped {next(iter(typed.values()))}")
    before = revision(dashboard, base)
    refused = dashboard.act(f"{base}/edit", revision=before, protocol="PC", **typed)
    assert refused.status_code == 422
    assert told in refused.text
    assert revision(dashboard, base) == before
    assert dashboard.act(f"{base}/edit", revision=before, protocol="PC", scale="5").status_code == 200


def test_factors_of_a_set_are_named_and_its_studies_follow(own_set: tuple[Dashboard, Settings]) -> None:
    dashboard, settings = own_set
    base = made(settings, "Of factors")
    table = {
        "condition": ["id_fa", "id_fb", "pm_fb"],
        "factor": ["depth", "", "light"],
        "level": ["id", "fa", "day", "id", "fb", "night", "pm", "fb", " day "],
    }
    page = dashboard.act("/admin/sets/tiny/factors", **table)
    assert page.url.path == "/admin/sets/tiny"
    assert 'value="night"' in page.text
    slug = base.rpartition("/")[2]
    facts = dashboard.get(f"/api/v1/studies/{slug}").json()
    assert facts["factors"] == {"depth": ["id", "pm"], "light": ["day", "night"]}
    assert facts["conditions"][1] == {"item": "id_fb", "levels": {"depth": "id", "light": "night"}}
    log = dashboard.get("/admin/audit").text
    assert "factors changed" in log
    assert "night" in log
    for changes, complaint in (
        ({"factor": ["depth", "depth", "light"]}, "the factor &#39;depth&#39; is there twice"),
        ({"factor": ["depth", "", "all"]}, "&#39;all&#39; is no name of a factor"),
        ({"condition": ["id_fa", "id_fb", "other"]}, "the conditions are not those of the set"),
        ({"factor": ["depth", "light", ""]}, "the new factor has levels and no name"),
        ({"level": ["id"]}, "1 levels, expected 3 for each of 3 conditions"),
    ):
        refused = dashboard.act("/admin/sets/tiny/factors", **table | changes)
        assert refused.status_code == 422
        assert complaint in refused.text
    exported = parse_study_file(manage.export_study(settings, slug))
    assert exported.manifest_sha256 == file_digest(settings.sets_dir / "tiny" / "manifest.json")
    assert edit(dashboard, base, "break_every = 3").url.path == f"{base}/edit"


def test_two_who_name_factors_at_once_lose_nothing_and_see_what_both_changed(
    own_set: tuple[Dashboard, Settings],
) -> None:
    dashboard, _ = own_set
    conditions = ["id_fa", "id_fb", "pm_fb"]

    def table(depths: str, lights: str, **shown: str) -> dict[str, Any]:
        cells = [word for pair in zip(depths.split(), lights.split(), strict=True) for word in pair]
        return {"condition": conditions, "factor": ["depth", "light"], "level": cells, **shown}

    def shown() -> dict[str, str]:
        page = dashboard.get("/admin/sets/tiny").text
        found = {name: re.search(rf'name="{name}" value="([^"]*)"', page) for name in ("seen", "was")}
        return {name: html.unescape(match[1]) for name, match in found.items() if match}

    dashboard.act("/admin/sets/tiny/factors", **table("id id pm", "day day day"))
    mine = shown()
    assert dashboard.act("/admin/sets/tiny/factors", **table("id id block", "day dusk day", **mine)).status_code == 200
    refused = dashboard.act("/admin/sets/tiny/factors", **table("sgm id census", "day day day", **mine))
    assert refused.status_code == 409
    assert "Somebody else has changed this set meanwhile" in refused.text
    told = re.findall(r'<tr><th scope="row">(.*?)</th><td[^>]*>(.*?)</td><td[^>]*>(.*?)</td></tr>', refused.text)
    assert told == [("depth of pm_fb", "census", "block")], "what both changed, in the table's words"
    assert "taken over: light of id_fb" in refused.text
    values = re.findall(r'name="level" maxlength="100" value="(\w*)"', refused.text)
    assert values == ["sgm", "day", "", "id", "dusk", "", "census", "day", ""]
    again = {name: html.unescape(re.findall(rf'name="{name}" value="([^"]*)"', refused.text)[0]) for name in mine}
    assert (
        dashboard.act("/admin/sets/tiny/factors", **table("sgm id census", "day dusk day", **again)).status_code == 200
    )


def test_a_set_is_seen_renamed_and_deleted_only_when_no_study_uses_it(own_set: tuple[Dashboard, Settings]) -> None:
    dashboard, settings = own_set
    shutil.copytree(settings.sets_dir / "tiny", settings.data_dir / "elsewhere")
    page = dashboard.act("/admin/sets/tiny/name", title="Theirs")
    assert "<h1>Theirs</h1>" in page.text
    films = re.findall(r'src="(/admin/sets/tiny/films/\d+)"', page.text)
    assert len(films) == 6
    assert dashboard.get(films[5], headers={"Range": "bytes=4-7"}).content == b"ftyp"
    assert dashboard.get("/admin/sets/tiny/films/6").status_code == 404
    assert dashboard.get("/admin/sets/..%2Fpairs").status_code == 404
    assert "Nothing was deleted" in dashboard.act("/admin/sets/tiny/delete", again="tiny").text
    create_study(settings, settings.data_dir / "elsewhere", "Outside", exposure_s=0.4)
    listed = dashboard.get("/admin/sets").text
    assert dashboard.act("/admin/sets/tiny/name", title="tiny").status_code == 422  # the other set's
    outside = re.findall(r'href="/admin/sets/([^"]+)">tiny</a>', listed)
    assert "these studies were made of it: Outside" in dashboard.act(f"/admin/sets/{outside[0]}/delete", again="x").text
    (settings.sets_dir / ".tiny.deleted" / "left").mkdir(parents=True)  # of a deletion that was killed
    assert dashboard.act("/admin/sets/tiny/delete", again="Theirs").url.path == "/admin/sets"
    assert not (settings.sets_dir / "tiny").exists()
    assert "Theirs" not in dashboard.get("/admin/sets").text


def test_a_set_on_which_a_job_works_is_not_deleted(own_set: tuple[Dashboard, Settings]) -> None:
    dashboard, settings = own_set
    job = dashboard.act("/admin/work/new/validate-films", set="tiny", reference="id_fa").url.path
    refused = dashboard.act("/admin/sets/tiny/delete", again="tiny")
    assert refused.status_code == 409
    assert "A job works on tiny now: Validate films." in refused.text
    assert (settings.sets_dir / "tiny").is_dir()
    dashboard.act(f"{job}/cancel")
    assert dashboard.act("/admin/sets/tiny/delete", again="tiny").url.path == "/admin/sets"


def test_a_study_is_created_from_a_study_file_and_what_is_wrong_is_named_by_its_line(
    eva: tuple[Dashboard, Settings],
) -> None:
    dashboard, settings = eva
    dashboard.headers["Referer"] = str(dashboard.base_url.join("/admin/studies/new"))
    form = {"stimulus_set": "tiny"}
    text = 'name = "Filed"\nexposure_s = 0.4\nseed = 5\n[options]\nprotocol = "ACR"\n[options.texts.de]\n'
    for wrong, complaint in (
        (text.replace('"ACR"', '"XYZ"'), "No study was created: line 5: protocol"),
        (text.replace("seed = 5", "seed ="), "line 3"),
        (text.replace("= 0.4", f"= {10**400}"), "line 2: exposure_s is 1000"),
        (text.replace("= 5", "= -5"), "line 3: seed is -5, expected a whole number from 0"),
        (text.replace("Filed", "\\u001b[2J Filed"), "characters in one line, with a letter or digit"),
        (f'manifest_sha256 = "{"0" * 64}"\n{text}', "line 1: manifest_sha256 is that of another stimulus set"),
    ):
        refused = dashboard.act("/admin/studies/new/file", text=wrong, **form)
        assert refused.status_code == 422
        assert complaint in refused.text
        assert html.escape(wrong).splitlines()[-1] in refused.text  # the form holds what was typed
    del dashboard.headers["Referer"]
    created = dashboard.act("/admin/studies/new/file", text=text + '"study.name" = "Abgelegt"\n', **form)
    assert ends(dashboard, created.url.path).url.path == "/admin/studies/filed"
    file = parse_study_file(manage.export_study(settings, "filed"))
    assert (file.seed, file.exposure_s, file.options.protocol) == (5, 0.4, "ACR")
    assert file.options.texts == {"de": {"study.name": "Abgelegt"}}
