"""Many participants at once, reduced to what they send: each vote again and again until it is acknowledged."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Awaitable, Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from random import Random
from threading import Condition
from uuid import UUID

from tests.seeded_studies import Voter

ANSWER_TIMEOUT_S = 30
EVENT_TIMEOUT_S = 60
FIRST_VOTE_MS, TRIAL_MS = 1_767_225_600_000, 20_000  # since 1970


@dataclass
class Tally:
    """What voters have seen: acknowledged votes as (trial, client id, choice), answers by status, latencies."""

    acknowledged: list[tuple[str, str, str]] = field(default_factory=list)
    statuses: dict[int, int] = field(default_factory=dict)
    n_broken: int = 0  # connections that ended without an answer
    latencies_ms: list[float] = field(default_factory=list)
    seconds: float = 0.0
    changed: Condition = field(default_factory=Condition)

    def wait_until(self, holds: Callable[[], bool]) -> None:
        """Wait in another thread than the voters' until something holds of what they have seen."""
        with self.changed:
            assert self.changed.wait_for(holds, EVENT_TIMEOUT_S), "the voters have never seen it"

    def acknowledge(self, letter: Letter) -> None:
        with self.changed:
            self.acknowledged.append((letter.trial, letter.client_id, letter.choice))
            self.changed.notify_all()

    def count(self, status: int) -> None:
        with self.changed:
            self.statuses[status] = self.statuses.get(status, 0) + 1
            self.changed.notify_all()


@dataclass(frozen=True)
class Letter:
    """A vote as it goes over the line."""

    trial: str
    client_id: str
    choice: str
    content: bytes


def letters_of(voter: Voter, rng: Random, *, n_switches: int = 4) -> list[Letter]:
    """A voter's votes in order."""
    return [
        _letter(voter.token, trial, first_shown, rng, n_switches, at_ms=FIRST_VOTE_MS + number * TRIAL_MS)
        for number, (trial, first_shown) in enumerate(voter.trials)
    ]


def send(
    port: int,
    bundles: Sequence[Sequence[Letter]],
    before_retry: Callable[[], Awaitable[object]] | None = None,
    *,
    repeat: float = 0.0,
    rng: Random | None = None,
    tally: Tally | None = None,
) -> Tally:
    """`send_all` in a thread of its own: a browser that other tests drive keeps an event loop running in this one."""
    with ThreadPoolExecutor(1) as pool:
        sending = send_all(port, bundles, before_retry, repeat=repeat, rng=rng, tally=tally)
        return pool.submit(asyncio.run, sending).result()


async def send_all(
    port: int,
    bundles: Sequence[Sequence[Letter]],
    before_retry: Callable[[], Awaitable[object]] | None = None,
    *,
    repeat: float = 0.0,
    rng: Random | None = None,
    timeout_s: float = 120,
    tally: Tally | None = None,
) -> Tally:
    """Send every bundle over a connection of its own, all at once, each letter until it is acknowledged.

    Parameters
    ----------
    before_retry : waits before a letter is sent again that was refused or met a broken connection; None: no wait
    repeat : share of the letters that are sent once more later, as a client does that did not hear the answer
    tally : to look at meanwhile
    """
    tally = tally or Tally()
    rng = rng or Random(1)
    started = time.perf_counter()
    async with asyncio.timeout(timeout_s), asyncio.TaskGroup() as group:
        for bundle in bundles:
            group.create_task(_send_bundle(Line(port, tally, before_retry), bundle, repeat, rng))
    tally.seconds = time.perf_counter() - started
    return tally


async def _send_bundle(line: Line, bundle: Sequence[Letter], repeat: float, rng: Random) -> None:
    try:
        for number, letter in enumerate(bundle):
            await line.deliver(letter)
            line.tally.acknowledge(letter)
            if rng.random() < repeat:
                await line.deliver(bundle[rng.randrange(number + 1)])
    finally:
        await line.close()


class Line:
    """A connection that is opened again when it breaks."""

    def __init__(self, port: int, tally: Tally, before_retry: Callable[[], Awaitable[object]] | None = None) -> None:
        self.tally = tally
        self._port, self._before_retry = port, before_retry
        self._streams: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None

    async def deliver(self, letter: Letter) -> None:
        """Send a letter until it is acknowledged."""
        while not await self._is_acknowledged(letter):
            if self._before_retry is not None:
                await self._before_retry()

    async def close(self) -> None:
        if self._streams:
            self._streams[1].close()
            with suppress(OSError):
                await self._streams[1].wait_closed()
        self._streams = None

    async def _is_acknowledged(self, letter: Letter) -> bool:
        started = time.perf_counter()
        try:
            status = await asyncio.wait_for(self._ask(letter.content), ANSWER_TIMEOUT_S)
        except (OSError, asyncio.IncompleteReadError, TimeoutError):
            self.tally.n_broken += 1
            await self.close()
            return False
        self.tally.count(status)
        if status in (500, 502, 503):
            return False
        if status not in (200, 201):
            raise RuntimeError(f"vote {letter.client_id} on {letter.trial}: answered {status}")
        self.tally.latencies_ms.append(1000 * (time.perf_counter() - started))
        return True

    async def _ask(self, content: bytes) -> int:
        if self._streams is None:
            self._streams = await asyncio.open_connection("127.0.0.1", self._port)
        reader, writer = self._streams
        writer.write(content)
        head = (await reader.readuntil(b"\r\n\r\n")).lower()
        length = int(head.partition(b"content-length:")[2].partition(b"\r\n")[0])
        await reader.readexactly(length)
        if head.startswith(b"http/1.0") or b"connection: close" in head:
            await self.close()
        return int(head[9:12])


def _letter(token: str, trial: str, first_shown: str, rng: Random, n_switches: int, at_ms: int) -> Letter:
    client_id, choice = _client_id(at_ms + rng.randrange(TRIAL_MS), rng), rng.choice(["a", "b", "none"])
    other = "b" if first_shown == "a" else "a"
    switches = [
        {"to": (other, first_shown)[turn % 2], "at_ms": 500.25 * turn, "media_time_s": 0.5 * turn}
        for turn in range(n_switches)
    ]
    viewing = {"first_shown": first_shown, "shown_ms": 15000.0, "response_ms": 812.5, "switches": switches}
    body = json.dumps({"id": client_id, "choice": choice, "viewing": viewing}).encode()
    head = (
        f"PUT /api/v1/session/trials/{trial}/vote HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {token}\r\n"
        f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n\r\n"
    )
    return Letter(trial, client_id, choice, head.encode() + body)


def _client_id(at_ms: int, rng: Random) -> str:
    """As static/js/outbox.js makes it: a UUID of version 7 (RFC 9562)."""
    return str(UUID(int=at_ms << 80 | 7 << 76 | rng.getrandbits(12) << 64 | 2 << 62 | rng.getrandbits(62)))
