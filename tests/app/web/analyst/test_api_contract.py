"""The REST interface holds what it describes, for everything a client may send; and it opens to nobody too much."""

from __future__ import annotations

import csv
import hashlib
import io
import re
import shutil
import subprocess
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pyarrow.parquet
import pytest
import schemathesis
from hypothesis import HealthCheck, given, seed
from hypothesis import settings as hypothesis_settings
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_schema_conformance,
    status_code_conformance,
)

from app.main import create_app, running_server
from app.operations.studies import create, manage
from app.settings import Settings
from app.simulation.participants import begin, simulate
from app.store.access.rights import ERASING, PEOPLE, SCOPES
from app.web.analyst.columns import TABLES
from tests.app.web.admin.dashboard_client import Dashboard, signed_in
from tests.app.web.http_checks import all_routes

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[4]
ABILITIES = {"id_fa": -1.0, "id_fb": 0.0, "pm_fb": 1.0}
CASES = 6  # of each operation; 250 and more in all
CHECKS = [not_a_server_error, status_code_conformance, content_type_conformance, response_schema_conformance]


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    return Settings(data_dir=tmp_path_factory.mktemp("contract"), api_requests_per_minute=1_000_000)


@pytest.fixture(scope="module")
def own_server(own: Settings) -> Iterator[str]:
    with running_server(own) as url:
        yield url


@pytest.fixture(scope="module")
def bearer(own: Settings) -> dict[str, str]:
    return {"Authorization": f"Bearer {manage.add_token(own, 'contract')['token']}"}


@pytest.fixture(scope="module")
def taken(own: Settings, own_server: str, bearer: dict[str, str], stimulus_set: Path) -> dict[str, Any]:
    study = create.create_study(own, stimulus_set, "Taken", exposure_s=0.4, seed=1)
    token = bearer["Authorization"].removeprefix("Bearer ")
    simulate(own_server, study["slug"], study["invitation"], token, 3, ABILITIES, 0.2, seed=4)
    return study


def test_no_request_breaks_the_interface_or_its_description(
    own: Settings, own_server: str, bearer: dict[str, str], taken: dict[str, Any], stimulus_set: Path
) -> None:
    spare = create.create_study(own, stimulus_set, "Spare", exposure_s=0.4, seed=1)  # may be changed, and deleted
    manager = {"Authorization": f"Bearer {manage.add_token(own, 'contract of changes', list(SCOPES))['token']}"}
    schema = schemathesis.openapi.from_url(f"{own_server}/api/v1/openapi.json")
    with httpx.Client(base_url=own_server) as client:
        session = begin(client, taken["slug"], taken["invitation"])
    participant = {"Authorization": f"Bearer {session['token']}"}
    n_cases = 0
    for found in schema.get_all_operations():
        operation = found.ok()

        @seed(1)
        @hypothesis_settings(max_examples=CASES, deadline=None, database=None, suppress_health_check=list(HealthCheck))
        @given(case=operation.as_strategy())
        def ask(case: Any) -> None:
            nonlocal n_cases
            n_cases += 1
            changes = "studies" in case.operation.definition.raw.get("tags", ())
            if "slug" in case.path_parameters and n_cases % 4:
                case.path_parameters["slug"] = (spare if changes else taken)["slug"]
            headers = participant if case.path.startswith("/api/v1/session") else manager if changes else bearer
            case.call_and_validate(headers=headers, checks=CHECKS, timeout=30)

        ask()
    assert n_cases >= 250


def rows(client: httpx.Client, path: str, **options: Any) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = client.get(path, **options).raise_for_status().json()
    return found


@pytest.fixture
def analyst(own_server: str, bearer: dict[str, str]) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=own_server, headers=bearer, timeout=60) as client:
        yield client


@pytest.mark.parametrize("name", TABLES)
def test_a_table_has_the_same_columns_and_rows_in_every_format(
    analyst: httpx.Client, taken: dict[str, Any], name: str
) -> None:
    path = f"/api/v1/studies/{taken['slug']}/{name}"
    as_json = rows(analyst, path)
    as_csv = list(csv.DictReader(io.StringIO(analyst.get(path, params={"format": "csv"}).text)))
    parquet = analyst.get(path, headers={"Accept": "application/vnd.apache.parquet"})
    as_parquet = pyarrow.parquet.read_table(io.BytesIO(parquet.content))
    assert len(as_json) == len(as_csv) == as_parquet.num_rows
    assert list(TABLES[name]) == as_parquet.column_names[: len(TABLES[name])]
    if as_json:
        assert list(as_json[0]) == list(as_csv[0]) == as_parquet.column_names


