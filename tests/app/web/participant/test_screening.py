"""The screening over HTTP: pictures are drawn and answers are marked on the server."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from app.main import running_server
from app.operations.studies.create import create_study
from app.settings import Settings
from app.simulation.observer import Observer
from app.simulation.participants import begin, simulate
from app.study.options.options import parse_options
from app.study.screening.acuity import LARGEST_FIRST
from app.study.screening.pictures import read_png
from app.study.screening.viewing_distance import CARD_MM
from tests.app.web.admin.dashboard_client import signed_in
from tests.app.web.http_checks import is_problem

PATH = "/api/v1/session/screening"
CARD = {"card_widths": [CARD_MM[0] / 0.25, CARD_MM[0] / 0.252], "device_pixel_ratio": 1.0, "window_height": 800}
NewStudy = Callable[..., dict[str, Any]]
numbers = count(1)


@pytest.fixture(scope="module")
def screened(settings: Settings, stimulus_set: Path) -> NewStudy:
    """Creates a study with a screening."""

    def create(**screening: Any) -> dict[str, Any]:
        options = parse_options({"optional_stages": ["screening"], "screening": screening})
        return create_study(settings, stimulus_set, f"Screened {next(numbers)}", exposure_s=0.4, options=options)

    return create


@pytest.fixture(scope="module")
def both_tests(screened: NewStudy) -> dict[str, Any]:
    return screened()


@pytest.fixture
def enter(client: httpx.Client) -> Callable[[dict[str, Any]], httpx.Client]:
    """A browser whose participant is in the screening of a study."""

    def go(study: dict[str, Any]) -> httpx.Client:
        client.post(f"/api/v1/studies/{study['slug']}/sessions", json={"invitation": study["invitation"]})
        assert client.put("/api/v1/session/stages/introduction", json={"data": {}}).json()["stage"] == "screening"
        return client

    return go


def answered(direction: int | None) -> dict[str, Any]:
    return {"answer": direction, "response_ms": 900.5}


def rows(analyst: httpx.Client, study: dict[str, Any]) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = analyst.get(f"/api/v1/studies/{study['slug']}/screening").json()
    return found


@pytest.mark.slow
def test_artificial_participants_are_measured_as_they_are(
    client: httpx.Client, analyst: httpx.Client, both_tests: dict[str, Any]
) -> None:
    observer = Observer(acuity=0.0, lacks="deutan")
    session = begin(client, both_tests["slug"], both_tests["invitation"], observer, np.random.default_rng(2))
    assert session["stage"] == "trial"  # a failure is recorded; the experimenter decides
    acuity, colour = (row for row in rows(analyst, both_tests) if row["session"] == session["session"])
    assert (acuity["test"], acuity["verdict"]) == ("acuity", "passed")
    assert 10 <= acuity["n_answered"] < 24  # it was certain before
    assert abs(acuity["logmar"]) <= 0.2
    assert acuity["low"] <= acuity["logmar"] <= acuity["high"]
    assert acuity["smallest"] <= acuity["limit"] == 0.18
    assert acuity["distance_source"] == "typed"
    assert (colour["test"], colour["verdict"]) == ("colour", "failed")
    assert colour["n_answered"] < 18
    assert "deutan" in colour["details"]["failed_axes"]
    text = analyst.get(f"/api/v1/studies/{both_tests['slug']}/screening?format=csv").text
    assert text.startswith("participant,session,test,verdict,logmar,")


@pytest.mark.slow
def test_whole_studies_are_simulated_with_their_screening(
    server: str, token: str, analyst: httpx.Client, screened: NewStudy
) -> None:
    study = screened(distance="blind spot")
    assert simulate(server, study["slug"], study["invitation"], token, 1)["votes"] == 6
    assert {row["verdict"] for row in rows(analyst, study)} == {"passed"}


@pytest.mark.slow
def test_the_rule_of_a_study_may_end_it_for_who_fails(
    client: httpx.Client, analyst: httpx.Client, screened: NewStudy
) -> None:
    study = screened(tests=["colour"], on_failure="stop")
    session = begin(client, study["slug"], study["invitation"], Observer(lacks="protan"), np.random.default_rng(1))
    assert session["stage"] == "screened_out"
    assert client.get("/api/v1/session/trials/next").status_code == 204
    again = client.put("/api/v1/session/stages/screening", json={"data": {}})  # its answer was lost
    assert again.json()["stage"] == "screened_out"
    assert is_problem(client.put("/api/v1/session/stages/trial", json={"data": {}}), 409)
    (row,) = rows(analyst, study)
    assert row["verdict"] == "failed"


@pytest.mark.slow
def test_an_entered_result_counts_instead_of_a_test_that_was_not_taken(
    enter: Callable[[dict[str, Any]], httpx.Client],
    analyst: httpx.Client,
    server: str,
    settings: Settings,
    screened: NewStudy,
) -> None:
    study = screened(tests=["acuity"], on_failure="stop")
    client = enter(study)
    assert client.put(f"{PATH}/acuity/skip", json={"reason": "no card"}).status_code == 204
    page = f"/admin/studies/{study['slug']}/participants/P001"
    chart = {"test": "acuity", "instrument": "Landolt C chart at 4 m"}
    with signed_in(server, settings, f"Eva of {study['slug']}") as eva:
        refused = eva.act(f"{page}/screening", **chart, result="20/40", logmar="0.3", verdict="passed")
        assert refused.status_code == 422
        assert "Nothing was entered" in refused.text
        assert eva.act(f"{page}/screening", **chart, result="  ", verdict="failed").status_code == 422
        eva.act(f"{page}/screening", **chart, result="20/40", logmar="0.3", verdict="failed")
        shown = eva.act(f"{page}/screening", **chart, result="20/20, with glasses", logmar="0", verdict="passed").text
        last = "Acuity: passed by Landolt C chart at 4 m, read as 20/20, with glasses (0.00 logMAR (20/20))."
        first = "Acuity: failed by Landolt C chart at 4 m, read as 20/40 (0.30 logMAR (20/40))."
        assert shown.index(first) < shown.index(last)
        log = eva.get("/admin/audit", params={"search": "screening result entered"}).text
        assert "screening result entered" in log
        assert "verdict" not in log  # which would outlive an erasure
    assert client.put("/api/v1/session/stages/screening", json={"data": {}}).json()["stage"] == "trial"
    on_screen, first, second = rows(analyst, study)
    assert (on_screen["verdict"], on_screen["result_source"]) == ("not taken", "screen")
    assert (first["verdict"], first["logmar"], second["result"]) == ("failed", 0.3, "20/20, with glasses")
    assert {first["result_source"], second["result_source"]} == {"entered"}
    assert second["experimenter"] == f"Eva of {study['slug']}"


def test_what_was_not_taken_is_recorded_as_that(
    enter: Callable[[dict[str, Any]], httpx.Client], analyst: httpx.Client, screened: NewStudy
) -> None:
    study = screened()
    client = enter(study)
    assert client.put(f"{PATH}/acuity/skip", json={"reason": "no card"}).status_code == 204
    assert client.get(f"{PATH}/acuity").status_code == 204
    assert client.put("/api/v1/session/stages/screening", json={"data": {}}).json()["stage"] == "trial"
    acuity, colour = rows(analyst, study)
    assert (acuity["verdict"], acuity["details"]) == ("not taken", {"reason": "no card"})
    assert (colour["verdict"], colour["logmar"]) == ("not taken", None)


def test_a_card_that_is_measured_differently_twice_is_measured_again(
    enter: Callable[[dict[str, Any]], httpx.Client], both_tests: dict[str, Any]
) -> None:
    client = enter(both_tests)
    assert is_problem(client.put(f"{PATH}/distance", json={"typed_cm": 90.0}), 409)
    assert is_problem(client.put(f"{PATH}/display", json=CARD | {"card_widths": [340.0, 350.0]}), 422)
    assert is_problem(client.put(f"{PATH}/display", json=CARD | {"card_widths": [8.0, 8.0]}), 422)
    assert is_problem(client.get(f"{PATH}/acuity"), 409)
    assert client.put(f"{PATH}/display", json=CARD).json()["pixel_mm"] == pytest.approx(0.251, abs=1e-4)
    sharper = CARD | {"device_pixel_ratio": 2.0}
    assert client.put(f"{PATH}/display", json=sharper).json()["pixel_mm"] == pytest.approx(0.1255, abs=1e-4)


def test_a_display_says_from_where_it_can_certify(
    enter: Callable[[dict[str, Any]], httpx.Client], both_tests: dict[str, Any]
) -> None:
    """Two pixels of 0.251 mm are 1.5 arc minutes wide from 1.14 m."""
    client = enter(both_tests)
    client.put(f"{PATH}/display", json=CARD)
    for wrong in ({"typed_cm": 5.0}, {}, {"typed_cm": 90.0, "blind_spots": [500.0] * 5}, {"blind_spots": [500.0] * 4}):
        assert is_problem(client.put(f"{PATH}/distance", json=wrong), 422)
    assert is_problem(client.put(f"{PATH}/distance", json={"blind_spots": [400.0, 700.0, 500.0, 500.0, 500.0]}), 422)
    near = client.put(f"{PATH}/distance", json={"blind_spots": [500.0, 510.0, 520.0, 530.0, 640.0 - 30]}).json()
    assert near["certificate"] == {"can_certify": False, "distance_cm": 54.4, "needed_distance_cm": 115}
    assert near["seat_cm"] == 54.4
    far = client.put(f"{PATH}/distance", json={"typed_cm": 115.0}).json()
    assert far["certificate"]["can_certify"]
    assert far["seat_cm"] == 54.4, "the films are seen from where the participant sat at first"
    assert client.get(f"{PATH}/acuity").status_code == 200
    assert is_problem(client.put(f"{PATH}/distance", json={"typed_cm": 60.0}), 409)
    assert is_problem(client.put(f"{PATH}/display", json=CARD), 409)


def test_a_test_has_begun_as_soon_as_its_first_picture_is_served(
    enter: Callable[[dict[str, Any]], httpx.Client], both_tests: dict[str, Any]
) -> None:
    client = enter(both_tests)
    client.put(f"{PATH}/display", json=CARD)
    client.put(f"{PATH}/distance", json={"typed_cm": 200.0})
    states = [client.get(PATH).json()["tests"]]
    client.get(f"{PATH}/acuity")
    states.append(client.get(PATH).json()["tests"])
    assert [[one["has_begun"] for one in tests] for tests in states] == [[False, False], [True, False]]
    assert states[1][0]["n_answered"] == 0


@pytest.mark.slow
def test_a_laboratory_may_fix_the_distance(enter: Callable[[dict[str, Any]], httpx.Client], screened: NewStudy) -> None:
    client = enter(screened(distance="fixed", distance_cm=200))
    measured = client.put(f"{PATH}/display", json=CARD).json()
    assert (measured["fixed_distance_cm"], measured["certificate"]["distance_cm"]) == (200, 200)


def test_where_the_lab_sheet_has_the_distance_nobody_types_it_or_is_told_to_move_back(
    client: httpx.Client, settings: Settings, stimulus_set: Path
) -> None:
    content = {"optional_stages": ["screening"], "lab_sheet": {"distance_cm": 90.0}}
    study = create_study(settings, stimulus_set, "Own room", exposure_s=0.4, options=parse_options(content))
    client.post(f"/api/v1/studies/{study['slug']}/sessions", json={"invitation": study["invitation"]})
    client.put("/api/v1/session/stages/introduction", json={"data": {}})
    assert client.get(PATH).json()["distance"] == "fixed"
    measured = client.put(f"{PATH}/display", json=CARD).json()
    assert (measured["seat_cm"], measured["certificate"]["distance_cm"]) == (90.0, 90.0)


@pytest.mark.slow
def test_an_item_tells_what_to_show_and_not_what_is_right(
    enter: Callable[[dict[str, Any]], httpx.Client], both_tests: dict[str, Any]
) -> None:
    client = enter(both_tests)
    client.put(f"{PATH}/display", json=CARD)
    client.put(f"{PATH}/distance", json={"typed_cm": 200.0})
    for test, n_choices in (("acuity", 8), ("colour", 4)):
        answer = client.get(f"{PATH}/{test}")
        item = answer.json()
        assert item.keys() == {"test", "number", "total", "picture", "size", "choices", "may_be_nothing"}
        assert len(item["choices"]) == n_choices
        picture = client.get(item["picture"])
        assert picture.headers["content-type"] == "image/png"
        assert not [
            name
            for name in picture.headers
            if name.startswith("x-") and name not in ("x-content-type-options", "x-frame-options", "x-request-id")
        ]
        assert b"gap" not in picture.content + answer.content
    ring = client.get(f"{PATH}/acuity").json()
    assert ring["size"] == LARGEST_FIRST
    gap_px = 2 * 2000 * np.tan(np.radians(10 / 60) / 2) / 0.251
    assert len(read_png(client.get(ring["picture"]).content)) == pytest.approx(5 * gap_px + 4, abs=2)


def test_an_answer_counts_once_and_is_not_changed(
    enter: Callable[[dict[str, Any]], httpx.Client], both_tests: dict[str, Any]
) -> None:
    client = enter(both_tests)
    first = client.get(f"{PATH}/colour").json()
    assert client.get(f"{PATH}/colour").json() == first  # until it is answered
    assert is_problem(client.put(f"{PATH}/colour/2", json=answered(0)), 404)
    assert is_problem(client.put(f"{PATH}/colour/1", json=answered(1)), 422)  # plates have four directions
    assert is_problem(client.put(f"{PATH}/colour/1", json=answered(8)), 422)
    second = client.put(f"{PATH}/colour/1", json=answered(2)).json()
    assert second["number"] == 2
    assert client.put(f"{PATH}/colour/1", json=answered(2)).json() == second
    assert is_problem(client.put(f"{PATH}/colour/1", json=answered(4)), 409)
    assert client.put(f"{PATH}/colour/2", json=answered(None)).json()["number"] == 3


def test_rings_are_always_answered(enter: Callable[[dict[str, Any]], httpx.Client], both_tests: dict[str, Any]) -> None:
    client = enter(both_tests)
    client.put(f"{PATH}/display", json=CARD)
    client.put(f"{PATH}/distance", json={"typed_cm": 200.0})
    client.get(f"{PATH}/acuity")
    assert is_problem(client.put(f"{PATH}/acuity/1", json=answered(None)), 422)
    assert client.put(f"{PATH}/acuity/1", json=answered(7)).json()["number"] == 2


@pytest.mark.slow
def test_a_test_goes_on_at_another_server_of_the_same_database(
    enter: Callable[[dict[str, Any]], httpx.Client], both_tests: dict[str, Any], settings: Settings
) -> None:
    client = enter(both_tests)
    client.get(f"{PATH}/colour")
    second = client.put(f"{PATH}/colour/1", json=answered(0)).json()
    picture = client.get(second["picture"]).content
    with running_server(settings) as other:
        elsewhere = httpx.Client(base_url=other, cookies=client.cookies, timeout=30)
        assert elsewhere.get(f"{PATH}/colour").json() == second
        assert elsewhere.get(second["picture"]).content == picture
        assert elsewhere.put(f"{PATH}/colour/2", json=answered(0)).json()["number"] == 3
        elsewhere.close()


@pytest.mark.slow
def test_there_is_no_screening_where_a_study_has_none(
    participant: httpx.Client, enter: Callable[[dict[str, Any]], httpx.Client], screened: NewStudy
) -> None:
    assert is_problem(participant.get(PATH), 404)
    client = enter(screened(tests=["colour"]))
    assert is_problem(client.get(f"{PATH}/acuity"), 404)
    assert is_problem(client.get(f"{PATH}/hearing"), 422)
    assert [one["test"] for one in client.get(PATH).json()["tests"]] == ["colour"]
    client.put("/api/v1/session/stages/screening", json={"data": {}})
    assert is_problem(client.get(PATH), 409)


def test_participants_do_not_read_what_was_found(client: httpx.Client, both_tests: dict[str, Any]) -> None:
    assert is_problem(client.get(f"/api/v1/studies/{both_tests['slug']}/screening"), 401)
