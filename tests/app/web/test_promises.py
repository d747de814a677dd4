"""What docs/security.md says of every page and script, asked of a server with the settings of production."""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from fastapi import params
from fastapi.dependencies.models import Dependant
from pydantic import TypeAdapter

from app.main import UVICORN_OPTIONS, create_app, running_server
from app.operations.studies import manage
from app.settings import Settings
from app.web.admin.layout import attachment
from app.web.gates import fields_of
from tests.app.web.admin.dashboard_client import PASSWORD, Dashboard
from tests.app.web.http_checks import all_routes

ROOT = Path(__file__).parents[3]
PUBLIC_URL = "http://study.example.org"  # by https a client of tests would send no cookie back
EVIL = "https://evil.example"


@pytest.fixture(scope="module")
def in_production(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    return Settings(data_dir=tmp_path_factory.mktemp("production"), public_url=PUBLIC_URL)


@pytest.fixture(scope="module")
def server(in_production: Settings) -> Iterator[str]:
    with running_server(in_production) as url:
        yield url


@pytest.fixture(scope="module")
def owner(server: str, in_production: Settings) -> Iterator[Dashboard]:
    """Somebody with a password, signed in."""
    with Dashboard(server) as dashboard:
        dashboard.enter(manage.add_experimenter(in_production, "Olga Owner")["path"])
        dashboard.act("/admin/account/password", password=PASSWORD, again=PASSWORD)
        yield dashboard


def pages(settings: Settings) -> list[str]:
    """The dashboard's pages that need no name of anything."""
    app = create_app(settings)
    app.state.database.dispose()
    routes = [route for route in all_routes(app.routes) if "GET" in route.methods and "{" not in route.path]
    return sorted({route.path for route in routes if route.path.startswith("/admin")})


@pytest.mark.slow
def test_every_page_of_the_dashboard_offers_to_sign_out(owner: Dashboard, in_production: Settings) -> None:
    shown = {}
    for path in pages(in_production):
        with owner.stream("GET", path) as answer:  # some never end: events
            if answer.headers["content-type"].startswith("text/html"):
                shown[path] = answer.read().decode()
    assert len(shown) > 8
    assert [path for path, text in shown.items() if 'action="/admin/logout"' not in text] == []
    templates = {path.name: path.read_text(encoding="utf-8") for path in (ROOT / "templates" / "admin").glob("[!_]*")}
    inside = re.compile(r'{% extends "admin/_(layout|study)\.html"')
    assert {name for name, text in templates.items() if not inside.search(text)} == {
        *("set_up.html", "sign_in.html", "sign_in_by_link.html"),  # for who is not signed in
        "print_sheet.html",  # for paper
    }


CACHED = {  # what is said at how many places of a file: pictures, films, models and measures, and a page's own files
    ("files_page.py", '"private, max-age=3600"'): 2,
    ("files_page.py", '"private, no-cache"'): 1,
    ("films_page.py", '"private, max-age=86400"'): 1,
    ("joined.py", "FOR_GOOD"): 1,
    ("manual_page.py", '"private, max-age=86400"'): 1,
    ("media.py", "FOREVER"): 2,
    ("media.py", "FOR_A_WHILE"): 1,
    ("models_page.py", "FOREVER"): 1,
    ("objective_page.py", "FOREVER"): 1,
    ("scores_page.py", "FOREVER"): 1,
    ("security.py", '"no-cache"'): 1,
    ("sets_page.py", '"private, max-age=3600"'): 1,
}


def test_browsers_keep_films_pictures_and_measures_alone() -> None:
    files = {path.name: path.read_text(encoding="utf-8") for path in (ROOT / "app" / "web").rglob("*.py")}
    told = re.compile(r'(?i)"cache-control": ("[^"]*"|[\w.]+)')
    found = Counter((name, value) for name, text in files.items() for value in told.findall(text))
    assert {(name, value): n for (name, value), n in found.items() if value != '"no-store"'} == CACHED


def test_every_field_of_a_password_is_masked_and_may_be_filled_in_by_a_password_manager() -> None:
    templates = [path.read_text(encoding="utf-8") for path in (ROOT / "templates").rglob("*.html")]
    asking = "".join(text for text in templates if re.search(r'name="(?:password|current)"', text))
    fields = re.findall(r'<input[^>]*name="(?:password|again|current)"[^>]*>', asking)
    assert len(fields) >= 9
    assert [field for field in fields if 'type="password"' not in field or "autocomplete=" not in field] == []


TAKES_TOKEN = {"acting", "acting_by_header", "may_change", "own_form", "participant_token"}
TAKES_A_CODE = {  # of who has no session yet
    "/resume",  # which also looks whether the form is its own
    "/api/v1/session/resume",
    "/api/v1/studies/{slug}/sessions",
    "/api/v1/studies/{slug}/turned-away",
}


def test_whatever_changes_something_takes_the_token_of_its_form_or_session(in_production: Settings) -> None:
    app = create_app(in_production)
    app.state.database.dispose()
    changing = [route for route in all_routes(app.routes) if route.methods - {"GET", "HEAD"}]
    assert len(changing) > 100
    assert {route.path for route in changing if TAKES_TOKEN.isdisjoint(gates(route.dependant))} == TAKES_A_CODE


def gates(dependant: Dependant) -> Iterator[str]:
    """Return the names of all that a route depends on, without the functions within them."""
    for each in dependant.dependencies:
        yield str(getattr(each.call, "__qualname__", "")).partition(".")[0]
        yield from gates(each)


@pytest.mark.slow
@pytest.mark.parametrize("password", ["qvzjwxkpt" * 14, "  Ψ correct horse 🎈 battery  "])
def test_a_password_is_any_text_up_to_128_letters_and_counts_as_it_was_typed(
    owner: Dashboard, password: str, in_production: Settings
) -> None:
    with Dashboard(str(owner.base_url)) as person:
        name = f"Person of {len(password)}"
        person.enter(manage.add_experimenter(in_production, name)["path"])
        assert person.act("/admin/account/password", password=password, again=password).status_code == 200
    with Dashboard(str(owner.base_url)) as person:
        for other in (password[:-1], password.swapcase()):
            assert person.enter("/admin/sign-in", name=name, password=other).status_code == 401
        assert person.enter("/admin/sign-in", name=name, password=password).status_code == 200


@pytest.mark.slow
def test_every_body_refuses_names_that_it_does_not_know_and_converts_no_types(in_production: Settings) -> None:
    app = create_app(in_production)
    app.state.database.dispose()
    routes = [route for route in all_routes(app.routes) if hasattr(route, "dependant")]
    fields = [field for route in routes for field in fields_of(route.dependant).values()]
    bodies = [TypeAdapter(field.annotation).core_schema for field in fields if not isinstance(field, params.Form)]
    configs = {name: config for body in bodies for name, config in configs_of(body)}
    assert len(configs) > 35
    assert configs.pop("Stroke")["extra_fields_behavior"] == "forbid"  # JSON has a list where it takes a pair
    expected = {"extra_fields_behavior": "forbid", "strict": True}
    assert [name for name, config in configs.items() if config != {**expected, "title": name}] == []


def configs_of(schema: Any) -> Iterator[tuple[str, dict[str, Any]]]:
    """The names and settings of all models in a schema of pydantic."""
    if isinstance(schema, dict) and "config" in schema and "cls" in schema:
        yield schema["cls"].__name__, schema["config"]
    for part in schema.values() if isinstance(schema, dict) else schema if isinstance(schema, list | tuple) else ():
        yield from configs_of(part)


@pytest.mark.parametrize("path", ["/", "/admin", "/api/v1/studies", "/static/js/participant.js", "/healthz"])
def test_no_answer_lets_another_origin_read_it(owner: Dashboard, path: str) -> None:
    asks = {"Origin": EVIL, "Access-Control-Request-Method": "GET"}
    for answer in (owner.get(path, headers=asks), owner.options(path, headers=asks)):
        assert [name for name in answer.headers if name.startswith("access-control-")] == []


@pytest.mark.parametrize(
    "path",
    [
        "/.git/config",
        "/.env",
        "/static/",
        "/static/js/",
        "/static/js",
        "/static/%2e%2e/app/main.py",
        "/app/main.py",
        "/static/app/main.py",
    ],
)
def test_neither_lists_of_files_nor_what_lies_beside_them_are_served(server: str, path: str) -> None:
    assert httpx.get(server + path).status_code == 404


@pytest.mark.parametrize("path", ["/admin", "/admin/account", "/", "//evil.example/admin/", "/admin/"])
def test_no_redirect_leads_where_a_request_says(server: str, path: str) -> None:
    params = dict.fromkeys(("next", "return", "url", "redirect", "return_to"), EVIL)
    answer = httpx.get(server + path, params=params, headers={"Referer": EVIL}, follow_redirects=False)
    host = httpx.URL(PUBLIC_URL).join(answer.headers.get("Location", "/")).host
    assert host in (httpx.URL(PUBLIC_URL).host, httpx.URL(server).host)


def test_only_this_machine_is_believed_who_asks_and_nginx_says_so_itself() -> None:
    assert not {"forwarded_allow_ips", "proxy_headers"} & UVICORN_OPTIONS.keys()  # uvicorn's own: 127.0.0.1 alone
    nginx = (ROOT / "deploy" / "nginx.conf").read_text(encoding="utf-8")
    assert re.findall(r"X-Forwarded-For (\S+);", nginx) == ["$remote_addr"]


def test_nginx_answers_nobody_elsewhere_of_the_inner_addresses() -> None:
    """As its file says; `test_nginx_sends_the_videos_…` asks nginx itself where it is installed."""
    nginx = " ".join((ROOT / "deploy" / "nginx.conf").read_text(encoding="utf-8").split())
    assert "location = /metrics { allow 127.0.0.1; deny all;" in nginx
    assert "location = /readyz { return 404; }" in nginx
    assert "location /pairs/ { internal;" in nginx


@pytest.mark.parametrize("name", ['a"b\r\nSet-Cookie: x=1', "größe.csv", "../../etc/passwd", "plain.csv"])
def test_the_name_of_a_download_stays_in_its_header(name: str) -> None:
    header = attachment(name)
    assert header.isascii()
    assert not set("\r\n") & set(header)
    assert header.count('"') in (0, 2)


def test_scripts_run_no_text_and_make_html_of_two_answers_of_the_server_alone() -> None:
    scripts = {path.name: path.read_text(encoding="utf-8") for path in (ROOT / "static" / "js").glob("*.js")}
    running = re.compile(r"\beval\(|new Function\(|set(?:Timeout|Interval)\(\s*[\"'`]|document\.write|javascript:")
    html = re.compile(r"\b(?:inner|outer)HTML\b|insertAdjacentHTML|createContextualFragment|parseFromString")
    messages = re.compile(
        r"(?<![\w.])(?:(?:window|self|globalThis)\.)?(?:onmessage\s*=|addEventListener\(\s*[\"'`]message)"
        r"|(?:window|self|globalThis|parent|opener|top|contentWindow)\.postMessage"
    )
    assert len(scripts) > 30
    assert [name for name, text in scripts.items() if running.search(text) or messages.search(text)] == []
    made = [(name, len(html.findall(text))) for name, text in sorted(scripts.items()) if html.search(text)]
    assert made == [("admin-draft.js", 1), ("participant.js", 1)]  # what a draft would make; the debriefing


COPIES = re.compile(
    r"Object\.assign\(|__proto__|\.prototype\b|for \((?:const|let) \w+ in |[\w)]\[[a-z_][\w.]*\] = ", re.I
)
OWN_NAMES = {  # whose keys stand in the script
    "film[key] = input.value.trim();",
    "Object.assign(this.canvas, { width: media.width, height: media.height });",
    "Object.assign(this.viewing, this.seen(played));",
    "for (const [name, count] of Object.entries(counts)) sums[name] = (sums[name] ?? 0) + count;",
}


def test_no_script_copies_names_from_outside_into_an_object() -> None:
    lines = {
        line.strip() for path in (ROOT / "static" / "js").glob("*.js") for line in path.read_text("utf-8").splitlines()
    }
    assert {line for line in lines if COPIES.search(line) and not line.startswith(("*", "/"))} == OWN_NAMES


def test_pages_escape_all_but_pictures_that_the_server_draws() -> None:
    templates = {path.name: path.read_text(encoding="utf-8") for path in (ROOT / "templates").rglob("*.html")}
    assert len(templates) > 60
    unescaped = {(name, found) for name, text in templates.items() for found in re.findall(r"[\w.\"]+ ?\| ?safe", text)}
    assert unescaped == {
        ("account.html", "picture | safe"),  # a code to scan, as the next
        ("print_sheet.html", "qr | safe"),
        ("experiment.html", "figure.svg | safe"),
        ("report.html", "figure.svg | safe"),
        ("files.html", '" | safe'),  # what stands between two names
    }
    assert [name for name, text in templates.items() if "autoescape" in text] == []


@pytest.mark.slow
def test_no_command_runs_through_a_shell() -> None:
    shell = re.compile(r"\bshell=(?!False)|os\.(?:system|popen|exec[lv]\w*|spawn\w+)\(|getoutput\(|_shell\(")
    files = [path for part in ("app", "recon", "ground") for path in sorted((ROOT / part).rglob("*.py"))]
    assert len(files) > 300
    assert [path.name for path in files if shell.search(path.read_text(encoding="utf-8"))] == []


SQL_AS_TEXT = ("text", "literal_column", "exec_driver_sql")
OF_OWN_NAMES = {"f\"LOCK TABLE {', '.j", "f'SET LOCAL statemen", "'BEGIN IMMEDIATE' if"}


@pytest.mark.slow
def test_no_query_is_text_made_of_what_people_send() -> None:
    """SQL as text is written in the code; what varies in it are names of tables, and constants."""
    found = set()
    for path in sorted(file for part in ("web", "store", "operations") for file in (ROOT / "app" / part).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            is_sql = isinstance(node, ast.Call) and node.args and ast.unparse(node.func).split(".")[-1] in SQL_AS_TEXT
            if is_sql and not isinstance(node.args[0], ast.Constant):  # type: ignore[attr-defined]  # a Call, as was asked
                found.add(ast.unparse(node.args[0])[:20])  # type: ignore[attr-defined]
    assert found == OF_OWN_NAMES


@pytest.mark.slow
def test_no_number_that_can_be_foretold_becomes_a_secret() -> None:
    foretold = re.compile(r"^(?:import|from) random\b|\b(?:np|numpy)\.random\b|uuid1", re.MULTILINE)
    files = [path for part in ("web", "store") for path in (ROOT / "app" / part).rglob("*.py")]
    found = {path.name for path in files if foretold.search(path.read_text(encoding="utf-8"))}
    assert found == {"request_log.py"}  # the names of requests in the log


@pytest.mark.slow
def test_no_pattern_is_made_of_what_people_send() -> None:
    """Patterns of the server are written in the code; what varies in one is a constant or escaped."""
    found = []
    for path in sorted(file for part in ("web", "store", "intake") for file in (ROOT / "app" / part).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            is_pattern = isinstance(node, ast.Call) and ast.unparse(node.func).startswith("re.") and node.args
            if is_pattern and not _is_written(node.args[0]):  # type: ignore[attr-defined]  # a Call, as was asked
                found.append(f"{path.name}:{node.lineno}")  # type: ignore[attr-defined]
    assert found == []


def _is_written(pattern: ast.expr) -> bool:
    if isinstance(pattern, ast.JoinedStr):
        return all(_is_written(part.value) for part in pattern.values if isinstance(part, ast.FormattedValue))
    if isinstance(pattern, ast.BinOp):
        return _is_written(pattern.left) and _is_written(pattern.right)
    return (
        isinstance(pattern, ast.Constant)
        or ast.unparse(pattern).isupper()
        or ast.unparse(pattern).startswith("re.escape(")
        or re.fullmatch(r"'\|'\.join\([A-Z_]+\)", ast.unparse(pattern)) is not None
    )
