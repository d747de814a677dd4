"""The server answers under its own names only, and its links hold its public address."""

from __future__ import annotations

import asyncio
import socket
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from unittest.mock import AsyncMock

import httpx
import pytest
from starlette.requests import Request
from starlette.types import Receive, Scope, Send

from app.main import running_server
from app.settings import Settings
from app.web.limits.hosts import KnownHosts, known_hosts


@pytest.mark.parametrize(
    ("allowed", "public_url", "known", "unknown"),
    [
        (
            None,
            None,
            ["localhost:8000", "127.0.0.1", "[::1]:80", "192.0.2.7:8000", "LOCALHOST", socket.gethostname()],
            ["evil.example", "localhost.evil.example", "", "[", "127.0.0.1.evil.example"],
        ),
        ("", None, ["localhost", "127.0.0.1:9"], ["192.0.2.7", socket.gethostname() + "x"]),
        ("a.example, *.b.example", None, ["a.example:1", "x.b.example"], ["b.example", "xb.example", "192.0.2.7"]),
        (None, "https://study.example", ["study.example", "192.0.2.7"], ["other.example"]),
        ("*", None, ["evil.example"], []),
    ],
)
def test_hosts_are_known(allowed: str | None, public_url: str | None, known: list[str], unknown: list[str]) -> None:
    is_known = known_hosts(allowed, public_url)
    assert [is_known(host) for host in known] == [True] * len(known)
    assert [is_known(host) for host in unknown] == [False] * len(unknown)


@pytest.mark.slow
def test_another_name_is_refused_and_the_page_has_its_headers(tmp_path: Path) -> None:
    with running_server(Settings(data_dir=tmp_path, database_url=None, allowed_hosts="")) as url:
        refused = httpx.get(f"{url}/healthz", headers={"Host": "evil.example"})
        assert refused.status_code == 421
        assert "RECONSTUDY_PUBLIC_URL" in refused.text
        assert refused.headers["X-Content-Type-Options"] == "nosniff"
        assert httpx.get(f"{url}/healthz").status_code == 200


def test_links_hold_the_public_address_whatever_was_asked_for() -> None:
    shown: list[str] = []

    async def app(scope: Scope, _: Receive, __: Send) -> None:
        shown.append(str(Request(scope).base_url))

    guarded = KnownHosts(app, public_url="https://study.example")
    scope = {"type": "http", "scheme": "http", "path": "/s/code", "headers": [(b"host", b"192.0.2.7:8000")]}
    with ThreadPoolExecutor() as thread:  # this one may have an event loop already
        thread.submit(asyncio.run, guarded(scope, AsyncMock(), AsyncMock())).result()
    assert shown == ["https://study.example/"]
