"""A whole session by an artificial person at the real page, from the consent to the thanks, at accelerated exposure."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from app.operations.studies.manage import study_balance
from app.settings import Settings
from app.simulation.participants import Preference
from app.study.options.options import parse_options
from tests.browser.numbered_films import squares, write_films
from tests.browser.screening_answers import passes_screening
from tests.browser.study_visitor import NewStudy, Study, Visitor

pytestmark = [pytest.mark.browser, pytest.mark.slow]

DATASETS = ("lagoon", "meadow")
CONDITIONS = ("heron", "otter", "zebra", "civet")
ABILITIES = {name: 12.0 * rank for rank, name in enumerate(CONDITIONS)}  # so far apart that choices are certain
KEYS = {"a": "1", "none": "2", "b": "3"}
N_TRIALS = 12
EXPOSURE_S = 0.4  # long enough for a switch in practice
LONGEST_WAIT_MS = 500  # before a trial, whose film was fetched during the one before
OPTIONS = {
    "optional_stages": ["screening", "practice", "interview"],
    "consent": "We compare models.",
    "comprehension": True,
    "break_every": 6,
}


@pytest.fixture(scope="module")
def many_films(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("many")
    return write_films(
        folder, 25.0, 10, lambda index, frame: squares(index % 4, frame), datasets=DATASETS, conditions=CONDITIONS
    )


def test_an_artificial_person_takes_every_stage_and_12_trials_and_every_choice_arrives(
    new_study: NewStudy, many_films: Path, settings: Settings, page: Page, visitor: Visitor
) -> None:
    study = new_study(many_films, EXPOSURE_S, parse_options(OPTIONS))
    page.set_default_timeout(30_000)
    comes_to_the_trials(study, page, visitor)
    compared = {trial["number"]: trial for trial in study.read("trials")}
    preference, rng = Preference(ABILITIES, 0.0), np.random.default_rng(1)
    for number in range(1, N_TRIALS + 1):
        visitor.is_in("voting")
        expect(page.locator("#trial-label")).to_have_text(f"Pair {number} of {N_TRIALS}")
        pair = compared[number]
        visitor.votes(KEYS[preference.choose(pair["dataset"], pair["item_a"], pair["item_b"], rng)])
        if number == 6:
            visitor.sees("break")
            page.keyboard.press("Enter")
    visitor.sees("interview")
    page.get_by_label("How old are you?").fill("47")
    page.get_by_role("button", name="Finish").click()
    visitor.sees("thanks")

    votes = study.read("votes")
    assert len(votes) == N_TRIALS
    assert Counter(vote["dataset"] for vote in votes) == dict.fromkeys(DATASETS, 6)
    for vote in votes:
        better = max(vote["item_a"], vote["item_b"], key=ABILITIES.__getitem__)
        assert vote[f"item_{vote['choice']}"] == better
    acuity, colour = study.read("screening")
    assert (acuity["verdict"], colour["verdict"]) == ("passed", "passed")
    assert acuity["logmar"] < acuity["limit"]
    assert {row["question"]: row["answer"] for row in study.read("questionnaire")}["age"] == 47
    waits = [trial["viewing"]["wait_ms"] for trial in study.read("trials")]
    assert np.median(waits) <= LONGEST_WAIT_MS
    report = study_balance(settings, study.slug)
    assert report["ok"]
    assert report["participants"]["finished"] == 1


def comes_to_the_trials(study: Study, page: Page, visitor: Visitor) -> None:
    """Consent, instructions, comprehension, screening and practice."""
    page.goto(study.address)
    visitor.sees("welcome")
    page.keyboard.press("Enter")
    page.get_by_label("I have read this").check()
    page.keyboard.press("Enter")
    for number in (1, 2, 3):
        visitor.sees(f"instructions-{number}")
        page.keyboard.press("Enter")
    page.get_by_label("I switch between").check()
    page.keyboard.press("Enter")
    passes_screening(visitor)
    visitor.sees("practice")
    page.keyboard.press("Enter")
    visitor.practises()
    page.keyboard.press("Enter")
