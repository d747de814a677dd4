"""Show a study's overview, live: each participant's stage, progress and flags, and the pace of votes."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from datetime import datetime, timedelta
from functools import partial
from typing import Any

import anyio
from fastapi import APIRouter, Request
from fastapi.responses import Response
from sse_starlette import EventSourceResponse, ServerSentEvent
from starlette.concurrency import run_in_threadpool

from app.store.designs import datasets_of
from app.store.invitations import invitations_of
from app.store.monitor import votes_by_minute
from app.store.orders import n_taken_in
from app.store.participants import participant_records
from app.store.sessions import why_closed
from app.store.studies import Study, progress_of
from app.study.options import parse_options
from app.study.stages import ENDS, FINISHED
from app.web.admin.flags import PATIENCE_S, Flags
from app.web.admin.layout import study_page
from app.web.gates import AStudy, Person, database, is_still_signed_in, now

REFRESH_S = 1.0
CHECK_SIGNED_IN_S = 3.0  # between checks that the viewer is still signed in
STREAM_LASTS_S = 300.0  # then the browser opens another stream
HERE = timedelta(minutes=2)  # since the last sign of activity; a trial takes a fraction of it
AWAY = timedelta(minutes=30)
PACE_MINUTES = 60

router = APIRouter(prefix="/admin/studies/{slug}", include_in_schema=False)


class SharedMonitor:
    """A study's monitor as all open pages show it, rendered once a second however many there are."""

    def __init__(self) -> None:
        self._lock = anyio.Lock()
        self._rendered_s = -1
        self._text = ""

    async def at(self, time_s: float, render: Callable[[], str]) -> str:
        """Return the monitor at a time of the event loop's clock."""
        second = int(time_s // REFRESH_S)
        async with self._lock:
            if self._rendered_s < second:
                self._text = await run_in_threadpool(render)
                self._rendered_s = second
            return self._text


@router.get("")
def overview_page(request: Request, person: Person, study: AStudy) -> Response:
    with database(request).reading() as connection:
        compared = datasets_of(connection, study.id)
        invitations = [invitation for invitation in invitations_of(connection, study.id) if not invitation.is_used]
    link = f"{request.base_url}s/{invitations[0].code}" if invitations else None
    practised = [films for films in parse_options(study.options).practice_pairs if films.dataset in compared]
    context = {**monitor_of(request, study, PATIENCE_S), "link": link, "practised": practised}
    return study_page(request, "overview", person, study, context)


@router.get("/live")
async def live(request: Request, person: Person, study: AStudy) -> Response:  # noqa: ARG001 (the gate)
    """Send the monitor whenever it changes, as server-sent events."""
    stopped = anyio.Event()
    changes = _changes(request, study, stopped)
    return EventSourceResponse(changes, shutdown_event=stopped, shutdown_grace_period=REFRESH_S)


async def _changes(request: Request, study: Study, stopped: anyio.Event) -> AsyncIterator[ServerSentEvent]:
    """Yield the monitor whenever it changes, until the page is left, its reader's session ends, or the server stops."""
    monitor = request.app.state.monitors.setdefault(study.id, SharedMonitor())
    last, checked_s = "", anyio.current_time()
    with anyio.move_on_after(STREAM_LASTS_S):
        while not (stopped.is_set() or request.app.state.is_stopping or await request.is_disconnected()):
            if anyio.current_time() >= checked_s + CHECK_SIGNED_IN_S:
                if not await run_in_threadpool(is_still_signed_in, request):
                    return
                checked_s = anyio.current_time()
            shown = await monitor.at(anyio.current_time(), partial(_rendered, request, study))
            if shown != last:
                last = shown
                yield ServerSentEvent(shown, event="monitor")
            with anyio.move_on_after(REFRESH_S - anyio.current_time() % REFRESH_S):  # all pages at once
                await stopped.wait()


def _rendered(request: Request, study: Study) -> str:
    template = request.app.state.templates.get_template("admin/_monitor.html")
    with database(request).reading() as connection:
        progress = progress_of(connection, study.id)
    text: str = template.render(study=study, progress=progress, **monitor_of(request, study))
    return text


def monitor_of(request: Request, study: Study, patience_s: float = 0.0) -> dict[str, Any]:
    """Return the monitor's content now; `patience_s` is how long to wait for flags."""
    moment = now(request)
    with database(request).reading() as connection:
        people = participant_records(connection, study.id)
        pace = votes_by_minute(connection, study.id, moment, PACE_MINUTES)
        n_finished, n_under_way = n_taken_in(connection, study, moment)
        why = why_closed(connection, study, moment)
    flags: Flags = request.app.state.flags
    flagged = flags.of(study.id, people, moment, patience_s)
    lines = [_line(row, flagged.get(row["participant"], ()), moment) for row in people]
    options = parse_options(study.options)
    stages = (*options.way, *(stage for stage in ENDS if stage != FINISHED))
    by_stage = [(stage, sum(line["stage"] == stage for line in lines)) for stage in stages]
    return {
        "lines": sorted(lines, key=lambda line: (line["stage"] in ENDS, -line["last_at"].timestamp())),
        "by_stage": [(stage, n) for stage, n in by_stage if n or stage in options.way],
        "pace": pace,
        "limits": options.limits,
        "taken_in": {"n_finished": n_finished, "n_under_way": n_under_way, "why_closed": why},
        "peak": max([*pace, 1]),
        "n_voided": sum(line["n_voided"] for line in lines),
    }


def _line(row: dict[str, Any], flags: tuple[str, ...], moment: datetime) -> dict[str, Any]:
    last_at = max(filter(None, (row["started_at"], row["last_served_at"], row["last_vote_at"], row["finished_at"])))
    return {**row, "connection": _connection(row["stage"], moment - last_at), "last_at": last_at, "flags": flags}


def _connection(stage: str, silent: timedelta) -> str:
    if stage in ENDS:
        return "done"
    return "here" if silent <= HERE else "quiet" if silent <= AWAY else "away"
