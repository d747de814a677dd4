"""How long the dashboard's pages and the REST tables of large studies take, and how much memory the server needs.

    python bench/tables.py [--votes 15000 1000000] [--keep FOLDER] [--postgresql] [--rounds 3] [--only WORDS] [--json]

Each study is inserted in bulk (bench/large_study.py) and served by a process of its own; `--keep` keeps the database
for the next time. *First* is the first answer of a new server, *then* the median of the others. *cpu* is the server's
processor time, which other work on the machine changes little. *First byte* and *memory* (the server's peak resident
size, over that of a server that has just started) are of the first answer.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent))

import httpx
from large_study import fill
from memory import memory_mb
from sqlalchemy import insert, select

from app.operations.studies.manage import add_experimenter, add_token
from app.settings import Settings
from app.store.database.engine import open_database
from app.store.database.migrate import upgrade
from app.store.database.tables import vote
from tests.app.web.admin.dashboard_client import Dashboard
from tests.postgresql import PostgresServer
from tests.study_server import StudyServer

SLUG = "test"
PATIENCE_S = 600
UNCHANGED = "unchanged"


@dataclass(frozen=True)
class Asked:
    """A request and what it is called in the table of times."""

    name: str
    path: str
    headers: Mapping[str, str] = field(default_factory=dict)

    @property
    def is_page(self) -> bool:
        return self.path.startswith("/admin")


PAGES = [
    Asked(f"page {name or 'overview'}", f"/admin/studies/{SLUG}{path}")
    for name, path in (
        ("", ""),
        ("results", "/results"),
        ("participants", "/participants"),
        ("participant", "/participants/P007"),
        ("votes", "/votes"),
        ("votes of a participant", "/votes?participant=P007"),
        ("votes, third page", "/votes?at=120"),
        ("design", "/design"),
        ("stimuli", "/stimuli"),
        ("invitations", "/invitations"),
        ("settings", "/edit"),
    )
] + [Asked("page studies", "/admin")]
TABLES = [
    Asked(f"{table} {what}", f"/api/v1/studies/{SLUG}/{table}{query}")
    for table in ("votes", "trials")
    for what, query in (
        ("limit=10", "?limit=10"),
        ("of one participant", "?participant=P007"),
        (UNCHANGED, ""),
        ("as CSV", "?format=csv"),
        ("as JSON", ""),
        ("as Parquet", "?format=parquet"),
    )
] + [
    Asked(f"{table} {what}", f"/api/v1/studies/{SLUG}/{table}{query}")
    for table in (
        *("participants", "screening", "questionnaire", "comments", "demographics", "validation", "audit"),
        *("scores", "analysis"),
    )
    for what, query in (("limit=10", "?limit=10"), (UNCHANGED, ""), ("as JSON", ""))
]


def measure(server: StudyServer, asked: Asked, headers: Mapping[str, str], rounds: int) -> dict[str, Any]:
    """Ask a new server, then again and again."""
    server.kill()
    before_mb = memory_mb("VmHWM", server.pid)
    seconds: list[float] = []
    cpu_s: list[float] = []
    first_byte_s = n_bytes = 0.0
    status = 0
    with httpx.Client(base_url=server.base_url, headers=headers, timeout=PATIENCE_S) as client:
        client.get("/healthz")
        if asked.name.endswith(UNCHANGED):
            with client.stream("GET", asked.path) as answer:
                headers = {"If-None-Match": answer.headers["etag"]}
            server.kill()
            client.get("/healthz")
        else:
            headers = {}
        for number in range(rounds):
            began, cpu_began_s = time.perf_counter(), processor_s(server.pid)
            with client.stream("GET", asked.path, headers={**asked.headers, **headers}) as answer:
                status = answer.status_code
                assert status < 400, f"{asked.path}: {status}"
                for part in answer.iter_raw():
                    if not number and not n_bytes:
                        first_byte_s = time.perf_counter() - began
                    n_bytes += len(part) if not number else 0
            seconds.append(time.perf_counter() - began)
            cpu_s.append(processor_s(server.pid) - cpu_began_s)
            if seconds[-1] > 60:
                break
    return {
        "what": asked.name,
        "status": status,
        "first_s": round(seconds[0], 3),
        "then_s": round(median(seconds[1:] or seconds), 3),
        "cpu_s": round(cpu_s[0], 2),
        "cpu_then_s": round(median(cpu_s[1:] or cpu_s), 2),
        "first_byte_s": round(first_byte_s, 3),
        "memory_mb": round(memory_mb("VmHWM", server.pid) - before_mb),
        "size_mb": round(n_bytes / 1e6, 2),
    }


def after_a_vote(server: StudyServer, url: str, headers: Mapping[str, str], rounds: int) -> dict[str, Any]:
    """Ask for the results after each of some new votes; the first answer is that of the server before any."""
    database = open_database(url)
    seconds = []
    with httpx.Client(base_url=server.base_url, headers=headers, timeout=PATIENCE_S) as client:
        path = f"/admin/studies/{SLUG}/results"
        for _ in range(rounds + 1):
            began = time.perf_counter()
            answer = client.get(path)
            seconds.append(time.perf_counter() - began)
            assert answer.status_code == 200, answer.status_code
            with database.writing() as connection:  # the last vote goes, and comes again later
                last = connection.execute(select(vote).order_by(vote.c.id.desc()).limit(1)).one()._mapping
                connection.execute(vote.delete().where(vote.c.id == last["id"]))
            client.get(path)
            with database.writing() as connection:
                connection.execute(insert(vote).values(**last))
    database.dispose()
    return {
        "what": "page results after a vote",
        "first_s": round(seconds[0], 3),
        "then_s": round(median(seconds[1:]), 3),
    }


def processor_s(pid: int) -> float:
    """Return the processor time that a process has taken, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def bench(folder: Path, n_votes: int, url: str | None, rounds: int, only: Sequence[str]) -> list[dict[str, Any]]:
    """Measure all requests on a study of so many votes; the database is filled if it is new."""
    settings = Settings(data_dir=folder, database_url=url, api_requests_per_minute=1_000_000)
    if url is not None or not (folder / "study.sqlite").exists():
        began = time.perf_counter()
        with open_database(settings.url) as database:
            upgrade(database)
            fill(database, n_votes)
        print(f"{n_votes} votes inserted in {time.perf_counter() - began:.0f} s", flush=True)
    token = {"Authorization": f"Bearer {add_token(settings, f'bench {time.time_ns()}')['token']}"}
    link = add_experimenter(settings, "Bench", "owner")["path"]
    rows = []
    with StudyServer(folder, database_url=url) as server:
        with Dashboard(server.base_url) as dashboard:
            assert dashboard.enter(link).is_success
            cookies = {"Cookie": "; ".join(f"{name}={value}" for name, value in dashboard.cookies.items())}
        for asked in [*PAGES, *TABLES]:
            if not only or any(word in asked.name for word in only):
                headers = cookies | {"Accept": "text/html"} if asked.is_page else token
                rows.append(measure(server, asked, headers, rounds))
                print(_line(rows[-1]), flush=True)
        if not only or "after" in only:
            rows.append(after_a_vote(server, settings.url, cookies, rounds))
            print(_line(rows[-1]), flush=True)
    return rows


def _line(row: Mapping[str, Any]) -> str:
    numbers = "  ".join(f"{name} {value}" for name, value in row.items() if name != "what")
    return f"{row['what']:28s} {numbers}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--votes", type=int, nargs="+", default=[15_000, 1_000_000])
    parser.add_argument("--keep", type=Path, help="folder for the databases, which stay")
    parser.add_argument("--postgresql", action="store_true", help="on PostgreSQL instead of SQLite")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--only", nargs="*", default=[], help="parts of names")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    results = {}
    with ExitStack() as stack:
        folder = arguments.keep or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        server = stack.enter_context(PostgresServer()) if arguments.postgresql else None
        for n_votes in arguments.votes:
            print(f"== {n_votes} votes", flush=True)
            url = server.new_database(f"votes{n_votes}") if server else None
            results[n_votes] = bench(folder / str(n_votes), n_votes, url, arguments.rounds, arguments.only)
    if arguments.json:
        print(json.dumps(results))


if __name__ == "__main__":
    main()
