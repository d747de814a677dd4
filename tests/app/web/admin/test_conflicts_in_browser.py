"""Two people who fill the same form at once lose nothing: what was typed stands beside what the other has saved."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Browser, Page, expect

from app.main import running_server
from app.operations.studies.create import create_study
from app.settings import Settings
from app.simulation.participants import begin
from app.study.options.options import parse_options
from tests.app.web.admin.dashboard_client import Dashboard, signed_in

pytestmark = [pytest.mark.browser, pytest.mark.slow]
EASIEST, ELSE = "Which was easiest?", "Anything else?"


@pytest.fixture
def own(tmp_path: Path) -> Settings:
    return Settings(data_dir=tmp_path / "server")


@pytest.fixture
def other(own: Settings, stimulus_set: Path) -> Iterator[Dashboard]:
    """Whoever saves first."""
    content = parse_options({"optional_stages": ["interview"], "spoken_questions": [EASIEST, ELSE]})
    create_study(own, stimulus_set, "Grouped", exposure_s=0.4)
    spoken = create_study(own, stimulus_set, "Spoken", exposure_s=0.4, options=content)
    with running_server(own) as url:
        with httpx.Client(base_url=url, timeout=60) as client:
            begin(client, spoken["slug"], spoken["invitation"])
        with signed_in(url, own, "Otto", "owner") as otto:
            yield otto


@pytest.fixture
def page(browser: Browser, other: Dashboard) -> Iterator[Page]:
    """Whoever saves second, in the same session."""
    context = browser.new_context(base_url=str(other.base_url), viewport={"width": 1366, "height": 768})
    context.add_cookies(
        [{"name": each.name, "value": each.value or "", "url": str(other.base_url)} for each in other.cookies.jar]
    )
    context.set_default_timeout(60_000)
    yield context.new_page()
    context.close()


def test_groups_that_two_people_set_at_once_stand_beside_one_another(page: Page, other: Dashboard) -> None:
    address = "/admin/studies/grouped/invitations"
    page.goto(address)
    groups = page.locator("textarea[name=groups]")
    groups.fill("near\nfar")
    assert other.act(f"{address}/groups", revision="1", groups="left\nright").status_code == 200
    page.get_by_role("button", name="Save the groups").click()
    expect(page.locator("#refused")).to_contain_text("Somebody else has changed this study meanwhile")
    expect(groups).to_have_value("near\nfar")
    expect(page.get_by_text("Saved meanwhile: left")).to_be_visible()
    page.get_by_role("button", name="Save the groups").click()
    expect(page.get_by_role("rowheader", name="near")).to_be_visible()


def test_an_answer_that_another_has_noted_is_kept_where_none_was_typed(page: Page, other: Dashboard) -> None:
    address = "/admin/studies/spoken/participants/P001/interview"
    page.goto(address)
    first, second = page.get_by_label(EASIEST), page.get_by_label(ELSE)
    first.fill("The ball")
    theirs = {"question": [EASIEST, ELSE], "seen": ["", ""], "answer": ["The box", "No"]}
    assert other.act(address, **theirs).status_code == 200
    page.get_by_role("button", name="Save").click()
    expect(page.locator("#refused")).to_contain_text("Somebody else has noted something on 'Which was easiest?'")
    expect(first).to_have_value("The ball")
    expect(page.get_by_text("Saved meanwhile: The box")).to_be_visible()
    expect(second).to_have_value("No")
    page.get_by_role("button", name="Save").click()
    page.goto(address)
    expect(first).to_have_value("The ball")
    expect(second).to_have_value("No")
