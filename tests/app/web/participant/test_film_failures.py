"""A film that cannot be shown is an alarm: on the pages, over REST, in the metrics; many people's pauses the study."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import httpx
import pytest

from app.simulation.participants import begin, next_trial
from tests.app.web.admin.dashboard_client import Dashboard
from tests.app.web.http_checks import is_problem

pytestmark = pytest.mark.slow

Create = Callable[..., dict[str, Any]]
Fails = Callable[..., httpx.Client]
FIREFOX = {"User-Agent": "Mozilla/5.0 (X11; Linux x86_64; rv:150.0) Gecko/20100101 Firefox/150.0"}
CHROME = {"User-Agent": "Mozilla/5.0 (X11; Linux x86_64) AppleWebKit/537.36 Chrome/150.0.0.0 Safari/537.36"}
OUTSIDE = {"no_consent_url": "https://platform.test/back", "redirect_after_s": 1}


@pytest.fixture
def fails(server: str) -> Iterator[Fails]:
    """Somebody begins, and the first film does not play; returns their browser."""
    with ExitStack() as browsers:

        def fail(
            study: dict[str, Any], times: int = 1, agent: dict[str, str] = FIREFOX, why: str = "the film is 2x2"
        ) -> httpx.Client:
            browser = browsers.enter_context(httpx.Client(base_url=server, timeout=30, headers=agent))
            token = begin(browser, study["slug"], study["invitation"])["token"]
            browser.headers["Authorization"] = f"Bearer {token}"
            trial = next_trial(browser, token)
            assert trial is not None
            for _ in range(times):
                told = browser.put(f"/api/v1/session/trials/{trial['trial']}/trouble", json={"why": why})
                assert told.status_code == 204
            return browser

        yield fail


@pytest.fixture
def failures(server: str, token: str) -> Callable[[dict[str, Any]], list[dict[str, Any]]]:
    def read(study: dict[str, Any]) -> list[dict[str, Any]]:
        path = f"{server}/api/v1/studies/{study['slug']}/failures"
        answer = httpx.get(path, params={"format": "json"}, headers={"Authorization": f"Bearer {token}"})
        rows: list[dict[str, Any]] = answer.raise_for_status().json()
        return rows

    return read


def test_a_failing_film_is_told_with_the_browser_on_every_page_of_the_study_and_over_rest(
    server: str, fails: Fails, create: Create, experimenter: Dashboard, failures: Callable[..., list[dict[str, Any]]]
) -> None:
    study = create()
    assert "could not be shown" not in experimenter.get(f"/admin/studies/{study['slug']}").text
    fails(study)
    (row,) = failures(study)
    assert (row["participant"], row["why"], row["browser"]) == ("P001", "the film is 2x2", "Firefox on Linux")
    assert row["film"].split(":")[0] in ("ball", "box")
    assert row["noted_at"] is None
    for tab in ("", "/participants", "/votes", "/stimuli"):
        text = experimenter.get(f"/admin/studies/{study['slug']}{tab}").text
        assert "could not be shown to 1 participant" in text
        assert "Firefox on Linux" in text
    metrics = httpx.get(f"{server}/metrics").text
    assert "reconstudy_film_failures_total" in metrics
    labels = f'{{browser="Firefox on Linux",film="{row["film"]}",study="{study["slug"]}"}}'
    assert f"reconstudy_failing_film_people{labels} 1.0" in metrics


def test_the_alarm_counts_people_by_browser_and_leaves_out_what_a_browser_says_to_its_developers(
    server: str, fails: Fails, create: Create, experimenter: Dashboard, failures: Callable[..., list[dict[str, Any]]]
) -> None:
    study = create(pause_on_failures=0)
    page = f"/admin/studies/{study['slug']}"
    why = "the film is damaged, or the browser cannot decode it: PipelineStatus::PIPELINE_ERROR_DECODE: size=5455"
    for agent in (FIREFOX, CHROME, CHROME):
        fails(study, times=2, agent=agent, why=why)
    text = experimenter.get(page).text
    assert "PipelineStatus" not in text
    assert "the film is damaged, or the browser cannot decode it" in text
    assert {row["why"] for row in failures(study)} == {why}
    for n, name in ((2, "Chrome on Linux"), (1, "Firefox on Linux")):
        metrics = httpx.get(f"{server}/metrics").text.splitlines()
        counts = [line.split()[-1] for line in metrics if f'browser="{name}"' in line and study["slug"] in line]
        assert sum(map(float, counts)) == n
    assert experimenter.act(f"{page}/failures").status_code in (200, 303)
    assert f'study="{study["slug"]}"' not in httpx.get(f"{server}/metrics").text


def test_the_third_person_pauses_the_study_and_opening_it_ends_the_alarm(
    fails: Fails, create: Create, experimenter: Dashboard, failures: Callable[..., list[dict[str, Any]]]
) -> None:
    study = create()
    page = f"/admin/studies/{study['slug']}"
    fails(study, times=5)  # one person's five are not five people's
    fails(study)
    assert "state-open" in experimenter.get(page).text
    fails(study)
    text = experimenter.get(page).text
    assert "state-paused" in text
    assert "The study is paused" in text
    experimenter.act(f"{page}/state", state="open")
    assert "could not be shown" not in experimenter.get(page).text
    assert all(row["noted_at"] for row in failures(study))
    fails(study)  # counts from here on
    assert "state-open" in experimenter.get(page).text


def test_the_rule_is_an_option_of_the_study(fails: Fails, create: Create, experimenter: Dashboard) -> None:
    never, at_once = create(pause_on_failures=0), create(pause_on_failures=1)
    for study, state in ((never, "state-open"), (at_once, "state-paused")):
        for _ in range(3 if study is never else 1):
            fails(study)
        assert state in experimenter.get(f"/admin/studies/{study['slug']}").text


def test_who_fails_twice_is_told_where_to_go_and_may_go_on_when_it_was_noted(
    fails: Fails, create: Create, experimenter: Dashboard
) -> None:
    study = create(outside=OUTSIDE)
    once, twice = fails(study), fails(study, times=2)
    assert once.get("/api/v1/session").json()["stopped"] is False
    stopped = twice.get("/api/v1/session").json()
    assert stopped["stopped"] is True
    assert stopped["ending"] == {"code": None, "url": "https://platform.test/back", "after_s": 1}
    assert experimenter.act(f"/admin/studies/{study['slug']}/failures").status_code in (200, 303)
    assert twice.get("/api/v1/session").json()["stopped"] is False


def test_a_trial_of_somebody_else_is_left_aside(
    server: str, create: Create, failures: Callable[..., list[dict[str, Any]]], fails: Fails
) -> None:
    study = create()
    browser = fails(study)
    for name in ("nobodys", "practice-9", "practice-x"):
        assert browser.put(f"/api/v1/session/trials/{name}/trouble", json={"why": "?"}).status_code == 204
    assert len(failures(study)) == 1
    assert is_problem(httpx.put(f"{server}/api/v1/session/trials/x/trouble", json={"why": "?"}), 401)


def test_time_outs_and_withdrawals_have_addresses_of_their_own(server: str, create: Create) -> None:
    study = create(outside={"withdrawn_url": "https://platform.test/withdrawn", "timed_out_url": "https://a.test/late"})
    with httpx.Client(base_url=server) as browser:
        token = begin(browser, study["slug"], study["invitation"])["token"]
        left = browser.put("/api/v1/session/withdrawal", headers={"Authorization": f"Bearer {token}"}).json()
    assert left["ending"]["url"] == "https://platform.test/withdrawn"
