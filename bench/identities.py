"""Whether any request of anybody makes the server fail, or shows a study to whom it is not.

    python bench/identities.py [--cases 20] [--minutes 600] [--only WORD] [--seed 1] [--json]

Schemathesis sends each route, the dashboard's included, what its description allows, as everybody who may come: nobody,
a participant, tokens that read or change this study or another one, an owner, a guest who may look at this study, and
the experimenter of another one; half of the requests come from whom the address lets in. Names in addresses are those
of a real filled study, found by following the dashboard. Then each form of its pages is sent as it stands, and with
some of its fields changed. No answer may be 5xx, and who has rights of another study alone may not be let in. Where a
request has ended an identity or deleted the study, the server goes on with a fresh copy. It has production's settings.
Live pages, which never end, are left out. Prints counts, and each failure.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import sys
import tempfile
import time
import warnings
from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from html import unescape
from html.parser import HTMLParser
from pathlib import Path
from random import Random
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent))

import httpx
import schemathesis
from fastapi.openapi.utils import get_openapi
from hypothesis import HealthCheck, Phase, given, seed
from hypothesis import settings as hypothesis_settings
from schemathesis.core.transport import Response

from app.main import create_app, running_server
from app.operations.studies import create, manage
from app.settings import Settings
from app.simulation.participants import begin, simulate
from app.store.access.rights import READING, SCOPES, Role
from app.study.options.options import parse_options
from tests.app import tiny_stimuli
from tests.app.web.admin.dashboard_client import Dashboard
from tests.app.web.admin.small_models import write_plain
from tests.app.web.http_checks import all_routes
from tests.study_server import StudyServer

os.environ |= {
    "RECONSTUDY_SESSIONS_PER_MINUTE": "1000000",
    "RECONSTUDY_API_REQUESTS_PER_MINUTE": "1000000",
    "RECONSTUDY_CHECK_BROWSER": "none",
}
PRODUCTION = {"RECONSTUDY_PUBLIC_URL": "https://study.example.org", "RECONSTUDY_LOG_FORMAT": "json"}
NO_LIMITS = ("--first", "bench.server_changes:no_limits")
OPTIONS = {"screening": {"tests": ["acuity", "colour"]}, "limits": {"minutes": 600}}
OTHERS = ("token of another study", "experimenter of another study")
MOST_PAGES = 250
MOST_TOLD = 300
FITTING = (  # who gets behind the gate of an address
    *(("/admin", "owner"), ("/api/v1/session", "participant"), ("/api/v1/studies", "changing token")),
    *(("/api/v1", "token of all"), ("/", "nobody")),
)
LET_IN = 0.5  # share of requests by them
REAL = 0.8  # share of names in addresses that are real ones
NASTY = (
    *(
        "",
        " ",
        "0",
        "-1",
        "1e400",
        "NaN",
        "99999999999999999999",
        "1.5",
        "true",
        "null",
        "[]",
        "{}",
        "=1+1",
        "x" * 5000,
    ),
    *("\x00", "🙂", "\u202e", "٣", "<script>", "../../etc/passwd", "2026-02-30", "2027-03-31T18:00", "a,b\n\nc", "[a"),
)
PRIVATE = re.compile(r"(/admin|/api/v1)/studies/\{slug\}")
PUBLIC = re.compile(r"/api/v1/studies/\{slug\}/(sessions|turned-away)")


@dataclass(frozen=True)
class Identity:
    """Who asks: headers that say so, and the token of their forms."""

    headers: Mapping[str, str]
    form_token: str = ""


@dataclass
class Filled:
    """A server's folder with a filled study, and one that is copied from it for each server."""

    folder: Path
    slug: str = ""
    other: str = ""
    identities: dict[str, Identity] = field(default_factory=dict)

    def fill(self) -> None:
        """Make two studies, people who have taken the first, one who is at it, results, models, and all identities."""
        settings = Settings(data_dir=self.folder)
        manage.upgrade_database(settings)
        films = tiny_stimuli.write_set(settings.sets_dir / "films", ("ball", "box"), tiny_stimuli.APPROACHES)
        this, other = (
            create.create_study(settings, films, name, exposure_s=0.4, seed=1, options=parse_options(OPTIONS))
            for name in ("This", "Other")
        )
        self.slug, self.other = this["slug"], other["slug"]
        manage.attach_results(settings, [write_plain(settings.intake_dir / "models" / "mine")], self.slug)
        (settings.intake_dir / "votes").mkdir()
        (settings.intake_dir / "votes" / "votes.csv").write_text("person,a,b,winner\np,x,y,x\nq,x,y,y\n")
        with running_server(settings) as url:
            token = manage.add_token(settings, "simulate")["token"]
            simulate(url, self.slug, this["invitation"], token, 3, {"id_fa": -1.0, "id_fb": 0.0, "pm_fb": 1.0}, 0.2)
            with httpx.Client(base_url=url, timeout=60) as client:
                taking = begin(client, self.slug, this["invitation"])
            bearers = {
                "participant": taking["token"],
                "reading token": manage.add_token(settings, "reads", list(READING), [self.slug])["token"],
                "changing token": manage.add_token(settings, "changes", list(SCOPES), [self.slug])["token"],
                "token of another study": manage.add_token(settings, "others", list(SCOPES), [self.other])["token"],
                "token of all": manage.add_token(settings, "all", list(SCOPES))["token"],
            }
            self.identities = {
                name: Identity({"Authorization": f"Bearer {bearer}"}) for name, bearer in bearers.items()
            }
            self.identities["nobody"] = Identity({})
            people: tuple[tuple[str, Role | None, list[str] | None], ...] = (
                ("owner", None, None),
                ("guest", "viewer", [self.slug]),
                ("experimenter of another study", "experimenter", [self.other]),
            )
            for name, role, sees in people:
                self.identities[name] = self._person(settings, url, name, role, sees)

    def _person(self, settings: Settings, url: str, name: str, role: Role | None, sees: list[str] | None) -> Identity:
        with Dashboard(url) as dashboard:
            dashboard.enter(manage.add_experimenter(settings, name, role, sees)["path"])
            cookies = "; ".join(f"__Host-{key}={value}" for key, value in dashboard.cookies.items())
            return Identity({"Cookie": cookies}, dashboard.form_token)