def test_pages_together_are_the_table(analyst: httpx.Client, taken: dict[str, Any]) -> None:
    path = f"/api/v1/studies/{taken['slug']}/votes"
    whole = rows(analyst, path)
    pages = [rows(analyst, path, params={"limit": 7, "offset": offset}) for offset in range(0, len(whole), 7)]
    assert [row for page in pages for row in page] == whole
    assert analyst.get(path, params={"limit": 1}).headers["x-total-count"] == str(len(whole))
    assert {row["participant"] for row in rows(analyst, path, params={"participant": "P002"})} == {"P002"}


def test_what_has_not_changed_is_not_sent_again(analyst: httpx.Client, taken: dict[str, Any]) -> None:
    for name in ("scores", "analysis", "screening", "participants", "validation", "archive.zip"):
        path = f"/api/v1/studies/{taken['slug']}/{name}"
        tag = analyst.get(path).headers["etag"]
        again = analyst.get(path, headers={"If-None-Match": f'"other", {tag}'})
        assert (again.status_code, again.content) == (304, b"")
        assert analyst.get(path, headers={"If-None-Match": '"other"'}).status_code == 200


def test_personal_tables_are_not_stored_by_browsers(
    analyst: httpx.Client, own_server: str, own: Settings, taken: dict[str, Any]
) -> None:
    base = f"/api/v1/studies/{taken['slug']}"
    with signed_in(own_server, own, "Eva") as eva:
        answers = [
            *(analyst.get(f"{base}/{name}") for name in ("participants", "votes", "questionnaire", "archive.zip")),
            analyst.get(f"{base}/participants/P001"),
            *(eva.get(f"/admin/studies/{taken['slug']}/{name}") for name in ("participants", "participants/P001")),
            eva.get(f"/admin/studies/{taken['slug']}/participants/P001/export.json"),
        ]
    assert [answer.headers["cache-control"] for answer in answers] == ["no-store"] * len(answers)


def test_a_spreadsheet_computes_nothing_from_a_csv(
    own_server: str, own: Settings, analyst: httpx.Client, taken: dict[str, Any]
) -> None:
    person = f"/admin/studies/{taken['slug']}/participants/P003"
    with signed_in(own_server, own, "Eva") as eva:
        eva.act(f"{person}/exclude", reason='=HYPERLINK("http://elsewhere","x")')
        path = f"/api/v1/studies/{taken['slug']}/votes"
        reasons = {row["reason"] for row in csv.DictReader(io.StringIO(analyst.get(f"{path}?format=csv").text))}
        assert reasons == {"", '\'=HYPERLINK("http://elsewhere","x")'}
        assert '=HYPERLINK("http://elsewhere","x")' in {row["reason"] for row in rows(analyst, path)}
        eva.act(f"{person}/include")


def test_the_archive_is_whole_and_says_what_is_in_it(analyst: httpx.Client, taken: dict[str, Any]) -> None:
    content = analyst.get(f"/api/v1/studies/{taken['slug']}/archive.zip").content
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        files = {name.split("/", 1)[1]: archive.read(name) for name in archive.namelist()}
    sums = dict(reversed(line.split("  ")) for line in files.pop("SHA256SUMS").decode().splitlines())
    assert sums == {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}
    assert {"study.toml", "analysis.json", *(f"{name}.csv" for name in TABLES)} < files.keys()
    dictionary = files["README.md"].decode()
    for name, columns in TABLES.items():
        section = dictionary.split(f"## {name}.csv")[1].split("\n## ")[0]
        header = next(csv.reader(io.StringIO(files[f"{name}.csv"].decode())))
        assert all(f"| {column} | {about.meaning} |" in section for column, about in columns.items()), name
        assert all(f"| {column} |" in section for column in header), name


PERSONAL = ("participants", "screening", "questionnaire", "comments", "comment_tags", "demographics", "archive.zip")
SCOPE_OF = dict.fromkeys(PERSONAL, "personal")


def test_a_token_opens_its_scopes_only(own: Settings, own_server: str, taken: dict[str, Any]) -> None:
    names = [*TABLES, "analysis", "archive.zip"]
    for scope in ("read", "personal", "audit"):
        token = manage.add_token(own, f"only {scope}", [scope])["token"]
        with httpx.Client(base_url=own_server, headers={"Authorization": f"Bearer {token}"}, timeout=60) as client:
            for name in names:
                needed = "audit" if name == "audit" else SCOPE_OF.get(name, "read")
                expected = 200 if scope == needed else 403
                assert client.get(f"/api/v1/studies/{taken['slug']}/{name}").status_code == expected, (scope, name)
            if scope == "audit":
                entries = client.get("/api/v1/audit?search=access+refused").json()
                assert entries[0]["actor"] == "token only audit"
                assert {entry["detail"]["needed"] for entry in entries} >= {"read", "personal", "audit"}
    with httpx.Client(base_url=own_server) as stranger:
        for name in names:
            assert stranger.get(f"/api/v1/studies/{taken['slug']}/{name}").status_code == 401, name


