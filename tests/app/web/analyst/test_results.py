"""Results for analysts, as JSON and CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from typing import Any

import httpx
import pyarrow.parquet
import pytest

from app.simulation.participants import simulate
from tests.app.web.http_checks import is_problem

TABLES = ("votes", "trials", "scores", "triads")
ABILITIES = {"id_fa": -1.0, "id_fb": 0.0, "pm_fb": 1.0}


@pytest.fixture(scope="module")
def taken(server: str, token: str, new_study: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """A study that five artificial participants have taken."""
    study = new_study()
    simulate(server, study["slug"], study["invitation"], token, 5, ABILITIES, 0.2, seed=4)
    return study


def rows(analyst: httpx.Client, study: dict[str, Any], name: str, **options: Any) -> list[dict[str, Any]]:
    answer = analyst.get(f"/api/v1/studies/{study['slug']}/{name}", **options)
    assert answer.status_code == 200
    found: list[dict[str, Any]] = answer.json()
    return found


def test_a_study_tells_what_it_compares_and_how_far_it_is(analyst: httpx.Client, taken: dict[str, Any]) -> None:
    found = analyst.get(f"/api/v1/studies/{taken['slug']}").json()
    assert found["datasets"] == ["ball", "box"]
    assert found["conditions"][2] == {"item": "pm_fb", "levels": {"depth": "pm", "fusion": "fb"}}
    assert (found["n_pairs"], found["n_started"], found["n_finished"], found["n_votes"]) == (6, 5, 5, 30)
    summary = next(row for row in analyst.get("/api/v1/studies").json() if row["slug"] == taken["slug"])
    assert summary.items() <= found.items()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["votes", "scores", "analysis", "archive.zip"])
def test_head_answers_the_headers_of_a_table_alone(
    server: str, analyst: httpx.Client, taken: dict[str, Any], name: str
) -> None:
    address = f"/api/v1/studies/{taken['slug']}/{name}"
    head, whole = analyst.head(address), analyst.get(address)
    assert (head.status_code, head.content) == (200, b"")
    for header in ("etag", "content-type", "vary"):
        assert head.headers[header] == whole.headers[header]
    assert head.headers.get("x-total-count") == whole.headers.get("x-total-count")
    assert analyst.head(address, headers={"If-None-Match": whole.headers["etag"]}).status_code == 304
    assert httpx.head(server + address).status_code == 401


@pytest.mark.slow
def test_head_is_answered_wherever_something_is_read(analyst: httpx.Client) -> None:
    described = analyst.get("/api/v1/openapi.json").json()["paths"]
    read = [path for path, methods in described.items() if "get" in methods]
    assert "/api/v1/jobs" in read
    assert not any("head" in methods for methods in described.values())
    assert {path: status for path in read if (status := analyst.head(path).status_code) in (405, 500)} == {}


@pytest.mark.parametrize("media_type", ["application/json", "text/csv", "application/vnd.apache.parquet"])
def test_a_long_table_is_compressed_unless_its_format_is(
    analyst: httpx.Client, taken: dict[str, Any], media_type: str
) -> None:
    address = f"/api/v1/studies/{taken['slug']}/votes"
    packed, plain = (
        analyst.get(address, headers={"Accept": media_type, "Accept-Encoding": coding})
        for coding in ("gzip", "identity")
    )
    is_packed = "parquet" not in media_type
    assert packed.headers.get("content-encoding") == ("gzip" if is_packed else None)
    assert packed.content == plain.content
    assert packed.num_bytes_downloaded < plain.num_bytes_downloaded / (2 if is_packed else 0.9)
    assert packed.headers["etag"] == plain.headers["etag"]
    assert packed.headers["etag"].startswith('W/"'), "one for both codings"
    assert "Accept-Encoding" in packed.headers["vary"] or not is_packed
    known = {"Accept": media_type, "If-None-Match": packed.headers["etag"]}
    assert analyst.get(address, headers=known).status_code == 304


LATER = "press_to_picture_ms,protocol,rating,reference,lighter_film"
RAN = "longest_gap_ms,frame_share,mismatch_share,shown_smoothly"


def test_votes_have_the_agreed_columns(analyst: httpx.Client, taken: dict[str, Any]) -> None:
    votes = rows(analyst, taken, "votes")
    assert len(votes) == 30
    columns = "participant,dataset,item_a,item_b,choice,first_shown,trial,response_ms,practice,excluded,reason"
    assert ",".join(votes[0]) == f"{columns},role,technique,frame_locked,both_seen,looks_before,{LATER},{RAN}"
    for vote in votes:
        assert vote["choice"] in ("a", "b", "none")
        assert vote["first_shown"] in (vote["item_a"], vote["item_b"])
        assert {vote["item_a"], vote["item_b"]} < set(ABILITIES)
    assert len({(vote["participant"], vote["trial"]) for vote in votes}) == 30


@pytest.mark.slow
@pytest.mark.parametrize("name", [*TABLES, "analysis"])
def test_csv_says_the_same_as_json(analyst: httpx.Client, taken: dict[str, Any], name: str) -> None:
    path = f"/api/v1/studies/{taken['slug']}/{name}"
    by_format = analyst.get(path, params={"format": "csv"})
    by_accept = analyst.get(path, headers={"Accept": "text/csv, application/json;q=0.5"})
    assert by_format.text == by_accept.text
    assert by_format.headers["content-type"] == "text/csv; charset=utf-8; header=present"
    table = list(csv.DictReader(io.StringIO(by_format.text)))
    if name == "analysis":
        keys = {row["key"]: row["value"] for row in table}
        assert keys["scores.0.item"] == analyst.get(path).json()["scores"][0]["item"]
        parquet = pyarrow.parquet.read_table(io.BytesIO(analyst.get(path, params={"format": "parquet"}).content))
        assert {row["key"]: row["value"] or "" for row in parquet.to_pylist()} == keys
    else:
        expected = rows(analyst, taken, name)
        assert len(table) == len(expected)
        assert list(table[0]) == list(expected[0])


@pytest.mark.parametrize(
    ("accept", "kind"),
    [
        ("*/*", "application/json"),
        ("application/json", "application/json"),
        ("text/csv", "text/csv"),
        ("text/csv;q=0.1, application/json", "application/json"),
        ("text/html, text/csv;q=bad", "application/json"),
    ],
)
def test_accept_chooses_the_format(analyst: httpx.Client, taken: dict[str, Any], accept: str, kind: str) -> None:
    answer = analyst.get(f"/api/v1/studies/{taken['slug']}/votes", headers={"Accept": accept})
    assert answer.headers["content-type"].startswith(kind)


def test_scores_are_those_of_the_analysis_of_the_votes(analyst: httpx.Client, taken: dict[str, Any]) -> None:
    from app.analysis import analyse, votes_from_rows

    expected = analyse(votes_from_rows(rows(analyst, taken, "votes")))["scores"]
    found = [row for row in rows(analyst, taken, "scores") if row["comparison"] == "all"]
    by_item = {(row["dataset"], row["item"]): row["score"] for row in found}
    assert by_item == pytest.approx({(row["dataset"], row["item"]): row["score"] for row in expected})


def test_factors_are_compared_too(analyst: httpx.Client, taken: dict[str, Any]) -> None:
    comparisons = {row["comparison"]: row["item"] for row in rows(analyst, taken, "scores")}
    assert comparisons.keys() == {"all", "depth", "fusion"}


def test_triads_are_counted_by_participant_and_dataset(analyst: httpx.Client, taken: dict[str, Any]) -> None:
    found = rows(analyst, taken, "triads")
    assert len({(row["participant"], row["dataset"]) for row in found}) == len(found) == 10
    assert all(row["circular_max"] == 1 for row in found)


@pytest.mark.parametrize("name", [*TABLES, "analysis"])
def test_a_study_without_votes_has_empty_results(
    analyst: httpx.Client, new_study: Callable[[], dict[str, Any]], name: str
) -> None:
    slug = new_study()["slug"]
    answer = analyst.get(f"/api/v1/studies/{slug}/{name}")
    assert answer.status_code == 200
    assert (answer.json()["scores"] if name == "analysis" else answer.json()) == []
    assert analyst.get(f"/api/v1/studies/{slug}/{name}?format=csv").status_code == 200


def test_a_study_without_votes_has_every_part_of_an_analysis(
    analyst: httpx.Client, taken: dict[str, Any], new_study: Callable[[], dict[str, Any]]
) -> None:
    empty, whole = (analyst.get(f"/api/v1/studies/{study['slug']}/analysis").json() for study in (new_study(), taken))
    assert empty.keys() == whole.keys()


@pytest.mark.slow
def test_a_study_without_votes_has_columns_of_the_same_kinds(
    analyst: httpx.Client, taken: dict[str, Any], new_study: Callable[[], dict[str, Any]]
) -> None:
    for name in ("scores", "triads"):
        answers = [
            analyst.get(f"/api/v1/studies/{study['slug']}/{name}", params={"format": "parquet"})
            for study in (new_study(), taken)
        ]
        empty, whole = (pyarrow.parquet.read_schema(io.BytesIO(answer.content)) for answer in answers)
        assert [(field.name, field.type) for field in empty] == [(field.name, field.type) for field in whole]


def test_a_filter_that_a_table_does_not_have_is_refused_not_ignored(
    analyst: httpx.Client, client: httpx.Client, taken: dict[str, Any]
) -> None:
    study = f"/api/v1/studies/{taken['slug']}"
    assert analyst.get(f"{study}/trials?participant=P001&session=none&dataset=ball&limit=1").status_code == 200
    refused = analyst.get(f"{study}/scores", params={"dataset": "ball"})
    assert is_problem(refused, 422)
    message = "there is no such parameter, expected format, limit or offset"
    assert refused.json()["errors"] == [{"at": "query.dataset", "message": message}]
    assert is_problem(client.get(f"{study}/scores?dataset=ball"), 401)


def test_only_known_formats_studies_and_tokens_are_answered(
    analyst: httpx.Client, client: httpx.Client, taken: dict[str, Any]
) -> None:
    votes = f"/api/v1/studies/{taken['slug']}/votes"
    assert is_problem(analyst.get(votes, params={"format": "xml"}), 422)
    assert is_problem(analyst.get("/api/v1/studies/unknown/votes"), 404)
    refused = client.get(votes)
    assert is_problem(refused, 401)
    assert refused.headers["www-authenticate"] == "Bearer"
    for header in ("Bearer invented", "Bearer", "Basic eDp5"):
        assert is_problem(client.get(votes, headers={"Authorization": header}), 401)
