"""A plan is one: the command, the Design page and REST take the same inputs, refuse alike and give the same numbers."""

from __future__ import annotations

import html
import json
import re
from typing import Any

import httpx
import pytest

from app.operations.jobs.forms import fields_of
from app.operations.planning import REPLICATES
from tests.app.web.admin.dashboard_client import Dashboard
from tests.app.web.http_checks import is_problem
from tests.command_line import Command

pytestmark = pytest.mark.slow
ASKED: dict[str, Any] = {
    "participants": 14,
    "effect": 1.5,
    "claim": "pair",
    "spread": 0.6,
    "tie_rate": 0.3,
    "by_dataset": 0.2,
    "dataset_spread": 0.1,
    "drop_out": 0.1,
    "careless": 0.2,
}
SIZE = {"conditions": 3, "datasets": 2}
WRONG = [
    *(("participants", wrong) for wrong in (1, 10_001, "many")),
    *(("effect", wrong) for wrong in (0, -1, 11, "nan")),
    *((name, wrong) for name in ("spread", "by_dataset", "dataset_spread") for wrong in (-0.1, 11)),
    *((name, wrong) for name in ("tie_rate", "drop_out", "careless") for wrong in (-0.1, 1)),
    *(("inconsistency", wrong) for wrong in (0, 11)),
    ("claim", "all"),
]


def flags(asked: dict[str, Any]) -> list[Any]:
    return [part for name, value in asked.items() for part in (f"--{name.replace('_', '-')}", value)]


def plain(page: str) -> str:
    return " ".join(re.sub(r"<[^>]*>", " ", html.unescape(page)).split())


def test_the_command_and_rest_give_the_same_numbers_for_the_same_inputs(
    command: Command, server: str, token: str, taken: dict[str, Any]
) -> None:
    told = json.loads(command("plan", *flags({**SIZE, **ASKED, "replicates": REPLICATES}), "--json").out)
    headers = {"Authorization": f"Bearer {token}"}
    with httpx.Client(base_url=f"{server}/api/v1/", headers=headers, timeout=60) as client:
        of_study = client.get(f"studies/{taken['slug']}/plan", params=ASKED).json()
        assert client.get("plan", params={**SIZE, **ASKED}).json() == of_study
    assert of_study["power"] == {"one_dataset": told["power_one_dataset"], "all_datasets": told["power_pooled"]}
    found = {"one_dataset": told["detectable_jod_one_dataset"], "all_datasets": told["detectable_jod_pooled"]}
    assert of_study["detectable"] == found
    assert of_study["clickers_named"]["with_checks"] > 0
    same = ["claims", "participants_wanted", "clickers_named", "replicates", *SIZE, *(set(ASKED) - {"effect"})]
    assert {name: of_study[name] for name in same} == {name: told[name] for name in same}


def test_the_command_and_rest_plan_ratings_alike(command: Command, server: str, token: str) -> None:
    asked = {**SIZE, "inconsistency": 1.1, "dataset_spread": 0.3}
    told = json.loads(command("plan", *flags({**asked, "replicates": REPLICATES}), "--protocol", "DCR", "--json").out)
    headers = {"Authorization": f"Bearer {token}"}
    plan = httpx.get(f"{server}/api/v1/plan", params={**asked, "is_rated": True}, headers=headers, timeout=60).json()
    assert (plan["claims"], plan["inconsistency"], plan["clickers_named"]) == (told["claims"], 1.1, None)


def test_the_design_page_asks_what_the_command_asks_and_says_what_it_answers(
    command: Command, experimenter: Dashboard, taken: dict[str, Any]
) -> None:
    told = json.loads(command("plan", *flags({**SIZE, **ASKED, "replicates": REPLICATES}), "--json").out)
    page = experimenter.design(f"/admin/studies/{taken['slug']}/design", **ASKED)
    for name, value in ASKED.items():
        chosen = rf'<option value="{value}" selected' if name == "claim" else rf'name="{name}"[^>]* value="{value}"'
        assert re.search(chosen, page), name
    text, named = plain(page), told["clickers_named"]
    assert f"in {100 * told['power_pooled']:.0f} % over all 2" in text
    for row in told["claims"]:
        assert f"{row['what']} {100 * row['power']:.0f} ± {100 * row['power_error']:.0f} %" in text
    assert f"{100 * named['by_votes']:.0f} ± {100 * named['by_votes_error']:.0f} % by their votes alone" in text
    assert f"{told['participants_wanted']['participants']} participants" in text
    assert f"{told['detectable_jod_pooled']:.2f} JOD over all" in text


@pytest.mark.parametrize(("name", "wrong"), WRONG)
def test_the_command_rest_and_the_page_refuse_alike(
    command: Command, experimenter: Dashboard, server: str, token: str, taken: dict[str, Any], name: str, wrong: Any
) -> None:
    refused = command("plan", *flags({**SIZE, name: wrong}))
    assert refused.code == 2
    headers = {"Authorization": f"Bearer {token}"}
    for path, size in ((f"studies/{taken['slug']}/plan", {}), ("plan", SIZE)):
        answer = httpx.get(f"{server}/api/v1/{path}", params={**size, name: wrong}, headers=headers)
        assert is_problem(answer, 422)
        expected = re.search("expected .*", answer.json()["errors"][0]["message"])
        assert expected
        assert expected[0] in " ".join(re.sub("[│╭╰─╮╯]", " ", refused.err).split())
    page = experimenter.get(f"/admin/studies/{taken['slug']}/design", params={"participants": 5, name: wrong})
    assert page.status_code == 422
    assert f"{name.replace('_', ' ')} is" in plain(page.text)
    assert expected[0] in plain(page.text)


@pytest.mark.parametrize("wrong", [{"careless": 1}, {"participants": 501}])
def test_the_design_page_shows_what_was_asked_once_more_where_it_is_refused(
    experimenter: Dashboard, server: str, taken: dict[str, Any], wrong: dict[str, Any]
) -> None:
    address, asked = f"/admin/studies/{taken['slug']}/design", {"participants": 5, **wrong}
    page = experimenter.get(address, params=asked, headers={"Referer": f"{server}{address}"})
    assert page.status_code == 422
    assert "How many participants?" in page.text
    refused = re.search(r'id="refused"[^>]*', page.text)
    assert refused
    assert all(f'["{name}", "{value}"]' in html.unescape(refused[0]) for name, value in asked.items())


def test_a_plan_that_keeps_the_server_busy_for_long_is_refused_by_rest_and_the_page(
    experimenter: Dashboard, server: str, token: str, taken: dict[str, Any]
) -> None:
    headers, people = {"Authorization": f"Bearer {token}"}, {"participants": 501}
    for size in (SIZE | people, {"conditions": 50}):
        assert is_problem(httpx.get(f"{server}/api/v1/plan", params=size, headers=headers), 422)
    page = experimenter.get(f"/admin/studies/{taken['slug']}/design", params=people)
    assert page.status_code == 422
    assert "reconstudy plan" in page.text


def test_every_input_that_the_page_offers_is_a_parameter_of_rest(server: str) -> None:
    paths = httpx.get(f"{server}/api/v1/openapi.json").json()["paths"]
    offered = {field.name for field in fields_of("plan", {})}
    for path in ("/api/v1/plan", "/api/v1/studies/{slug}/plan"):
        taken_in = {each["name"] for each in paths[path]["get"]["parameters"]}
        assert offered <= taken_in
