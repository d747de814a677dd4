from __future__ import annotations

from pathlib import Path
from typing import Any

import httpx
import pytest

from app.operations.studies.create import create_study
from app.operations.studies.manage import add_invitation
from app.settings import Settings
from app.study.options.options import parse_options
from app.web.participant.pages import preferred_language

AVAILABLE = ["en", "de"]


@pytest.mark.parametrize(
    ("accepted", "language"),
    [
        ("", "en"),
        ("de", "de"),
        ("de-AT,de;q=0.9,en;q=0.8", "de"),
        ("fr, en;q=0.5, de;q=0.7", "de"),
        ("fr;q=1.0", "en"),
        ("de;q=much, *", "en"),
        (";;,,q=", "en"),
    ],
)
def test_the_language_is_the_readers_first_that_there_is(accepted: str, language: str) -> None:
    assert preferred_language(accepted, AVAILABLE) == language


@pytest.mark.parametrize(("places", "offers"), [(None, [True, True]), (2, [True, True]), (1, [False, False])])
def test_a_page_lets_another_participant_begin_where_a_place_is_left(
    client: httpx.Client, settings: Settings, study: dict[str, Any], places: int | None, offers: list[bool]
) -> None:
    """Before a participant of this browser has begun, and after."""
    invitation = add_invitation(settings, study["slug"], places=places)
    pages = [client.get(invitation["path"]).text]
    client.post(f"/api/v1/studies/{study['slug']}/sessions", json={"invitation": invitation["invitation"]})
    pages.append(client.get(invitation["path"]).text)
    assert ['name="another"' in page for page in pages] == offers
    for_another = client.get(invitation["path"], params={"another": 1, "language": "de"}).text
    assert ('data-state="open"' in for_another) == offers[1]
    assert "?language=en&amp;another=1" in for_another  # and stays so in the other language


def test_a_code_may_be_typed_in_capitals_and_in_groups(client: httpx.Client, study: dict[str, Any]) -> None:
    groups = "-".join(study["invitation"][start : start + 4] for start in (0, 4, 8))
    typed = client.get("/", params={"code": f" {groups.upper().replace('-', ' ', 1)} "}, follow_redirects=True)
    assert (typed.status_code, typed.url.path) == (200, study["path"])


@pytest.mark.slow
def test_every_page_that_one_comes_back_to_asks_whether_it_is_somebody_else(
    client: httpx.Client, settings: Settings, stimulus_set: Path
) -> None:
    """Whoever has just begun is not asked."""
    options = parse_options({"optional_stages": ["screening", "practice", "interview"], "consent": "We compare."})
    study = create_study(settings, stimulus_set, "Returning", exposure_s=0.4, options=options)
    last = {"known", "thanks", "withdrawn", "screened-out", "timed-out"}
    assert _views_with_another(client.get(study["path"]).text) == last
    client.post(f"/api/v1/studies/{study['slug']}/sessions", json={"invitation": study["invitation"]})
    instructions = {f"instructions-{number}" for number in (1, 2, 3)}
    returning = {"consent", "screening", "practice", "resume", "interview"} | instructions
    assert _views_with_another(client.get(study["path"]).text) == last | returning


def _views_with_another(page: str) -> set[str]:
    return {view.partition('"')[0] for view in page.split('data-view="')[1:] if 'name="another"' in view}
