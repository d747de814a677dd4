"""People who take a whole study and never give up: what nobody answers they send again, as the page does."""

from __future__ import annotations

import json
import re
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, field
from itertools import count
from threading import Event, Lock

import httpx
import numpy as np
from sqlalchemy import func, select

from app.simulation.participants import begin, next_trial, pass_stages, vote
from app.store.database.engine import open_database
from app.store.database.tables import session, stage_record, trial
from app.store.database.tables import vote as stored_vote
from app.study.stages import FINISHED

ASKED_AGAIN_S = 0.05
GIVES_UP_S = 300.0
NOT_NOW = (502, 503)
VOTE = re.compile(r"/api/v1/session/trials/([^/]+)/vote")


@dataclass
class Tally:
    """What people have seen: acknowledged votes as (trial, id, choice), answers by status, broken connections."""

    acknowledged: list[tuple[str, str, str]] = field(default_factory=list)
    statuses: Counter[int] = field(default_factory=Counter)
    n_broken: int = 0
    lock: Lock = field(default_factory=Lock)

    def note(self, request: httpx.Request, content: bytes, status: int) -> None:
        with self.lock:
            self.statuses[status] += 1
            if (voted := VOTE.fullmatch(request.url.path)) and status < 300:
                body = json.loads(content)
                self.acknowledged.append((voted[1], body["id"], body["choice"]))


class Patient(httpx.BaseTransport):
    """Sends a request until it is answered, by something else than "not now"."""

    def __init__(self, tally: Tally) -> None:
        self._tally, self._line = tally, httpx.HTTPTransport()

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        content, ends_s = request.read(), time.monotonic() + GIVES_UP_S
        while True:
            try:
                again = httpx.Request(
                    request.method, request.url, headers=request.headers, content=content, extensions=request.extensions
                )
                answer = self._line.handle_request(again)
                with closing(answer):  # which a broken line leaves open
                    answer.read()
            except httpx.TransportError:
                self._tally.n_broken += 1
                self._line.close()
                self._line = httpx.HTTPTransport()
            else:
                self._tally.note(request, content, answer.status_code)
                if answer.status_code not in NOT_NOW:
                    return answer
            assert time.monotonic() < ends_s, f"{request.method} {request.url} is not answered"
            time.sleep(ASKED_AGAIN_S)

    def close(self) -> None:
        self._line.close()


def take_part(base_url: str, slug: str, invitation: str, seed: int, tally: Tally) -> None:
    """Take a study from its first page to its last."""
    rng = np.random.default_rng(seed)
    with httpx.Client(base_url=base_url, transport=Patient(tally), timeout=60) as client:
        taken = begin(client, slug, invitation, rng=rng)
        headers = {"Authorization": f"Bearer {taken['token']}"}
        while shown := next_trial(client, taken["token"]):
            vote(client, taken["token"], shown, str(rng.choice(["a", "b", "none"])), rng)
        pass_stages(client, taken | client.get("/api/v1/session", headers=headers).json())


def people_under(
    fault: Callable[[], None],
    n_faults: int,
    pause_s: Callable[[], float],
    take: Callable[[int], None],
    *,
    at_once: int,
) -> int:
    """Let people take part, so many at once, until so many faults have happened; returns how many took part."""
    numbers, over = count(), Event()

    def seat() -> int:
        """One person after another, the last to their end; how many sat here."""
        n_taken = 0
        while n_taken == 0 or not over.is_set():
            take(next(numbers))
            n_taken += 1
        return n_taken

    with ThreadPoolExecutor(at_once) as pool:
        taken = [pool.submit(seat) for _ in range(at_once)]
        try:
            for _ in range(n_faults):
                time.sleep(pause_s())
                fault()
        finally:
            over.set()
        return sum(seats.result() for seats in taken)


def compare(url: str, tally: Tally, n_people: int) -> dict[str, int]:
    """What is stored beside what people were told; each but the first three is to be 0."""
    with open_database(url) as database, database.reading() as connection:
        joined = select(trial.c.public_id, stored_vote.c.client_id, stored_vote.c.choice).join(trial)
        stored = [tuple(row) for row in connection.execute(joined)]
        stages = connection.execute(select(session.c.stage)).scalars().all()
        counted = select(func.count()).select_from(stage_record).group_by(stage_record.c.session_id)
        records = connection.execute(counted.add_columns(stage_record.c.stage).group_by(stage_record.c.stage)).all()
    told = set(tally.acknowledged)
    return {
        "people": n_people,
        "acknowledged": len(told),
        "stored": len(stored),
        "lost": len(told - set(stored)),
        "doubled": len(stored) - len({public_id for public_id, _, _ in stored}),
        "people_doubled": len(stages) - n_people,
        "unfinished": sum(stage != FINISHED for stage in stages),
        "stages_doubled": sum(row[0] > 1 for row in records),
        "server_errors": sum(n for status, n in tally.statuses.items() if status >= 500 and status not in NOT_NOW),
    }