class Links(HTMLParser):
    """What a page leads to, and its forms."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: set[str] = set()
        self.forms: list[tuple[str, str, dict[str, str]]] = []
        self._named = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {name: value or "" for name, value in attrs}
        self.addresses.update(unescape(values[name]) for name in ("href", "src", "action") if name in values)
        if tag == "form":
            self.forms.append((values.get("action", ""), values.get("method", "get").upper(), {}))
        elif self.forms and tag in ("input", "textarea", "select", "button") and values.get("name"):
            self._named = values["name"]
            is_off = values.get("type") in ("checkbox", "radio") and "checked" not in values
            if not is_off:
                self.forms[-1][2].setdefault(self._named, values.get("value", ""))
        elif tag == "option" and self.forms and "selected" in values:
            self.forms[-1][2][self._named] = values.get("value", "")


class Asking:
    """A server that is asked as everybody, and is started anew on a fresh copy when somebody has broken it."""

    def __init__(self, filled: Filled, log: Path, rng: Random) -> None:
        self.filled, self.rng = filled, rng
        self.statuses: Counter[int] = Counter()
        self.asked: Counter[str] = Counter()
        self.failures: list[dict[str, Any]] = []
        self.n_fresh = 0
        self._log = log.open("a", encoding="utf-8")
        self._server: StudyServer | None = None

    def start(self) -> None:
        self.stop()
        copy = Path(tempfile.mkdtemp(prefix="reconstudy-identities-"))
        shutil.copytree(self.filled.folder, copy, dirs_exist_ok=True)
        self._server = StudyServer(copy, *NO_LIMITS, log=self._log)
        self._server.__enter__()
        self._copy, self.url = copy, self._server.base_url
        self.n_fresh += 1

    def stop(self) -> None:
        if self._server is not None:
            self._server.__exit__(None, None, None)
            shutil.rmtree(self._copy)
            self._server = None

    def is_whole(self) -> bool:
        """Whether the study is there and everybody is known."""
        for name, path in (
            ("owner", f"/admin/studies/{self.filled.slug}"),
            ("guest", f"/admin/studies/{self.filled.slug}"),
            ("experimenter of another study", f"/admin/studies/{self.filled.other}"),
            ("changing token", f"/api/v1/studies/{self.filled.slug}"),
            ("reading token", f"/api/v1/studies/{self.filled.slug}"),
            ("token of another study", f"/api/v1/studies/{self.filled.other}"),
            ("token of all", "/api/v1/studies"),
            ("participant", "/api/v1/session/asked"),
        ):
            if httpx.get(self.url + path, headers=dict(self.filled.identities[name].headers), timeout=60).is_error:
                return False
        return True

    def note(self, who: str, method: str, route: str, address: str, status: int, told: str, body: Any) -> None:
        self.statuses[status] += 1
        self.asked[who] += 1
        is_private = PRIVATE.match(route) and not PUBLIC.match(route) and f"/{self.filled.slug}" in address
        if status >= 500 or (is_private and who in OTHERS and status < 300):
            failure = {"who": who, "request": f"{method} {address}", "status": status, "told": told[:MOST_TOLD]}
            self.failures.append(failure | {"route": route, "body": repr(body)[:600]})
            print(json.dumps(self.failures[-1]), file=sys.stderr, flush=True)

    def names(self, routes: list[Any]) -> dict[str, list[dict[str, str]]]:
        """Follow the owner's links; what stands in the addresses of each route, and the forms met."""
        known: dict[str, list[dict[str, str]]] = defaultdict(list)
        self.forms: dict[str, tuple[str, str, dict[str, str]]] = {}
        seen, waiting = set[str](), ["/admin"]
        owner = dict(self.filled.identities["owner"].headers)
        with httpx.Client(base_url=self.url, headers=owner, timeout=120) as client:
            while waiting and len(seen) < MOST_PAGES:
                address = waiting.pop(0)
                for route in routes:
                    if (found := route.path_regex.match(address.partition("?")[0])) and found.groupdict():
                        known[route.path].append(found.groupdict())
                page = client.get(address) if not address.endswith("/live") else None
                if page is None or "html" not in page.headers.get("content-type", ""):
                    continue
                links = Links()
                links.feed(page.text)
                for action, method, fields in links.forms:
                    place = action or address
                    self.forms.setdefault(f"{method} {place} {sorted(fields)}", (method, place, fields))
                for link in sorted(links.addresses):
                    link = link.partition("#")[0]
                    path = link.partition("?")[0]
                    if link.startswith("/") and path not in seen and not path.startswith(("/static", "/media")):
                        seen.add(path)
                        waiting.append(link)
        return known