NEEDED = {  # the role that each route of the dashboard takes
    r"/admin/(users|tokens|settings)(/.*)?": "owner",
    r"/admin/(audit|studies/new(/(file|draft|drop))?|studies/import|stimuli/upload)": "experimenter",
    r"/admin/work(/.*)?": "experimenter",
    r"/admin/studies/\{slug\}/(participants|votes|invitations|edit|models|texts)(/.*)?": "experimenter",
    r"/admin/studies/\{slug\}/(state|address|duplicate|preview|upload|results/groups(/.*)?)": "experimenter",
    r"POST /admin/studies/\{slug\}/stimuli(/again)?": "experimenter",
    r"/admin/studies/\{slug\}(/live|/design|/results|/objective|/objective/scores|/figures/.*)?": "viewer",
    r"GET /admin/studies/\{slug\}/(stimuli.*|objective/\{digest\}/\{name\})": "viewer",
    r"GET /admin/studies": "viewer",
    r"/admin/manual(/\{name\}|/pictures/\{name\})?": "viewer",
    r"/admin/sets/\{name\}(/films/\{number\})?": "viewer",
    r"/admin/sets/\{name\}/(factors|name|delete)": "experimenter",
    r"POST /admin/((jobs|tasks)/\{task\}/cancel|studies/\{slug\}/failures)": "experimenter",
    r"/admin(/studies|/sets|/account.*|/logout|/(jobs|tasks)/[^/]*)?": "viewer",
    r"GET /admin/files(/\{kind\}/\{name\}.*|/captures/\{name\}/pictures/.*)?": "viewer",
    r"/admin/files/captures/\{name\}/strokes.*": "experimenter",
    r"/admin/files/votes/\{name\}/(reading|analyse)": "experimenter",
    r"(POST /admin/files/\{kind\}/\{name\}/(delete|attach)|/admin/files/upload.*)": "experimenter",
}
OPEN_TO_ALL = r"/admin/(setup/|login/|sign-in)"
RANKS = ("stranger", "viewer", "experimenter", "owner")


def test_each_role_and_a_stranger_get_only_what_is_theirs(
    own: Settings, own_server: str, taken: dict[str, Any]
) -> None:
    routes = routes_below(own, "/admin")
    assert len(routes) > 40
    for rank in RANKS:
        with visitor(own_server, own, rank) as client:
            token = {} if rank == "stranger" else {"X-CSRF-Token": client.form_token}
            for method, path in routes:
                needed = role_for(method, path)
                asked = re.sub(r"\{[^}]*\}", "x", path.replace("{slug}", taken["slug"]))
                if path.endswith("/live") and rank != "stranger":
                    continue  # it goes on and on; its gate is that of the page
                is_refused = RANKS.index(rank) < RANKS.index(needed)
                headers = {"Accept": "application/json", **(token if is_refused else {})}
                answer = client.request(method, asked, headers=headers)
                status = answer.status_code
                if rank == "stranger":
                    assert status in (401, 422), (rank, method, path, status)
                elif is_refused:
                    assert status == 403, (rank, method, path, status)
                    assert f"takes the role {needed}" in answer.json()["detail"], (rank, method, path)
                elif method == "GET":
                    assert status in (200, 303, 404), (rank, method, path, status)
                else:
                    assert status in (403, 404, 422), (rank, method, path, status)  # no form token
    with visitor(own_server, own, "owner") as owner:
        refused = owner.get("/api/v1/audit?search=access+refused").json()
    assert {entry["detail"]["needed"] for entry in refused if entry["actor"] == "V"} == {"experimenter", "owner"}


