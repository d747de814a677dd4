"""Invitations are labelled, handed out on paper and by mail; chance assigns who comes to groups."""

from __future__ import annotations

import csv
import io
from codecs import BOM_UTF8
from collections import Counter
from collections.abc import Callable
from typing import Any

import httpx
import pytest

from app.simulation.participants import begin
from app.web.admin.participants.invitations_page import split_label
from tests.app.web.admin.dashboard_client import Dashboard

NewStudy = Callable[[], dict[str, Any]]


def table(dashboard: Dashboard, path: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(dashboard.get(path).raise_for_status().content.decode("utf-8-sig"))))


@pytest.mark.slow
def test_a_list_of_people_becomes_labelled_invitations_to_mail_and_to_print(
    experimenter: Dashboard, client: httpx.Client, server: str, new_study: NewStudy
) -> None:
    study = new_study()
    base = f"/admin/studies/{study['slug']}/invitations"
    people = "Ada Example, ada@example.org\r\n\r\nBen  Example\r\n=cmd()"
    assert experimenter.act(f"{base}/people", people=" \n ").status_code == 422
    assert experimenter.act(f"{base}/people", people="x" * 201).status_code == 422
    assert experimenter.act(f"{base}/people", people="\n".join("abc" for _ in range(201))).status_code == 422
    page = experimenter.act(f"{base}/people", people=people).text
    assert "<strong>Ben Example</strong>" in page
    rows = table(experimenter, f"{base}/invitations.csv")
    assert [row["label"] for row in rows] == ["", "Ada Example, ada@example.org", "Ben Example", "'=cmd()"]
    ada, ben = (row for row in rows if "Example" in row["label"])
    assert ada["link"] == f"{server}/s/{ada['code']}"
    mail = table(experimenter, f"{base}/mail-merge.csv")
    assert experimenter.get(f"{base}/mail-merge.csv").content.startswith(BOM_UTF8)  # office programs need it
    assert mail[0] == {"name": "Ada Example", "email": "ada@example.org", "link": ada["link"]}
    experimenter.act(f"{base}/{ben['code']}/label", label="Bea\nExample")
    assert experimenter.act(f"{base}/forged/label", label="x").status_code == 404
    sheet = experimenter.get(f"{base}/print").text
    assert sheet.count("<svg") == 4
    assert "Bea Example" in sheet
    begin(client, study["slug"], ada["code"])
    assert [row["name"] for row in table(experimenter, f"{base}/mail-merge.csv")] == ["Bea Example", "'=cmd()"]
    experimenter.act(f"/admin/studies/{study['slug']}/participants/P001/erase", again="P001")
    assert "ada@example.org" not in experimenter.get(f"{base}/invitations.csv").text


def test_a_link_stays_one_persons_when_they_take_part_again(
    experimenter: Dashboard, client: httpx.Client, new_study: NewStudy
) -> None:
    study = new_study()
    base = f"/admin/studies/{study['slug']}"
    experimenter.act(f"{base}/invitations/{study['invitation']}/end")
    experimenter.act(f"{base}/invitations/people", people="Ada Example, ada@example.org")
    (ada,) = table(experimenter, f"{base}/invitations/invitations.csv")
    begin(client, study["slug"], ada["code"])
    experimenter.act(f"{base}/participants/P001/exclude", reason="restless")
    experimenter.act(f"{base}/participants/P001/again")
    assert f"/s/{ada['code']}" not in experimenter.get(base).text
    assert "for one participant" in experimenter.get(f"{base}/invitations/print").text
    assert "restless" in experimenter.get(f"{base}/participants/P001").text
    assert "ada@example.org" in experimenter.get(f"{base}/participants/P001/export.json").text
    begin(client, study["slug"], ada["code"])
    experimenter.act(f"{base}/participants/P001/erase", again="P001")
    assert "ada@example.org" not in experimenter.get(f"{base}/invitations/invitations.csv").text


def test_the_overview_gives_nobody_the_link_of_one_person(experimenter: Dashboard, new_study: NewStudy) -> None:
    study = new_study()
    base = f"/admin/studies/{study['slug']}"
    experimenter.act(f"{base}/invitations/people", people="Ada Example, ada@example.org")
    assert f"/s/{study['invitation']}" in experimenter.get(base).text
    experimenter.act(f"{base}/invitations/{study['invitation']}/end")
    assert "Participants begin at" not in experimenter.get(base).text


@pytest.mark.parametrize(
    ("label", "parts"),
    [
        ("Ada Example <ada@example.org>", ("Ada Example", "ada@example.org")),
        ("Example, Ada, ada@example.org", ("Example, Ada", "ada@example.org")),
        ("ada@example.org", ("ada@example.org", "ada@example.org")),
        ('"Groß, Jürgen" <j.gross@example.org>', ("Groß, Jürgen", "j.gross@example.org")),
        ("王小明; x@example.org", ("王小明", "x@example.org")),
        ("Lab, Tuesday", ("Lab, Tuesday", "")),
    ],
)
def test_a_label_is_split_into_name_and_address(label: str, parts: tuple[str, str]) -> None:
    assert split_label(label) == parts


@pytest.mark.slow
def test_who_begins_is_assigned_to_a_group_that_is_recorded(
    experimenter: Dashboard, analyst: httpx.Client, server: str, new_study: NewStudy
) -> None:
    study = new_study()
    base = f"/admin/studies/{study['slug']}/invitations"
    refused = experimenter.act(f"{base}/groups", revision="1", groups="near: boll\nfar")
    assert refused.status_code == 422
    assert "there is no dataset" in refused.text
    page = experimenter.act(f"{base}/groups", revision="1", groups="near: ball\r\nfar").text
    assert ">ball</td>" in page
    for _ in range(4):
        with httpx.Client(base_url=server) as somebody:
            begin(somebody, study["slug"], study["invitation"])
    people = analyst.get(f"/api/v1/studies/{study['slug']}/participants").json()
    assert Counter(row["group"] for row in people) == {"near": 2, "far": 2}
    trials = analyst.get(f"/api/v1/studies/{study['slug']}/trials").json()
    near = {row["participant"] for row in people if row["group"] == "near"}
    assert {row["dataset"] for row in trials if row["participant"] in near} == {"ball"}
    assert len({row["dataset"] for row in trials if row["participant"] not in near}) > 1
    assert experimenter.act(f"{base}/groups", revision="2", groups="").status_code == 409
    design = experimenter.design(f"/admin/studies/{study['slug']}/design")
    assert "as planned" in design
    assert "not as planned" not in design
