"""What a client may ask of the server before any route sees it: sizes, times and numbers of connections.

A server that faces the network without a proxy meets clients that send a header without end, open a thousand
connections and say nothing, or read an answer a byte at a time. Each costs memory, open files or everybody else's time.
"""

from __future__ import annotations

import ipaddress
import logging
import resource
from asyncio import TimerHandle, Transport
from collections.abc import Callable, Iterable
from typing import Any

from starlette.responses import PlainTextResponse
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

LARGEST_HEAD = 32 * 1024  # bytes of a request's first line and headers
MOST_HEADERS = 100
HEAD_WITHIN_S = 20.0  # from the connection, or from the first byte of a later request, to the end of the headers
BODY_WITHIN_S = 30.0  # and a second more for each KiB that came: a slower client is no browser on any line
BODY_RATE = 1024  # bytes/s
READS_WITHIN_S = 60.0  # an answer of which a client took nothing for so long is given up
MOST_QUIET = 256  # connections of one address without a request at hand; a laboratory of 40 browsers has 240
SPARE_FILES = 128  # of those that the process may open: for the database, films and logs
FEW_FILES = 1024  # fewer are worth a warning

_head_too_large = PlainTextResponse("The request's headers are too large.", 431, {"connection": "close"})
log = logging.getLogger(__name__)


class GuardedProtocol(HttpToolsProtocol):
    """One connection, with limits on what and how long it may send, and on how many its address may have."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.quiet_since: float | None = self.loop.time()  # None while a request is at hand
        self.network = ""
        self._n_head = 0  # bytes since the head began
        self._n_body = 0
        self._is_head = True
        self._began_at = 0.0
        self._sends_until: TimerHandle | None = None
        self._reads_until: TimerHandle | None = None

    def connection_made(self, transport: Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self.network = network_of(self.client[0] if self.client else "")
        _make_room(self, self.connections)
        self._wait(HEAD_WITHIN_S, self._give_up)

    def connection_lost(self, exc: Exception | None) -> None:
        self._wait(None)
        self._forget_reading()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        if self.transport.is_closing():
            return
        if self._is_head:
            if self._n_head == 0 and self.cycle is not None:  # a later request of a connection that was kept
                self._wait(HEAD_WITHIN_S, self._give_up)
            self._n_head += len(data)
        super().data_received(data)
        if self._is_head and self._n_head > LARGEST_HEAD and not self.transport.is_closing():
            log.warning("A connection was closed: its header had more than %d bytes.", LARGEST_HEAD)
            self.transport.write(b"HTTP/1.1 431 \r\nconnection: close\r\ncontent-length: 0\r\n\r\n")
            self.transport.close()

    def on_headers_complete(self) -> None:
        n_bytes = len(self.url) + sum(len(name) + len(value) for name, value in self.headers)
        self.app = _head_too_large if n_bytes > LARGEST_HEAD or len(self.headers) > MOST_HEADERS else self.app
        self._is_head, self._n_body, self.quiet_since, self._began_at = False, 0, None, self.loop.time()
        self._wait(BODY_WITHIN_S, self._check_body)
        super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        self._n_body += len(body)
        super().on_body(body)

    def on_message_complete(self) -> None:
        self._is_head, self._n_head = True, 0
        self._wait(None)
        super().on_message_complete()

    def on_response_complete(self) -> None:
        super().on_response_complete()
        if self.cycle.response_complete:  # else the next of several requests has begun
            self.quiet_since = self.loop.time()

    def pause_writing(self) -> None:
        super().pause_writing()
        self._forget_reading()
        self._reads_until = self.loop.call_later(READS_WITHIN_S, self.transport.abort)

    def resume_writing(self) -> None:
        super().resume_writing()
        self._forget_reading()

    def _forget_reading(self) -> None:
        if self._reads_until is not None:
            self._reads_until.cancel()

    def _wait(self, seconds: float | None, then: Callable[[], None] | None = None) -> None:
        """Call `then` unless the client sends what is expected, and this is called again, within so many seconds."""
        if self._sends_until is not None:
            self._sends_until.cancel()
        self._sends_until = self.loop.call_later(seconds, then) if seconds is not None and then is not None else None

    def _give_up(self) -> None:
        if not self.transport.is_closing():
            self.transport.close()

    def _check_body(self) -> None:
        """Close the connection if the body comes too slowly; while the server itself is slow, wait."""
        now = self.loop.time()
        if self.flow.read_paused:
            self._began_at = now - self._n_body / BODY_RATE  # the time until now is the server's, not the client's
        left = self._began_at + BODY_WITHIN_S + self._n_body / BODY_RATE - now
        if left > 0:
            self._wait(max(left, 1.0), self._check_body)
        else:
            self.transport.abort()


def network_of(address: str) -> str:
    """Return what one client can be told by: an IPv4 address, or the /64 network of an IPv6 address."""
    try:
        parsed = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address  # a socket of this machine has none
    if isinstance(parsed, ipaddress.IPv6Address):
        return str(parsed.ipv4_mapped or ipaddress.ip_network((parsed, 64), strict=False))
    return address


def open_files() -> int:
    """Let this process open as many files as it may, and return how many these are.

    A shell allows 1 024 by default, and every connection is one.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft != hard:
        resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    if hard != resource.RLIM_INFINITY and hard < FEW_FILES:
        log.warning(
            "This process may open %d files, and each connection is one: a few hundred browsers at most. "
            "Raise the limit (`ulimit -n`, or LimitNOFILE in the systemd unit).",
            hard,
        )
    return hard


def _make_room(new: GuardedProtocol, connections: Iterable[Any]) -> None:
    """Close the connection that has been quiet for longest: of the same client if it has many, or of all if files run
    out."""
    everybody = [other for other in connections if other is not new and isinstance(other, GuardedProtocol)]
    if len(everybody) < MOST_QUIET:
        return
    quiet = [other for other in everybody if other.quiet_since is not None and not other.transport.is_closing()]
    ours = [other for other in quiet if other.network == new.network]
    limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    is_full = len(everybody) + SPARE_FILES >= limit > 0
    crowded = ours if len(ours) >= MOST_QUIET else quiet if is_full else []
    if crowded:
        min(crowded, key=lambda other: other.quiet_since or 0.0).transport.abort()
    elif is_full:
        new.transport.abort()