TAKES = {  # the scope that each route takes
    r"(GET|DELETE) /tasks/x": "studies:write",
    r".* /(drafts|studies/import).*": "studies:write",
    r"POST /(studies|sets.*)|(PATCH|DELETE) /(studies|sets)/x": "studies:write",
    r"\w+ /studies/x/(state|address|duplicate|invitations.*|outside-ids|results|films)": "studies:write",
    r"POST /studies/x/(check|votes|participants/x/resume-code)|DELETE /studies/x/failures": "studies:write",
    r"(PUT|DELETE) /studies/x/(texts|images)/x|POST /files/x/x/attach": "studies:write",
    r"\w+ /(jobs|uploads).*|(GET|DELETE) /files.*|POST /votes": "jobs",
    r"GET /(studies/x/)?audit": "audit",
    r"GET /studies/x/(participants(/x)?|screening|questionnaire|comments|comment_tags|demographics)": "personal",
    r"GET /studies/x/(archive.zip|export)": "personal",
    r"(PUT|PATCH|DELETE) /studies/x/(comments/tag|comment_tags/x|participants/x/exclusion|trials/x/comment)": PEOPLE,
    r"(PUT|POST) /studies/x/participants/x/(screening|again|interview)": PEOPLE,
    r"PUT /studies/x/participants/x/(withdrawal|erasure)": ERASING,
    r"GET /(studies|sets)(/x)?|GET /(studies/x/)?plan": "read",
    r"GET /studies/x/(votes|trials|scores|ratings|comparisons|triads|observers|validation|failures|analysis)": "read",
    r"GET /studies/x/(check|texts|design|figures(/x.x)?|images/x)": "read",
}
PARTICIPANTS = r"/api/v1/(session|openapi|studies/\{slug\}/(sessions|turned-away))"


def test_each_route_of_the_interface_takes_its_scope(own: Settings, own_server: str) -> None:
    routes = [(method, path) for method, path in routes_below(own, "/api/v1/") if not re.match(PARTICIPANTS, path)]
    assert len(routes) > 70
    secrets = {
        scope: manage.add_token(own, f"all but {scope}", [each for each in SCOPES if each != scope])["token"]
        for scope in SCOPES
    }
    with httpx.Client(base_url=own_server, timeout=60) as client:
        for method, path in routes:
            asked = re.sub(r"\{[^}]*\}", "x", path)
            found = {
                scope for route, scope in TAKES.items() if re.fullmatch(route, f"{method} {asked[len('/api/v1') :]}")
            }
            assert len(found) == 1, f"{method} {path}: name the scope that it takes in TAKES; found {sorted(found)}"
            scope = found.pop()
            answer = client.request(method, asked, headers={"Authorization": f"Bearer {secrets[scope]}"})
            assert answer.status_code == 403, (method, path, answer.status_code)
            assert f"takes the scope {scope};" in answer.json()["detail"], (method, path)


def role_for(method: str, path: str) -> str:
    """Of a route; one that is not in the list fails the test until somebody decides who may."""
    asked = (path, f"{method} {path}")
    found = {role for pattern, role in NEEDED.items() if any(re.fullmatch(pattern, one) for one in asked)}
    assert len(found) == 1, f"{method} {path}: name the role that it takes in NEEDED; found {sorted(found)}"
    return found.pop()


def routes_below(own: Settings, prefix: str) -> list[tuple[str, str]]:
    app = create_app(own)
    found = [
        (method, str(route.path))
        for route in all_routes(app.routes)
        if str(getattr(route, "path", "")).startswith(prefix) and not re.match(OPEN_TO_ALL, route.path)
        for method in sorted(route.methods - {"HEAD"})
    ]
    app.state.database.dispose()
    return found


def visitor(server: str, own: Settings, rank: str) -> Any:
    if rank == "viewer":
        return signed_in(server, own, "V", "viewer")
    if rank == "experimenter":
        return signed_in(server, own, "E", "experimenter")
    return signed_in(server, own, "O", "owner") if rank == "owner" else Dashboard(server)


def snippet(language: str, replaced: dict[str, str]) -> str:
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    found = re.search(rf"```{language}\n(.*?)```", page, re.DOTALL)
    assert found
    code = found[1]
    for old, new in replaced.items():
        assert old in code
        code = code.replace(old, new)
    return code


@pytest.fixture
def here(own_server: str, bearer: dict[str, str], taken: dict[str, Any]) -> dict[str, str]:
    return {"http://127.0.0.1:8000": own_server, "Bearer TOKEN": bearer["Authorization"], "temple": taken["slug"]}


def test_the_python_snippet_works(here: dict[str, str]) -> None:
    names: dict[str, Any] = {}
    exec(snippet("python", here), names)
    assert {"item", "score"} <= set(names["scores"].columns)
    assert len(names["votes"]) == 18


def test_the_r_snippet_works(here: dict[str, str]) -> None:
    if shutil.which("Rscript") is None:
        pytest.skip("no R on this machine")
    counted = re.findall(r"```r\n(.*?)```", (ROOT / "docs" / "r.md").read_text(encoding="utf-8"), re.DOTALL)[0]
    code = snippet("r", here) + "cat(nrow(votes), '')\n" + counted + "cat(nrow(votes))"
    done = subprocess.run(["Rscript", "-e", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["18", "18"]
