"""An experimenter edits a study in real Chromium: what is shown is what is saved, and rows can be added and moved."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from playwright.sync_api import Browser, Dialog, Route, expect

from app.operations.studies import manage
from app.operations.studies.create import read_options
from app.settings import Settings
from app.study.kinds import PAPER
from app.study.options.study_file import parse_study_file
from tests.app.web.admin.dashboard_client import sign_in

pytestmark = [pytest.mark.browser, pytest.mark.slow]


def test_a_page_whose_text_is_not_saved_asks_before_it_is_left(
    browser: Browser, server: str, settings: Settings, new_study: Callable[[], dict[str, Any]]
) -> None:
    page, study = browser.new_page(base_url=server), new_study()
    asked: list[str] = []

    def stay(dialog: Dialog) -> None:
        asked.append(dialog.type)
        dialog.dismiss()

    page.on("dialog", stay)
    sign_in(page, settings)
    page.goto(f"/admin/studies/{study['slug']}/texts")
    consent = page.get_by_role("textbox", name="Consent Markdown")
    consent.click()
    page.keyboard.type("You may stop at any time.")
    page.get_by_role("link", name="Deutsch").click()
    expect(consent).to_have_value("You may stop at any time.")
    assert asked == ["beforeunload"]
    page.get_by_role("button", name="Save the texts").click()
    expect(page.get_by_role("status")).to_have_text("Saved.")
    page.get_by_role("link", name="Deutsch").click()
    page.wait_for_url("**language=de")
    page.goto(f"/admin/studies/{study['slug']}/edit")
    page.get_by_role("searchbox", name="Find a setting").fill("written")
    expect(page.get_by_text("1 found")).to_be_visible()
    page.get_by_role("group", name="Written questions").get_by_role("button", name="Add a row").click()
    page.get_by_role("link", name="Overview").click()
    expect(page.get_by_role("button", name="Save", exact=True)).to_be_visible()
    assert asked == ["beforeunload"] * 2
    page.close()


def test_a_way_that_is_chosen_before_the_pages_script_is_there_counts(
    browser: Browser, own_server: str, own: Settings
) -> None:
    page = browser.new_page(base_url=own_server)
    sign_in(page, own)
    late: list[Route] = []
    page.route("**/admin-draft.js", lambda route: late.append(route))
    page.goto("/admin/studies/new?stimulus_set=tiny", wait_until="commit")
    page.get_by_role("radio", name="Prolific").check()
    expect(page.locator("[name=platform]")).to_have_value("")
    late[0].continue_()
    expect(page.locator("[name=platform]")).to_have_value("prolific")
    page.close()


def test_a_scale_that_pair_comparison_makes_no_use_of_refuses_no_form(
    browser: Browser, own_server: str, own: Settings
) -> None:
    page = browser.new_page(base_url=own_server)
    sign_in(page, own)
    page.goto("/admin/studies/new?stimulus_set=tiny&preset=quick")
    page.get_by_label("Name shown to participants").fill("Switched")
    page.locator("[name=protocol][value=ACR]").check()
    page.get_by_role("heading", name="Protocol and conditions").click()
    scale = page.locator("[name=scale]")
    scale.select_option("9")
    page.locator("[name=protocol][value=PC]").check()
    expect(scale).to_have_value("5")
    expect(scale.locator("option[value='9']")).to_be_disabled()
    page.get_by_role("button", name="Create").click()
    page.wait_for_url("**/admin/studies/switched")
    page.close()


def test_a_study_is_made_edited_and_previewed_without_a_file(browser: Browser, own_server: str, own: Settings) -> None:
    complaints: list[str] = []
    page = browser.new_page(base_url=own_server, viewport={"width": 1366, "height": 768})
    page.on("console", lambda message: complaints.append(message.text))
    sign_in(page, own)

    page.goto("/admin/studies/new?stimulus_set=tiny&preset=paper")
    page.get_by_label("Name shown to participants").fill("By hand")
    page.get_by_role("button", name="Create").click()
    page.wait_for_url("**/admin/studies/by-hand")
    before = parse_study_file(manage.export_study(own, "by-hand")).options
    assert before.questions == read_options(None, {}, PAPER).questions
    assert before.texts == read_options(None, {}, PAPER).texts

    page.get_by_role("link", name="Settings").click()
    page.get_by_role("button", name="Save", exact=True).click()
    page.wait_for_load_state()
    assert parse_study_file(manage.export_study(own, "by-hand")).options == before

    page.get_by_role("heading", name="Questions").click()  # which stays open when the page is loaded again
    questions = page.get_by_role("group", name="Written questions")
    questions.get_by_role("button", name="Add a row").click()
    new = questions.get_by_role("group", name="new question")
    new.get_by_label("Name").fill("eyes")
    new.get_by_role("textbox", name="Text").fill("Are your eyes tired?")
    new.get_by_label("Answer").select_option("required")
    new.get_by_label("Kind").select_option("text")
    new.get_by_role("button", name="Up").click()
    questions.get_by_role("group", name="trained").get_by_role("button", name="Delete").click()
    page.get_by_role("button", name="Save", exact=True).click()
    expect(questions.get_by_role("group", name="eyes")).to_be_visible()
    after = parse_study_file(manage.export_study(own, "by-hand")).options
    assert [question.name for question in after.questions] == ["age", "sex", "eyes", "criteria"]

    page.goto("/admin/studies/by-hand")
    page.get_by_role("button", name="Preview as a participant").click()
    page.get_by_text("Preview: nothing is kept").wait_for()
    banner, foot = page.locator(".preview").bounding_box(), page.locator(".foot:visible").bounding_box()
    assert banner
    assert foot
    assert banner["y"] + banner["height"] <= foot["y"]
    page.get_by_text("Jump to").click()
    page.get_by_role("button", name="interview").click()
    page.get_by_text("Are your eyes tired?").wait_for()
    page.wait_for_load_state("networkidle")  # what the page asks about films has no session any more once it is left
    page.get_by_role("button", name="Leave the preview").click()
    page.wait_for_url("**/admin/studies/by-hand")

    page.goto("/admin/sets/tiny")
    film = page.get_by_label("ball/id_fa", exact=True)
    assert film.evaluate("film => film.readyState") == 0  # nothing is fetched before it is in view
    film.scroll_into_view_if_needed()
    page.wait_for_function("film => film.readyState > 0", arg=film.element_handle())
    assert complaints == []
    page.close()
