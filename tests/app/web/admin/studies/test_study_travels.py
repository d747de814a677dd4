"""A study goes from one server to an empty other one by the dashboard alone, and nothing of it is lost."""

from __future__ import annotations

import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from playwright.sync_api import Browser, Page, expect

from app.files import file_digest
from app.main import running_server
from app.operations.studies import manage
from app.operations.studies.create import create_study
from app.settings import Settings
from app.simulation.participants import simulate
from app.store.access.rights import SCOPES
from app.study.options.options import parse_options
from tests.app.conftest import ABILITIES

pytestmark = [pytest.mark.browser, pytest.mark.slow]

PASSWORD = "correct horse battery"
MEASURES = b"dataset,approach,measure,value,better\nball,id_fa,psnr_y,31.5,higher\nball,pm_fb,psnr_y,33,higher\n"
PIXEL = b"\x89PNG\r\n\x1a\n" + bytes(20)
SAME_TABLES = ("votes", "trials", "participants", "comments", "comment_tags", "validation", "scores", "questionnaire")
OPTIONS = {
    "optional_stages": ["interview"],
    "spoken_questions": ["Anything else?"],
    "groups": [{"name": "near", "datasets": []}, {"name": "far", "datasets": []}],
    "consent": "I take part.",
    "texts": {"en": {"study.debriefing": "Thank you."}},
}


@pytest.fixture
def servers(tmp_path: Path) -> Iterator[tuple[str, Settings, str, Settings]]:
    """One server, and an empty other one."""
    here, there = Settings(data_dir=tmp_path / "here"), Settings(data_dir=tmp_path / "there")
    with running_server(here) as one, running_server(there) as other:
        yield one, here, other, there


def client(server: str, settings: Settings) -> httpx.Client:
    token = manage.add_token(settings, secrets.token_hex(4), list(SCOPES))["token"]
    return httpx.Client(base_url=f"{server}/api/v1/", headers={"Authorization": f"Bearer {token}"}, timeout=120)


def fill(server: str, settings: Settings, stimulus_set: Path) -> str:
    """Make a study that people have taken, with measures, an image, and comments that are tagged."""
    made = create_study(settings, stimulus_set, "Street", exposure_s=0.4, options=parse_options(OPTIONS))
    with client(server, settings) as program:
        base = f"studies/{made['slug']}"
        assert program.put(f"{base}/images/room.png", content=PIXEL).status_code == 204
        token = program.headers["authorization"].removeprefix("Bearer ")
        simulate(server, made["slug"], made["invitation"], token, 2, ABILITIES, 0.2, seed=4)
        person = f"{base}/participants/P001"
        assert program.put(f"{person}/interview", json={"answers": {"Anything else?": "Faces."}}).status_code == 204
        place = {"participant": "P001", "source": "spoken", "subject": "Anything else?", "tag": "faces"}
        assert program.put(f"{base}/comments/tag", params=place).status_code == 204
        assert program.put(f"{person}/exclusion", json={"reason": "looked away"}).status_code == 200
        assert program.post(f"{base}/results", content=MEASURES).status_code == 200
    return str(made["slug"])


def all_of(server: str, settings: Settings, slug: str) -> dict[str, Any]:
    """What a program reads of a study, without ids and codes, which are a server's own."""
    own = ("trial", "session", "subject", "resume_code")
    with client(server, settings) as program:
        read: dict[str, Any] = {}
        for name in SAME_TABLES:
            rows = program.get(f"studies/{slug}/{name}").raise_for_status().json()
            read[name] = [{key: value for key, value in row.items() if key not in own} for row in rows]
        for name in ("texts", "design"):
            read[name] = program.get(f"studies/{slug}/{name}").json() | {"revision": 0}
        read["study"] = program.get(f"studies/{slug}").json() | {"state": "", "revision": 0}
        read["figures"] = program.get(f"studies/{slug}/figures").json()
        set_name = program.get("sets").json()[0]["name"] if program.get("sets").json() else ""
        read["set"] = program.get(f"sets/{set_name}").json().get("sha256")
    return read


def sign_in(page: Page, server: str, settings: Settings) -> None:
    page.goto(server + str(manage.set_up_path(settings)))
    page.get_by_label("Your name").fill("Eva")
    page.get_by_label("A password").fill(PASSWORD)
    page.get_by_label("The password again").fill(PASSWORD)
    page.get_by_role("button", name="Begin").click()
    expect(page.get_by_role("heading", name="Studies")).to_be_visible()


def test_a_study_with_measures_travels_to_an_empty_server_by_the_pages_alone(
    browser: Browser, servers: tuple[str, Settings, str, Settings], stimulus_set: Path, tmp_path: Path
) -> None:
    one, here, other, there = servers
    slug = fill(one, here, stimulus_set)
    context = browser.new_context(viewport={"width": 1366, "height": 768}, accept_downloads=True)
    context.set_default_timeout(200_000)
    page = context.new_page()
    sign_in(page, one, here)
    page.goto(f"{one}/admin/studies/{slug}")
    with page.expect_download() as waiting:
        page.get_by_role("link", name="Take to another server").click()
    packed = tmp_path / waiting.value.suggested_filename
    waiting.value.save_as(packed)

    context.clear_cookies()
    sign_in(page, other, there)
    page.goto(f"{other}/admin")
    page.get_by_text("Bring in a study from another server").click()
    page.locator("details[open] input[type=file]").set_input_files(packed)
    page.locator("details[open] button").first.click()
    page.wait_for_url(f"{other}/admin/studies/{slug}")
    expect(page.get_by_role("heading", name="Street").first).to_be_visible()
    page.goto(f"{other}/admin/studies/{slug}/objective")
    expect(page.get_by_text("psnr_y").first).to_be_visible()
    context.close()

    before, after = all_of(one, here, slug), all_of(other, there, slug)
    for name, content in before.items():
        assert after[name] == content, name
    assert len(before["votes"]) > 10
    assert before["comment_tags"] == [{"tag": "faces", "n_comments": 1, "n_participants": 1}]
    assert before["validation"]
    films = [{file.name: file_digest(file) for file in each.media_dir.iterdir()} for each in (here, there)]
    assert films[0] == films[1]
    assert films[0]
