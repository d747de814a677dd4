"""A participant who visits a study's pages in a browser, and what an analyst reads of the study over REST."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from threading import Condition
from typing import Any

import cv2
import httpx
import numpy as np
from numpy.typing import NDArray
from playwright.sync_api import Page

from app.simulation.participants import begin, next_trial, vote
from tests.browser.numbered_films import Draw, decode_squares

LONGEST_WAIT_S = 30.0
SETTLED = "html:not([data-settling])"  # see static/js/settling.js
IS_SHOWN = "(selector) => document.querySelector(selector)?.checkVisibility()"
LOOK_EVERY_MS = 20  # a locator looks every 500 ms, which may be longer than an exposure
WATCH_QUESTION = """() => {
  const trial = document.getElementById("trial");
  window.questionGone = new Promise((gone) => {
    new MutationObserver(() => trial.dataset.state !== "voting" && gone()).observe(trial, { attributes: true });
  });
}"""
PAINTED = """(n) => new Promise((done) => {
    const paint = () => (n-- > 0 ? requestAnimationFrame(paint) : done());
    paint();
})"""


@dataclass(frozen=True)
class Study:
    """A study on the running server, and what an analyst reads of it."""

    url: str
    slug: str
    invitation: str
    token: str
    votes_kept: Condition  # notified by the server, which runs in this process

    @property
    def address(self) -> str:
        return f"{self.url}/s/{self.invitation}"

    def read(self, what: str) -> list[dict[str, Any]]:
        answer = httpx.get(
            f"{self.url}/api/v1/studies/{self.slug}/{what}",
            params={"format": "json"},
            headers={"Authorization": f"Bearer {self.token}"},
            timeout=LONGEST_WAIT_S,  # a first analysis loads scipy
        )
        answer.raise_for_status()
        rows: list[dict[str, Any]] = answer.json()
        return rows

    def votes(self, n: int, participant: str = "") -> list[dict[str, Any]]:
        """Everybody's or one's votes, once there are so many: a page goes on before the server has answered."""

        def read() -> list[dict[str, Any]]:
            return [vote for vote in self.read("votes") if participant in ("", vote["participant"])]

        with self.votes_kept:
            self.votes_kept.wait_for(lambda: len(read()) >= n, LONGEST_WAIT_S)
        return read()


MakeFilms = Callable[[float, int, Draw], Path]
NewStudy = Callable[..., Study]


@dataclass(frozen=True)
class Visitor:
    """A participant in front of a page."""

    page: Page

    def begin(self, study: Study) -> None:
        """From the invitation to the first trial, by keyboard."""
        self.page.goto(study.address)
        self.reads_introduction()

    def reads_introduction(self) -> None:
        for view in ("welcome", "instructions-1", "instructions-2", "instructions-3"):
            self.sees(view)
            self.page.keyboard.press("Enter")

    def comes_after_the_trials(self, study: Study) -> None:
        """Opens the page of a session whose trials are voted on already."""
        with httpx.Client(base_url=study.url) as client:
            token = begin(client, study.slug, study.invitation)["token"]
            while trial := next_trial(client, token):
                vote(client, token, trial, "a", np.random.default_rng(1))
        self.page.context.add_cookies([{"name": "session", "value": token, "url": study.url}])
        self.page.goto(study.address)

    def waits_for(self, selector: str) -> None:
        """Waits until the page shows what a selector of CSS names."""
        self.page.wait_for_function(IS_SHOWN, arg=selector, polling=LOOK_EVERY_MS)

    def sees(self, view: str) -> None:
        """Waits for a view, and until presses count on it."""
        self.waits_for(f"{SETTLED} [data-view={view}]")

    def is_settled(self) -> None:
        """Waits until presses count."""
        self.waits_for(SETTLED)

    def watches(self, n_pictures: int) -> None:
        """Looks on while the browser paints the screen so many times, up to 60 a second."""
        self.page.evaluate(PAINTED, n_pictures)

    def is_in(self, state: str) -> None:
        """Waits for a state of the trial, and until presses count in it."""
        self.waits_for(f"{SETTLED} #trial[data-state={state}]")

    def votes(self, key: str) -> None:
        """Answers the question that is there or comes next, until it is gone."""
        self.is_in("voting")
        self.page.evaluate(WATCH_QUESTION)
        self.page.keyboard.press(key)
        self.page.keyboard.press("Enter")
        self.page.evaluate("questionGone")

    def notes_resume_code(self) -> str:
        return self.page.locator("[data-view=resume]").get_by_text("note this code").inner_text().split()[-1]

    @property
    def badge(self) -> str:
        return str(self.page.locator("#trial").get_attribute("data-letter"))

    def looks(self) -> NDArray[np.uint8]:
        """The screen in grey."""
        picture = cv2.imdecode(np.frombuffer(self.page.screenshot(), np.uint8), cv2.IMREAD_GRAYSCALE)
        return np.asarray(picture, dtype=np.uint8)

    def reads_both(self) -> tuple[tuple[str, int], tuple[str, int]]:
        """What is on the screen before and after a switch."""
        before = self.reads_screen()
        self.page.keyboard.press("Space")
        return before, self.reads_screen()

    def practises(self) -> None:
        """Both pairs; a busy machine may miss an exposure, and then the pair comes again."""
        again = self.page.locator("[data-view=practice-again]:visible")
        done = self.page.locator("[data-view=practice-done]:visible")
        pair = self.page.locator("#trial[data-state=exposure], #trial[data-state=voting]")
        for _ in ("an obvious pair", "an identical one"):
            is_switched = False
            while not is_switched:
                pair.wait_for()
                self.page.keyboard.press("Space")
                self.votes("2")
                pair.or_(again).or_(done).first.wait_for()
                is_switched = not again.is_visible()
                if not is_switched:
                    self.is_settled()
                    self.page.keyboard.press("Enter")
        self.sees("practice-done")

    def finishes_first_trial(self, study: Study) -> dict[str, Any]:
        """Votes on the trial that is over soon; its viewing record."""
        self.votes("2")
        study.votes(1)
        (viewing,) = (trial["viewing"] for trial in study.read("trials") if trial["choice"])
        return dict(viewing)

    def reads_screen(self) -> tuple[str, int]:
        """The condition and the frame number that are on the screen."""
        return decode_squares(self.looks())
