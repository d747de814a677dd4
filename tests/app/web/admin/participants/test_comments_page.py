"""Comments are read in one place, coded by tags of one's own, and who took part is summed up."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from app.operations.studies.create import create_study
from app.settings import Settings
from app.simulation.participants import simulate
from app.store.participants.comments import LONGEST_COMMENT
from app.study.options.options import parse_options
from tests.app.web.admin.dashboard_client import Dashboard, signed_in

pytestmark = pytest.mark.slow
QUESTIONS = [
    {"name": "age", "kind": "number", "required": True},
    {"name": "criteria", "kind": "text", "required": True},
]


@pytest.fixture(scope="module")
def asked(settings: Settings, stimulus_set: Path, server: str, token: str) -> dict[str, Any]:
    """A study whose two participants have written a comment each."""
    content = {"optional_stages": ["interview"], "questions": QUESTIONS, "spoken_questions": ["Anything else?"]}
    made = create_study(settings, stimulus_set, "Commented", exposure_s=0.4, options=parse_options(content))
    simulate(server, made["slug"], made["invitation"], token, 2)
    return made


@pytest.fixture
def coder(server: str, settings: Settings) -> Iterator[Dashboard]:
    with signed_in(server, settings, "Cora", "experimenter") as dashboard:
        yield dashboard


def test_comments_are_noted_tagged_counted_exported_and_erased(
    coder: Dashboard, analyst: httpx.Client, asked: dict[str, Any]
) -> None:
    base, rest = f"/admin/studies/{asked['slug']}", f"/api/v1/studies/{asked['slug']}"
    comments = f"{base}/participants/comments"
    coder.act(f"{base}/participants/P001/interview", question="Anything else?", answer="=The <faces>")
    trial = analyst.get(f"{rest}/trials").json()[0]
    assert "waxy" in coder.act(f"{base}/votes/{trial['trial']}/comment", comment="said it looked waxy").text
    assert coder.act(f"{base}/votes/forged/comment", comment="x").status_code == 404
    page = coder.get(comments).text
    assert "4 comments of 2 participants: 2 questionnaire, 1 interview, 1 on a trial" in page
    assert "=The &lt;faces&gt;" in page
    assert "What made one model look better" in page

    spoken = {"participant": "P001", "source": "spoken", "subject": "Anything else?"}
    on_trial = {"participant": "P001", "source": "trial", "subject": trial["trial"]}
    written = {"participant": "P002", "source": "written", "subject": "criteria"}
    for place in (spoken, on_trial, written):
        coder.act(f"{comments}/tag", **place, tag="faces")
    coder.act(f"{comments}/tag", **spoken, tag=" skin \n tone ")
    assert coder.act(f"{comments}/tag", **spoken | {"subject": "forged"}, tag="faces").status_code == 404
    assert coder.act(f"{comments}/tags", tag="faces").status_code == 409
    assert analyst.get(f"{rest}/comment_tags").json() == [
        {"tag": "faces", "n_comments": 3, "n_participants": 2},
        {"tag": "skin tone", "n_comments": 1, "n_participants": 1},
    ]
    assert coder.act(f"{comments}/tags/rename", tag="skin tone", new="faces").status_code == 409
    coder.act(f"{comments}/tags/rename", tag="skin tone", new="skin")
    assert "1 comment of 1 participant" in coder.get(comments, params={"tag": "skin"}).text
    assert "1 comment of 1 participant" in coder.get(comments, params={"untagged": "true"}).text
    assert "2 comments of 2 participants" in coder.get(comments, params={"source": "written"}).text
    assert 'page=1#comment-2"' in coder.get(comments, params={"tag": "faces"}).text
    back = coder.act(f"{comments}/tag", **spoken, tag="skin", take_off="true", back="tag=faces&page=1#comment-2")
    assert "3 comments of 2 participants" in back.text
    assert back.url.fragment == "comment-2"
    assert 'id="comment-2"' in back.text
    table = list(csv.DictReader(io.StringIO(analyst.get(f"{rest}/comments?format=csv").text)))
    assert [(row["participant"], row["source"], row["tags"]) for row in table] == [
        ("P001", "written", "[]"),
        ("P001", "spoken", '["faces"]'),
        ("P001", "trial", '["faces"]'),
        ("P002", "written", '["faces"]'),
    ]
    assert table[1]["comment"] == "'=The <faces>"

    log = coder.get("/admin/audit", params={"search": "comment tagged"}).text
    assert "P001" in log
    assert "faces" not in log  # what a tag says of somebody would outlive an erasure

    person = coder.get(f"{base}/participants/P001").text
    assert person.index("What made one model look better") < person.index("said it looked waxy")
    coder.act(f"{base}/participants/P001/erase", again="P001")
    assert analyst.get(f"{rest}/comment_tags").json()[0]["n_comments"] == 1
    refused = coder.act(f"{base}/votes/{trial['trial']}/comment", comment="what a colleague told me of them")
    assert (refused.status_code, "P001 was erased" in refused.text) == (422, True)
    assert coder.act(f"{comments}/tags/delete", tag="faces").status_code == 422
    assert coder.act(f"{comments}/tags/delete", tag="faces", again="face").status_code == 422
    assert analyst.get(f"{rest}/comment_tags").json()[0]["n_comments"] == 1
    coder.act(f"{comments}/tags/delete", tag="faces", again="faces")
    assert [row["tags"] for row in analyst.get(f"{rest}/comments").json()] == [[]]


def test_a_note_on_a_trial_replaces_no_other_that_its_writer_has_not_seen(
    coder: Dashboard, analyst: httpx.Client, asked: dict[str, Any], server: str, settings: Settings
) -> None:
    trial = analyst.get(f"/api/v1/studies/{asked['slug']}/trials?participant=P002").json()[0]["trial"]
    replay = f"/admin/studies/{asked['slug']}/votes/{trial}"
    coder.act(f"{replay}/comment", comment="waxy\r\nskin", seen="")
    with signed_in(server, settings, "Cyril", "experimenter") as other:
        late = other.act(f"{replay}/comment", comment="a long thought of another", seen="")
        assert late.status_code == 409
        assert "a long thought of another" in late.text
        assert "waxy\nskin</textarea>" in other.get(replay).text
        other.act(f"{replay}/comment", comment="waxy\r\nskin", seen="waxy\r\nskin")
        assert "Noted by Cora" in other.get(replay).text, "nothing was changed"
        long = {"comment": "\r\n".join("x" * (LONGEST_COMMENT // 2)), "seen": "waxy\nskin"}
        assert other.act(f"{replay}/comment", **long).status_code == 200
        assert other.act(f"{replay}/comment", comment="x" * (LONGEST_COMMENT + 1)).status_code == 422
    coder.act(f"{replay}/comment", comment="", seen=long["comment"])
    assert "Noted by" not in coder.get(replay).text


def test_demographics_leave_out_who_does_not_count(
    coder: Dashboard, analyst: httpx.Client, asked: dict[str, Any]
) -> None:
    base, rest = f"/admin/studies/{asked['slug']}/participants", f"/api/v1/studies/{asked['slug']}"
    coder.act(f"{base}/P002/exclude", reason="colour vision")
    rows = analyst.get(f"{rest}/demographics").json()
    (row,) = [row for row in rows if row["among"] == "everybody" and row["question"] == "age" and row["answer"] is None]
    answers = [given["answer"] for given in analyst.get(f"{rest}/questionnaire").json() if given["question"] == "age"]
    assert (row["n"], row["maximum"]) == (len(answers), max(answers))
    assert f"{row['n']} participant" in coder.get(f"{base}/demographics", params={"among": "everybody"}).text
    n_counted = sum(row["n"] for row in rows if row["among"] == "counted" and row["mean"] is not None)
    assert n_counted == row["n"] - 1
    coder.act(f"{base}/P002/include")


def test_withdrawing_somebody_takes_the_label_typed_again(coder: Dashboard, asked: dict[str, Any]) -> None:
    person = f"/admin/studies/{asked['slug']}/participants/P002"
    for again in ("", "P001"):
        assert coder.act(f"{person}/withdraw", again=again).status_code == 422
    assert 'state-open">counts' in coder.get(person).text
    page = coder.act(f"{person}/withdraw", again="P002").text
    assert re.search(r'class="state[^"]*">withdrawn', page)


def test_answers_and_comments_say_whether_their_participant_counts(
    coder: Dashboard, analyst: httpx.Client, settings: Settings, stimulus_set: Path, server: str, token: str
) -> None:
    content = {"optional_stages": ["interview"], "questions": QUESTIONS}
    made = create_study(settings, stimulus_set, "Counted", exposure_s=0.4, options=parse_options(content))
    simulate(server, made["slug"], made["invitation"], token, 3)
    base, rest = f"/admin/studies/{made['slug']}/participants", f"/api/v1/studies/{made['slug']}"
    chart = {"test": "colour", "instrument": "plates", "result": "read", "verdict": "passed"}
    for label in ("P001", "P002", "P003"):
        coder.act(f"{base}/{label}/screening", **chart)
    tables = ("questionnaire", "comments", "screening", "votes")
    before = {name: analyst.get(f"{rest}/{name}").headers["etag"] for name in tables}
    coder.act(f"{base}/P002/exclude", reason="asleep")
    coder.act(f"{base}/P003/withdraw", again="P003")
    for name in tables:
        rows = analyst.get(f"{rest}/{name}", headers={"If-None-Match": before[name]}).json()
        counting = {(row["participant"], row["excluded"], row["reason"]) for row in rows}
        assert counting == {("P001", False, ""), ("P002", True, "asleep"), ("P003", True, "withdrawn")}, name
    page = coder.get(f"{base}/comments").text
    assert page.count("does not count: asleep") == page.count("does not count: withdrawn") == 1