def described(routes: list[Any]) -> dict[str, Any]:
    """Describe every route, those of pages, too."""
    for route in routes:
        route.include_in_schema = True
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # GET and HEAD of a page are one operation to it
        return get_openapi(title="all", version="1", routes=routes)


def ask_by_schema(asking: Asking, schema: Any, known: dict[str, list[dict[str, str]]], arguments: Any) -> None:
    by_name = defaultdict(list)
    for values in known.values():
        for found in values:
            for name, value in found.items():
                by_name[name].append(value)
    operations = [found.ok() for found in schema.get_all_operations()]
    asking.rng.shuffle(operations)
    ends_s = time.monotonic() + 30 * arguments.minutes
    for operation in operations:
        if arguments.only not in operation.path or time.monotonic() > ends_s:
            continue

        @seed(arguments.seed)
        @hypothesis_settings(
            max_examples=arguments.cases,
            deadline=None,
            database=None,
            phases=[Phase.generate],
            suppress_health_check=list(HealthCheck),
        )
        @given(case=operation.as_strategy())
        def ask(case: Any) -> None:
            rng = asking.rng
            fitting = next(name for begins, name in FITTING if case.path.startswith(begins))
            who = fitting if rng.random() < LET_IN else rng.choice([*asking.filled.identities])
            person = asking.filled.identities[who]
            if rng.random() < REAL and case.path_parameters:
                together = rng.choice(known[case.path]) if known[case.path] else {}
                for name in case.path_parameters:
                    if values := [together[name]] if name in together else by_name[name]:
                        case.path_parameters[name] = rng.choice(values)
                if "slug" in case.path_parameters:
                    case.path_parameters["slug"] = asking.filled.slug
            if isinstance(case.body, dict) and person.form_token:
                case.body["form_token"] = person.form_token
            headers = dict(person.headers) | ({"X-CSRF-Token": person.form_token} if person.form_token else {})
            answer: Response = case.call(asking.url, headers=headers, timeout=120, allow_redirects=False)
            address, told = answer.request.path_url, answer.content[:MOST_TOLD].decode(errors="replace")
            asking.note(who, case.method, case.path, address, answer.status_code, told, case.body)

        ask()
        if not asking.is_whole():
            asking.start()


