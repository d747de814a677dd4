"""The screening before a real screen: what is drawn is looked at as pixels, and answered by key, mouse and touch."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Browser, Page, Route, expect

from app.study.options.options import parse_options
from app.study.screening.pictures import read_png
from tests.browser.accessibility import check_accessibility
from tests.browser.screening_answers import DRAWN, fits_card, picture_of, shows, types_distance
from tests.browser.study_visitor import NewStudy, Study, Visitor

pytestmark = pytest.mark.browser

PATIENCE_S = 5


@pytest.fixture(scope="session")
def screened(new_study: NewStudy, short_films: Path) -> Any:
    """Creates studies with a screening."""

    def create(**screening: Any) -> Study:
        options = parse_options({"optional_stages": ["screening"], "screening": screening})
        return new_study(short_films, 0.4, options)

    return create


def enters(visitor: Visitor, study: Study) -> None:
    visitor.begin(study)
    visitor.sees("screening")


def shows_as_drawn(page: Page, study: Study) -> NDArray[np.uint8]:
    """The first ring as the server draws it, which is what is on the screen."""
    drawn = read_png(page.request.get(f"{study.url}/api/v1/session/screening/acuity/1.png").body())
    until, is_alike = time.monotonic() + PATIENCE_S, False
    while not is_alike and time.monotonic() < until:  # a busy browser may show it a moment after it was drawn
        screen = picture_of(page)[..., 0]
        top, left = (round(share * size - len(drawn) / 2) for share, size in zip((0.4, 0.5), screen.shape, strict=True))
        is_alike = np.array_equal(screen[top : top + len(drawn), left : left + len(drawn)], drawn)
    assert is_alike
    return drawn


@pytest.mark.parametrize("ratio", [1, 1.5])
def test_a_ring_stands_on_the_displays_own_pixels_as_it_was_drawn(
    screened: Any, browser: Browser, ratio: float
) -> None:
    context = browser.new_context(viewport={"width": 960, "height": 540}, device_scale_factor=ratio)
    page = context.new_page()
    visitor = Visitor(page)
    study = screened(tests=["acuity"], distance="fixed", distance_cm=300)
    enters(visitor, study)
    page.keyboard.press("Enter")
    fits_card(visitor)
    visitor.sees("rings-intro")
    page.keyboard.press("Enter")
    page.wait_for_function(DRAWN)
    shows_as_drawn(page, study)
    context.close()


def comes_to_rings(visitor: Visitor, study: Study, distance_cm: int) -> None:
    enters(visitor, study)
    visitor.page.keyboard.press("Enter")
    fits_card(visitor)
    types_distance(visitor, "distance", distance_cm)
    visitor.sees("rings-intro")
    visitor.page.keyboard.press("Enter")


def test_a_reload_before_the_first_ring_is_answered_leads_back_to_it(
    screened: Any, page: Page, visitor: Visitor
) -> None:
    study = screened(tests=["acuity"])
    comes_to_rings(visitor, study, 250)
    page.wait_for_function(DRAWN)
    page.reload()
    for view in ("screening", "rings-intro"):
        visitor.sees(view)
        page.keyboard.press("Enter")
    page.wait_for_function(DRAWN)
    shows_as_drawn(page, study)
    page.keyboard.press("ArrowUp")
    shows(page, "Ring 2 of 24 at most")


def test_a_picture_that_is_lost_on_its_way_is_fetched_again(screened: Any, page: Page, visitor: Visitor) -> None:
    lost: list[str] = []

    def lose_once(route: Route) -> None:
        if route.request.url in lost:
            route.continue_()
        else:
            lost.append(route.request.url)
            route.abort("connectionreset")

    page.route("**/1.png", lose_once)
    comes_to_rings(visitor, screened(tests=["acuity"]), 250)
    page.wait_for_function(DRAWN)
    enters(visitor, screened(tests=["colour"]))
    page.keyboard.press("Enter")
    visitor.sees("plates-intro")
    page.keyboard.press("Enter")
    expect(page.locator("#plate")).to_be_visible()
    assert len(lost) == 2


def test_the_blind_spot_a_step_back_that_cannot_be_taken_and_a_reload(
    screened: Any, page: Page, visitor: Visitor
) -> None:
    study = screened(tests=["acuity"], distance="blind spot")
    enters(visitor, study)
    page.get_by_role("button", name="Begin").click()
    fits_card(visitor)
    visitor.sees("blind-intro")
    check_accessibility(page)
    page.keyboard.press("Enter")
    for number in range(1, 6):
        shows(page, f"{number} of 5")
        page.wait_for_function(
            "() => parseFloat(document.querySelector('.blind-dot').style.getPropertyValue('--offset')) > 200"
        )
        page.keyboard.press("Space")
    visitor.sees("step-back")
    check_accessibility(page)
    page.get_by_role("button", name="I cannot move back").click()
    expect(page.get_by_text("From here this display cannot show rings")).to_be_visible()
    visitor.is_settled()
    page.keyboard.press("Enter")
    shows(page, "Ring 1 of 24 at most")
    page.wait_for_function(DRAWN)  # before it is, there is nothing to answer
    page.get_by_role("button", name="right and up").click()
    shows(page, "Ring 2 of 24 at most")
    page.reload()
    visitor.sees("screening")
    page.keyboard.press("Enter")
    visitor.sees("rings-intro")
    page.keyboard.press("Enter")
    shows(page, "Ring 2 of 24 at most")
    page.wait_for_function(DRAWN)
    page.keyboard.down("ArrowLeft")
    page.keyboard.down("ArrowDown")
    page.keyboard.up("ArrowLeft")
    page.keyboard.up("ArrowDown")
    shows(page, "Ring 3 of 24 at most")
    (row,) = study.read("screening")
    assert (row["n_answered"], row["distance_source"], row["verdict"]) == (2, "blind spot", None)


def test_a_double_click_loses_one_dot(screened: Any, page: Page, visitor: Visitor) -> None:
    enters(visitor, screened(tests=["acuity"], distance="blind spot"))
    page.get_by_role("button", name="Begin").click()
    fits_card(visitor)
    visitor.sees("blind-intro")
    page.keyboard.press("Enter")
    shows(page, "1 of 5")
    visitor.is_settled()
    page.mouse.dblclick(400, 300)
    visitor.is_settled()
    shows(page, "2 of 5")


def test_a_card_begins_within_a_narrow_window_where_its_edge_can_be_dragged(
    screened: Any, page: Page, visitor: Visitor
) -> None:
    study = screened(tests=["acuity"])
    page.set_viewport_size({"width": 320, "height": 640})
    page.add_init_script("Math.random = () => 0.999")  # the widest that a card begins
    enters(visitor, study)
    page.keyboard.press("Enter")
    visitor.sees("card")
    assert page.evaluate("document.documentElement.scrollWidth") <= 320


def test_cards_that_differ_are_fitted_again_and_none_may_end_it(screened: Any, page: Page, visitor: Visitor) -> None:
    study = screened(tests=["acuity"], on_failure="stop")
    enters(visitor, study)
    page.keyboard.press("Enter")
    slider = page.get_by_label("Width of the drawn card")
    for key in ("Home", "End"):
        slider.press(key)
        page.get_by_role("button", name="It fits").click()
    expect(page.get_by_role("alert").filter(has_text="too different")).to_be_visible()
    visitor.is_settled()
    card = page.locator(".bank-card").bounding_box()
    assert card is not None
    before = float(slider.input_value())
    page.mouse.move(card["x"] + 50, card["y"] + 50)
    page.mouse.down()
    page.mouse.move(card["x"] + 80, card["y"] + 50)
    page.mouse.up()
    assert float(slider.input_value()) == pytest.approx(before + 30, abs=1)
    page.get_by_role("button", name="I have no card").click()
    page.get_by_role("button", name="Yes, leave the test out").click()
    visitor.sees("screened-out")
    check_accessibility(page)
    page.reload()
    visitor.sees("screened-out")
    page.get_by_role("button", name="Begin as another participant").click()
    visitor.sees("welcome")
    assert [row["verdict"] for row in study.read("screening")] == ["not taken"]
