"""A preset's whole session by a simulated person at the real page: `python bench/whole_session.py --browser firefox`.

The person reads, fits a card, sees rings and plates on the screen, practises, compares every pair of 5 scenes and 6
approaches with known abilities, and answers the questions; all by keyboard. Films are small and short. Afterwards every
choice on the server must be the one that was made, and every film must have been in step.

    --options FILE       options beside the preset's; `bench/paper_in_arabic.toml` has another language
    --size 1920x1080     of the window, 1366x768 else
    --pictures FOLDER    a picture of every view
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import cv2
import httpx
import numpy as np
from playing.chromium import ENTER, Chromium

from app.main import running_server
from app.operations.studies.create import create_study, read_options
from app.operations.studies.manage import add_token
from app.settings import Settings
from app.simulation.observer import Observer, gap_of_ring
from app.simulation.participants import Preference
from app.study.kinds import PAPER, PRESETS
from app.study.options.options import StudyOptions
from app.study.screening.pictures import MARGIN

sys.path.insert(0, str(Path(__file__).parents[1]))

from tests.browser.numbered_films import squares, write_films
from tests.browser.remote_browsers import Firefox

DATASETS = ("ball", "box", "people", "standing", "face")
CONDITIONS = ("civet", "heron", "otter", "zebra", "lynx", "wren")
ABILITIES = {name: 12.0 * rank for rank, name in enumerate(CONDITIONS)}  # so far apart that choices are certain
FPS, N_FRAMES = 25.0, 25
EXPOSURE_S = 1.0
PATIENCE_S = 120
DISTANCE_CM = "250"
STUCK = ("problem", "turned-away", "interrupted", "practice-again")
WHITE = 255
ABOVE_DIAL = 0.62  # of the window's height
ANSWERS = {"a": "1", "none": "2", "b": "3"}
DIGITS = {0: "6", 1: "9", 2: "8", 3: "7", 4: "4", 5: "1", 6: "2", 7: "3", -1: "0"}  # directions as on a number pad
PLACE = """(() => {
    const study = document.getElementById("study"), trial = document.getElementById("trial");
    const view = document.querySelector(`[data-view="${study?.dataset.showing}"]`);
    return {
        view: study?.dataset.showing ?? "",
        state: study?.dataset.showing === "trial" ? trial.dataset.state : "",
        label: document.getElementById("trial-label")?.textContent ?? "",
        item: view?.querySelector("[data-fill*=item], .steps")?.textContent ?? "",
        settling: "settling" in document.documentElement.dataset,
    };
})()"""
RING_IS_DRAWN = """(() => {
    const canvas = document.getElementById("ring-canvas"), { width, height } = canvas;
    if (width === 0 || "settling" in document.documentElement.dataset) return false;
    return canvas.getContext("2d").getImageData(0, 0, width, height).data.some((level) => level < 128);
})()"""
PLATE = """(() => {
    const plate = document.getElementById("plate"), { left, top, width, height } = plate.getBoundingClientRect();
    if (plate.hidden || "settling" in document.documentElement.dataset) return null;
    return [left, top, width, height].map(Math.round);
})()"""
FIT_CARD = """(() => {
    const slider = document.querySelector("#card-fitting input");
    slider.value = 300;
    slider.dispatchEvent(new Event("input", { bubbles: true }));
})()"""
ANSWER_QUESTIONS = """(() => {
    for (const question of document.querySelectorAll("#questionnaire [data-question]")) {
        const field = question.querySelector("input.field, textarea");
        if (field) field.value = question.dataset.kind === "number" ? "47" : "The edges.";
        else question.querySelector("input").click();
    }
    document.getElementById("questionnaire").requestSubmit();
})()"""


class Person:
    """Does on every view what it asks for, once the page takes presses."""

    def __init__(self, browser: Chromium | Firefox, pictures: Path | None) -> None:
        self.browser = browser
        self.pictures = pictures
        self.views: list[str] = []  # seen so far
        self.pairs: list[dict[str, Any]] = []  # to compare, in order; none during practice
        self.choices: list[str] = []  # made so far
        self.rng = np.random.default_rng(1)

    def takes_the_session(self, address: str, read_trials: Callable[[], list[dict[str, Any]]]) -> None:
        """From the invitation to the thanks."""
        self.browser.open(address)
        last: dict[str, Any] = {}
        since = time.monotonic()
        while last.get("view") != "thanks":
            time.sleep(0.02)
            place = self.browser.run(PLACE)
            if place == last or place["settling"] or place["state"] in ("loading", "fixation", "done"):
                if time.monotonic() - since > PATIENCE_S:
                    raise RuntimeError(f"the page does not go on from {place}")
                continue
            if place["view"] in STUCK:
                raise RuntimeError(f"{place['view']}: {self.browser.run('document.body.innerText')}")
            self._keep_picture("-".join(filter(None, (place["view"], place["state"]))))
            if place["view"] == "practice-done":
                self.pairs = sorted(read_trials(), key=lambda trial: int(trial["number"]))
            if self._acts(place):
                last, since = place, time.monotonic()

    def _keep_picture(self, name: str) -> None:
        if name in self.views:
            return
        self.views.append(name)
        if self.pictures:
            path = self.pictures / f"{len(self.views):02d}-{name}.png"
            cv2.imwrite(str(path), self.browser.colour_picture()[..., ::-1])

    def _acts(self, place: dict[str, Any]) -> bool:
        """Return whether the view had come so far that there was something to do."""
        view = place["view"]
        if view == "trial":
            return self._acts_on_trial(place["state"])
        if view == "rings":
            return self._answers_ring()
        if view == "plates":
            return self._answers_plate()
        if view == "consent":
            self.browser.run("document.querySelector('#consent input').click()")
        elif view == "card":
            self.browser.run(FIT_CARD)
        elif view == "distance":
            self._press(*DISTANCE_CM)
        elif view == "interview":
            self.browser.run(ANSWER_QUESTIONS)
        if view not in ("interview", "thanks"):
            self._press(ENTER)
        return True

    def _acts_on_trial(self, state: str) -> bool:
        if state == "exposure":
            self._press(" ")
        elif state == "voting":
            self._press(ANSWERS[self._choice()], ENTER)
        return state in ("exposure", "voting")

    def _choice(self) -> str:
        if not self.pairs:
            return "none"
        pair = self.pairs[len(self.choices)]
        preference = Preference(ABILITIES, 0.0)
        self.choices.append(preference.choose(pair["dataset"], pair["item_a"], pair["item_b"], self.rng))
        return self.choices[-1]

    def _answers_ring(self) -> bool:
        if not self.browser.run(RING_IS_DRAWN):
            return False
        screen = self.browser.colour_picture()[..., 0]
        screen = screen[: int(ABOVE_DIAL * len(screen))]
        rows, columns = np.nonzero(screen < WHITE)
        top, left = rows.min() - MARGIN, columns.min() - MARGIN
        size = max(np.ptp(rows), np.ptp(columns)) + 1 + 2 * MARGIN  # a gap may take the outermost column with it
        self._press(DIGITS[gap_of_ring(screen[top : top + size, left : left + size])])
        return True

    def _answers_plate(self) -> bool:
        box = self.browser.run(PLATE)
        if box is None:
            return False
        left, top, width, height = box
        plate = self.browser.colour_picture()[top : top + height, left : left + width]
        self._press(DIGITS[Observer().answer_plate(plate, self.rng)])
        return True

    def _press(self, *keys: str) -> None:
        for key in keys:
            self.browser.press_key(key)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--browser", choices=["chromium", "firefox"], default="firefox")
    parser.add_argument("--preset", choices=PRESETS, default=PAPER)
    parser.add_argument("--options", type=Path)
    parser.add_argument("--size", default="1366x768")
    parser.add_argument("--pictures", type=Path)
    arguments = parser.parse_args()
    if arguments.pictures:
        arguments.pictures.mkdir(parents=True, exist_ok=True)
    width, height = map(int, arguments.size.split("x"))
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        with closing(open_browser(arguments.browser, folder, (width, height))) as browser:
            person = Person(browser, arguments.pictures)
            result = takes_preset(person, folder, read_options(arguments.options, {}, arguments.preset))
    sys.stdout.write(json.dumps({"browser": arguments.browser, **result}, indent=2) + "\n")


def open_browser(name: str, folder: Path, size: tuple[int, int]) -> Chromium | Firefox:
    if name == "chromium":
        return Chromium(size)
    program = shutil.which("firefox-esr") or shutil.which("firefox")
    if program is None:
        raise SystemExit("no Firefox is installed")
    profile = folder / "profile"
    profile.mkdir()
    return Firefox(program, profile, size)


def takes_preset(person: Person, folder: Path, options: StudyOptions) -> dict[str, Any]:
    """Make the study, let the person take it, and compare what was done with what the server has."""
    films = folder / "films"
    films.mkdir()
    write_films(
        films, FPS, N_FRAMES, lambda index, frame: squares(index % 4, frame), datasets=DATASETS, conditions=CONDITIONS
    )
    settings = Settings(data_dir=folder / "server")
    made = create_study(settings, films, "Bodies", exposure_s=EXPOSURE_S, seed=1, options=options)
    token = add_token(settings, "whole session")["token"]
    with running_server(settings) as url:

        def read(table: str) -> list[dict[str, Any]]:
            address = f"{url}/api/v1/studies/{made['slug']}/{table}?format=json"
            answer = httpx.get(address, headers={"Authorization": f"Bearer {token}"})
            rows: list[dict[str, Any]] = answer.raise_for_status().json()
            return rows

        began = time.monotonic()
        person.takes_the_session(url + made["path"], lambda: read("trials"))
        took_s = time.monotonic() - began
        return {"took_s": round(took_s), "views": len(person.views), **summary(person, read)}


def summary(person: Person, read: Callable[[str], list[dict[str, Any]]]) -> dict[str, Any]:
    trials = [trial for trial in read("trials") if trial["choice"]]
    chosen = {int(pair["number"]): choice for pair, choice in zip(person.pairs, person.choices, strict=True)}
    viewings = [trial["viewing"] for trial in trials]
    return {
        "trials": len(person.pairs),
        "votes": len(trials),
        "votes_as_chosen": sum(trial["choice"] == chosen[int(trial["number"])] for trial in trials),
        "techniques": Counter(viewing["technique"] for viewing in viewings),
        "switches": sum(len(viewing["switches"]) for viewing in viewings),
        "mismatches": sum(viewing.get("n_mismatches", 0) for viewing in viewings),
        "dropped": f"{sum(v.get('n_dropped', 0) for v in viewings)} of {sum(v.get('n_frames', 0) for v in viewings)}",
        "wait_ms": [round(float(np.percentile([v["wait_ms"] for v in viewings], q))) for q in (50, 100)],
        "happened": Counter(event["what"] for viewing in viewings for event in viewing["happened"]),
        "screening": {row["test"]: row["verdict"] for row in read("screening")},
        "answers": {row["question"]: row["answer"] for row in read("questionnaire")},
    }


if __name__ == "__main__":
    main()
