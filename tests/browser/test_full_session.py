"""A whole session of 75 trials by an artificial person at the real page, at accelerated exposure."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from films import squares, write_films
from playwright.sync_api import Page, expect
from visitor import NewStudy, Visitor

from app.operate import study_balance
from app.settings import Settings
from app.simulate import Preference
from app.study.options import parse_options

pytestmark = [pytest.mark.browser, pytest.mark.slow]

DATASETS = ("lagoon", "meadow", "harbour", "quarry", "orchard")
CONDITIONS = ("heron", "otter", "zebra", "civet", "tapir", "lemur")
ABILITIES = {name: 12.0 * rank for rank, name in enumerate(CONDITIONS)}  # so far apart that choices are certain
KEYS = {"a": "1", "none": "2", "b": "3"}
N_TRIALS = 75
EXPOSURE_S = 0.1


@pytest.fixture(scope="module")
def many_films(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("many")
    return write_films(
        folder, 25.0, 4, lambda index, frame: squares(index % 4, frame), datasets=DATASETS, conditions=CONDITIONS
    )


def test_an_artificial_person_takes_75_trials_by_keyboard_and_every_choice_arrives(
    new_study: NewStudy, many_films: Path, settings: Settings, page: Page, visitor: Visitor
) -> None:
    study = new_study(many_films, EXPOSURE_S, parse_options({"break_every": 25}))
    page.set_default_timeout(30_000)
    visitor.begin(study)
    compared = {trial["number"]: trial for trial in study.read("trials")}
    preference, rng = Preference(ABILITIES, 0.0), np.random.default_rng(1)
    for number in range(1, N_TRIALS + 1):
        visitor.is_in("voting")
        expect(page.locator("#trial-label")).to_have_text(f"Pair {number} of {N_TRIALS}")
        choice = preference.choose(compared[number]["item_a"], compared[number]["item_b"], rng)
        visitor.votes(KEYS[choice])
        if number in (25, 50):
            visitor.sees("break")
            page.keyboard.press("Enter")
        page.locator(
            "#trial:not([data-state=voting]), [data-view=thanks]:visible, [data-view=break]:visible"
        ).first.wait_for()
    visitor.sees("thanks")
    votes = study.read("votes")
    assert len(votes) == N_TRIALS
    assert Counter(vote["dataset"] for vote in votes) == dict.fromkeys(DATASETS, 15)
    for vote in votes:
        better = max(vote["item_a"], vote["item_b"], key=ABILITIES.__getitem__)
        assert vote[f"item_{vote['choice']}"] == better
    report = study_balance(settings, study.slug)
    assert report["ok"]
    assert report["participants"]["finished"] == 1
