"""Clients that send without end, say nothing, or read nothing are turned away, and everybody else is answered."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from itertools import repeat
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest

from app.main import running_server
from app.settings import Settings
from app.web.limits import connections
from app.web.limits.connections import LARGEST_HEAD, MOST_HEADERS, network_of

pytestmark = pytest.mark.slow

LINE = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n"


@pytest.fixture
def attacked(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[str]:
    """A server whose patience is short; its address."""
    monkeypatch.setattr(connections, "HEAD_WITHIN_S", 0.3)
    monkeypatch.setattr(connections, "BODY_WITHIN_S", 0.3)
    monkeypatch.setattr(connections, "READS_WITHIN_S", 0.3)
    monkeypatch.setattr(connections, "MOST_QUIET", 20)
    with running_server(Settings(data_dir=tmp_path, database_url=None)) as url:
        yield url


def connected(url: str) -> socket.socket:
    parts = urlsplit(url)
    return socket.create_connection((parts.hostname, parts.port), timeout=10)


def rest_of(client: socket.socket) -> bytes:
    """What the server sends until it closes the connection."""
    received = b""
    try:
        while part := client.recv(65536):
            received += part
    except ConnectionResetError:
        pass
    return received


def sent_until_closed(client: socket.socket, parts: Iterable[bytes], pause_s: float = 0.0) -> int:
    """Send until the server closes the connection; returns how many bytes were taken."""
    n_sent = 0
    for part in parts:
        try:
            client.sendall(part)
        except OSError:
            return n_sent
        n_sent += len(part)
        time.sleep(pause_s)
    raise AssertionError(f"all of {n_sent} bytes were taken")


def test_a_header_without_end_is_cut_off(attacked: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "HEAD_WITHIN_S", 60.0)  # by its size, before its time is over
    with connected(attacked) as client:
        client.sendall(LINE + b"x-long: ")
        n_sent = sent_until_closed(client, repeat(b"x" * 65536, 1000))
    assert n_sent < 16 * 1024 * 1024  # what the sockets' buffers took
    assert httpx.get(f"{attacked}/healthz").status_code == 200


@pytest.mark.parametrize(
    "headers",
    [
        [("x-long", "x" * LARGEST_HEAD)],
        [(f"x-{n}", "x") for n in range(MOST_HEADERS + 1)],
    ],
)
def test_headers_that_are_too_long_or_too_many_are_refused(attacked: str, headers: list[tuple[str, str]]) -> None:
    lines = "".join(f"{name}: {value}\r\n" for name, value in headers)
    with connected(attacked) as client:
        client.sendall(LINE + lines.encode() + b"\r\n")
        assert rest_of(client).startswith(b"HTTP/1.1 431 ")


def test_a_header_that_comes_by_drops_ends_in_time(attacked: str) -> None:
    with connected(attacked) as client:
        client.sendall(LINE)
        sent_until_closed(client, repeat(b"x", 100), pause_s=0.05)
    with connected(attacked) as client:  # the second head of a connection that is kept
        client.sendall(LINE + b"\r\n")
        assert client.recv(65536).startswith(b"HTTP/1.1 200 ")
        client.sendall(b"GET ")
        assert rest_of(client) == b""


def test_a_body_that_comes_by_drops_is_given_up(attacked: str) -> None:
    with connected(attacked) as client:
        client.sendall(b"POST /admin/login HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000\r\n\r\nx")
        assert b" 200 " not in rest_of(client)


def test_who_reads_nothing_of_a_long_answer_is_given_up(attacked: str) -> None:
    with connected(attacked) as client:
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        client.sendall((LINE.replace(b"/healthz", b"/api/v1/openapi.json") + b"\r\n") * 400)
        time.sleep(1.5)
        sent_until_closed(client, repeat(b"x" * 65536, 400))


def test_many_silent_connections_leave_room_for_one_that_asks(attacked: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "HEAD_WITHIN_S", 60.0)  # none is closed for its silence meanwhile
    with ExitStack() as opened:
        silent = [opened.enter_context(connected(attacked)) for _ in range(60)]
        assert httpx.get(f"{attacked}/healthz").status_code == 200
        assert rest_of(silent[0]) == b""  # the oldest goes first


def test_an_ipv6_network_is_one_client() -> None:
    assert network_of("2001:db8::1") == network_of("2001:db8::2%eth0") != network_of("2001:db8:0:1::1")
    assert network_of("::ffff:192.0.2.7") == network_of("192.0.2.7") != network_of("192.0.2.8")
    assert network_of("") == ""