def ask_by_forms(asking: Asking, routes: list[Any], arguments: Any) -> None:
    """Send each form of the dashboard as it stands, and changed."""
    ends_s = time.monotonic() + 30 * arguments.minutes
    for method, place, fields in list(asking.forms.values()):
        if method != "POST" or arguments.only not in place or time.monotonic() > ends_s:
            continue
        route = next(
            (r.path for r in routes if method in r.methods and r.path_regex.match(place.partition("?")[0])), ""
        )
        for number in range(arguments.cases):
            who = asking.rng.choice(("owner", "owner", "guest", "experimenter of another study"))
            person = asking.filled.identities[who]
            sent = dict(fields) | {"form_token": person.form_token}
            if number:
                for name in asking.rng.sample(sorted(fields), k=min(len(fields), asking.rng.randint(1, 2))):
                    if name != "form_token":
                        sent[name] = asking.rng.choice(NASTY)
            answer = httpx.post(
                asking.url + place, data=sent, headers=dict(person.headers) | {"Accept": "text/html"}, timeout=120
            )
            asking.note(who, method, route, place, answer.status_code, answer.text, sent)
        if not asking.is_whole():
            asking.start()


def routes_of(settings: Settings) -> list[Any]:
    app = create_app(settings)
    app.state.database.dispose()
    return [r for r in all_routes(app.routes) if not r.path.endswith("/live") and r.methods != {"HEAD"}]


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as name:
        filled = Filled(Path(name) / "data")
        filled.folder.mkdir()
        filled.fill()
        os.environ |= PRODUCTION
        routes = [r for r in routes_of(Settings(data_dir=filled.folder)) if hasattr(r, "dependant")]
        asking = Asking(filled, arguments.log, Random(arguments.seed))
        asking.start()
        try:
            known = asking.names(routes)
            assert asking.is_whole(), "an identity is not known"
            schema = schemathesis.openapi.from_dict(described(routes))
            ask_by_schema(asking, schema, known, arguments)
            ask_by_forms(asking, routes, arguments)
        finally:
            asking.stop()
    return {
        "requests": sum(asking.statuses.values()),
        "routes": len(routes),
        "forms": len(asking.forms),
        "fresh_servers": asking.n_fresh,
        "by_status": dict(sorted(asking.statuses.items())),
        "by_identity": dict(asking.asked),
        "failures": asking.failures,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=20, help="of each route and form")
    parser.add_argument("--minutes", type=float, default=600, help="after which it stops")
    parser.add_argument("--only", default="", help="routes whose address holds this")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--log", type=Path, default=Path(os.devnull), help="file for what the servers say")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    result = measure(arguments)
    print(json.dumps(result, indent=2 if arguments.json else None))
    sys.exit(bool(result["failures"]))


if __name__ == "__main__":
    main()
