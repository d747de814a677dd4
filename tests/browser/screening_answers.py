"""An artificial participant's eyes: what the screening draws is read from the screen and answered by keyboard."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count

import cv2
import numpy as np
from numpy.typing import NDArray
from playwright.sync_api import Locator, Page, expect

from app.simulation.observer import Observer, gap_of_ring
from app.study.screening.pictures import MARGIN
from tests.browser.study_visitor import Visitor

RING_KEYS = ("Numpad6", "KeyE", "Numpad8", "KeyQ", "Numpad4", "KeyZ", "Numpad2", "Numpad3")
PLATE_KEYS = {0: "ArrowRight", 2: "ArrowUp", 4: "ArrowLeft", 6: "ArrowDown", -1: "0"}
ABOVE_DIAL = 0.62  # of the window's height
BELOW_CORNER = 60  # pixels: above is the button that withdraws
COMES = """([name, step]) => {
  const view = document.querySelector(`[data-view=${name}]`);
  return view.hidden || view.querySelector(".stage-step").textContent.startsWith(step);
}"""
DRAWN = """() => {
  const canvas = document.getElementById("ring-canvas");
  const { width, height } = canvas;
  if (width === 0 || !canvas.checkVisibility() || "settling" in document.documentElement.dataset) return false;
  const pixels = canvas.getContext("2d", { alpha: false }).getImageData(0, 0, width, height).data;
  return pixels[0] === 255 && pixels.some((level) => level < 128); // dark on white: a new canvas is black
}"""


def fits_card(visitor: Visitor) -> None:
    """Twice alike, by keyboard."""
    slider = visitor.page.get_by_label("Width of the drawn card")
    for number in (1, 2):
        expect(visitor.page.get_by_text(f"{number} of 2")).to_be_visible()
        slider.press("Home")
        for _ in range(2):
            slider.press("PageUp")
        visitor.is_settled()
        visitor.page.keyboard.press("Enter")


def types_distance(visitor: Visitor, view: str, distance_cm: int) -> None:
    visitor.sees(view)
    expect(visitor.page.locator(f"#{view}-cm")).to_be_focused()
    visitor.page.keyboard.type(str(distance_cm))
    visitor.page.keyboard.press("Enter")


def picture_of(page: Page | Locator) -> NDArray[np.uint8]:
    picture = cv2.imdecode(np.frombuffer(page.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    return np.asarray(picture[..., ::-1], dtype=np.uint8)


def ring_on(page: Page) -> NDArray[np.uint8]:
    """The part of the screen that holds the ring, with the margin that it was drawn with."""
    screen = picture_of(page)[..., 0]
    screen = screen[BELOW_CORNER : int(ABOVE_DIAL * len(screen))]
    rows, columns = np.nonzero(screen < 255)
    top, left = rows.min() - MARGIN, columns.min() - MARGIN
    size = max(np.ptp(rows), np.ptp(columns)) + 1 + 2 * MARGIN  # a gap may take the outermost column with it
    return screen[top : top + size, left : left + size]


def shows(page: Page, text: str) -> None:
    expect(page.get_by_text(text, exact=True)).to_be_visible()


def pictures(page: Page, view: str, name: str) -> Iterator[int]:
    """The number of each ring or disc as it comes, until the test is certain of its verdict."""
    page.locator(f"[data-view={view}]").wait_for()
    for number in count(1):
        page.wait_for_function(COMES, arg=[view, f"{name} {number} of"])
        if not page.locator(f"[data-view={view}]").is_visible():
            return
        yield number


def answers_rings(page: Page) -> None:
    for _ in pictures(page, "rings", "Ring"):
        page.wait_for_function(DRAWN)
        page.keyboard.press(RING_KEYS[gap_of_ring(ring_on(page))])


def answers_plates(page: Page) -> None:
    rng, plate = np.random.default_rng(3), page.locator("#plate")
    for _ in pictures(page, "plates", "Disc"):
        expect(plate).to_be_visible()
        Visitor(page).is_settled()
        page.keyboard.press(PLATE_KEYS[Observer().answer_plate(picture_of(plate), rng)])


def passes_screening(visitor: Visitor) -> None:
    """From its first page to the end of its last test, and back to the seat."""
    for view in ("screening", "card", "distance", "rings-intro"):
        visitor.sees(view)
        if view == "card":
            fits_card(visitor)
        elif view == "distance":
            types_distance(visitor, view, 250)
        else:
            visitor.page.keyboard.press("Enter")
    answers_rings(visitor.page)
    visitor.sees("plates-intro")
    visitor.page.keyboard.press("Enter")
    answers_plates(visitor.page)
    visitor.sees("seat")
    expect(visitor.page.locator("[data-view=seat]")).to_contain_text("about 250 cm from the display")
    visitor.page.keyboard.press("Enter")
