"""Texts, images, design, plan and figures of a study over REST."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any
from uuid import uuid4

import httpx
import pytest

from app.operations.studies import manage
from app.settings import Settings
from app.store.access.rights import SCOPES
from tests.app.web.http_checks import is_problem

pytestmark = pytest.mark.slow
PIXEL = b"\x89PNG\r\n\x1a\n" + bytes(20)


@pytest.fixture
def manager(server: str, settings: Settings) -> Iterator[httpx.Client]:
    token = manage.add_token(settings, f"material {uuid4()}", list(SCOPES))["token"]
    headers = {"Authorization": f"Bearer {token}"}
    with httpx.Client(base_url=f"{server}/api/v1/", headers=headers, timeout=60) as client:
        yield client


def test_a_studys_texts_are_read_and_changed(manager: httpx.Client, new_study: Callable[[], dict[str, Any]]) -> None:
    path = f"studies/{new_study()['slug']}/texts"
    before = manager.get(path).json()
    assert (before["first_language"], before["languages"]["en"]) == ("en", "offered")
    body = {"revision": before["revision"], "texts": {"study.consent": "I take part.", "begin.button": "Go"}}
    changed = manager.put(f"{path}/en", json=body)
    if changed.status_code == 422:  # a text that packs do not have is refused by name
        assert "begin.button" in changed.json()["detail"]
        body["texts"].pop("begin.button")
        changed = manager.put(f"{path}/en", json=body)
    assert changed.status_code == 204
    after = manager.get(path).json()
    assert after["texts"]["en"]["study.consent"] == "I take part."
    assert is_problem(manager.put(f"{path}/en", json=body), 409)
    assert is_problem(manager.put(f"{path}/xx", json=body), 404)


def test_an_image_of_the_texts_is_kept_and_sent_until_somebody_begins(
    manager: httpx.Client, new_study: Callable[[], dict[str, Any]], taken: dict[str, Any]
) -> None:
    path = f"studies/{new_study()['slug']}"
    assert manager.put(f"{path}/images/room.png", content=PIXEL).status_code == 204
    image = manager.get(f"{path}/images/room.png")
    assert (image.content, image.headers["content-type"]) == (PIXEL, "image/png")
    assert list(manager.get(f"{path}/texts").json()["images"]) == ["room.png"]
    assert manager.delete(f"{path}/images/room.png").status_code == 204
    assert is_problem(manager.get(f"{path}/images/room.png"), 404)
    assert is_problem(manager.put(f"{path}/images/room.png", content=b"<svg>"), 422)
    assert is_problem(manager.put(f"studies/{taken['slug']}/images/room.png", content=PIXEL), 409)


def test_the_design_says_what_each_person_sees_and_how_balanced_it_is(
    manager: httpx.Client, taken: dict[str, Any]
) -> None:
    design = manager.get(f"studies/{taken['slug']}/design").json()
    assert (design["n_trials"], len(design["pairs"])) == (6, 6)
    assert set(design["conditions"]) == {"id_fa", "id_fb", "pm_fb"}
    assert design["minutes"]["trial"] > 0
    assert len(design["balance"]["pairs"]) == 6


def test_a_plan_needs_no_study_and_says_what_people_can_show(manager: httpx.Client, taken: dict[str, Any]) -> None:
    of_study = manager.get(f"studies/{taken['slug']}/plan", params={"participants": 8, "effect": 1.5}).json()
    asked = {"conditions": 3, "datasets": 2, "participants": 8, "effect": 1.5}
    assert manager.get("plan", params=asked).json() == of_study
    assert 0 < of_study["power"]["one_dataset"] <= of_study["power"]["all_datasets"] <= 1
    assert of_study["claims"]
    rated = manager.get("plan", params={**asked, "is_rated": True}).json()
    assert (rated["spread"], rated["is_rated"]) == (0.0, True)
    assert [row["claim"] for row in rated["claims"]] == [row["claim"] for row in of_study["claims"]]
    assert is_problem(manager.get("plan", params={**asked, "conditions": 1}), 422)
    large = manager.get("plan", params={**asked, "conditions": 50})
    assert is_problem(large, 422)
    assert "simulates 400 at most" in large.json()["detail"]
    single = manager.get("plan", params={**asked, "conditions": 50, "datasets": 1})
    assert "50 conditions in 1 dataset has" in single.json()["detail"]


def test_every_listed_figure_is_sent_as_a_file(manager: httpx.Client, taken: dict[str, Any]) -> None:
    listed = manager.get(f"studies/{taken['slug']}/figures").json()
    assert len(listed) > 2
    first = listed[0]["figure"]
    base = f"studies/{taken['slug']}/figures"
    assert manager.get(f"{base}/{first}.svg").text.lstrip().startswith("<svg")
    assert manager.get(f"{base}/{first}.png").content.startswith(b"\x89PNG")
    assert manager.get(f"{base}/{first}.csv").headers["content-type"].startswith("text/csv")
    assert is_problem(manager.get(f"{base}/{first}.vega"), 404)
    assert is_problem(manager.get(f"{base}/none.svg"), 404)
