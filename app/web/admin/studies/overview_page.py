"""Show a study's overview, live: each participant's stage, progress and flags, and the pace of votes."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime, timedelta
from functools import partial
from typing import Any

import anyio
from fastapi import APIRouter, Request
from fastapi.responses import Response
from starlette.concurrency import run_in_threadpool

from app.operations.studies.create import telling_names
from app.store.access.rights import Role
from app.store.participants.invitations import invitations_of
from app.store.participants.participants import (
    SoughtPeople,
    last_heard_at,
    n_interrupted,
    participant_records,
    session_state,
)
from app.store.studies.film_failures import settle_failures
from app.store.studies.studies import Study, progress_of, study_by_id
from app.store.trials.admission import why_closed
from app.store.trials.counted_votes import vote_state
from app.store.trials.designs import conditions_of, datasets_of
from app.store.trials.monitor import votes_by_minute
from app.store.trials.orders import n_taken_in
from app.study.options.options import parse_options
from app.study.options.platforms import unknown_placeholders
from app.study.options.privacy import forgets_at
from app.study.stages import ENDS, FINISHED
from app.web.admin.alarms import alarm_in
from app.web.admin.flags import PATIENCE_S, Flags
from app.web.admin.layout import see, study_page
from app.web.admin.live import REFRESH_S, live_part, render_part
from app.web.gates import Store, database, link_to, now
from app.web.roles import Acting, AStudy, Person

HERE = timedelta(minutes=2)  # since the last sign of activity; a trial takes a fraction of it
AWAY = timedelta(minutes=30)
PACE_MINUTES = 60
LINES = 100  # of participants who have ended
MOST_GOING = 500  # participants under way of whom the last sign is looked up; the newest
MOST_LINES = 25  # of participants; those who are here come first, and Participants lists all
SEES_PEOPLE: Role = "experimenter"

router = APIRouter(prefix="/admin/studies/{slug}", include_in_schema=False)


class SharedMonitor:
    """A study's monitor as all open pages of a role show it, rendered once a second however many there are."""

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
        telling = telling_names(study.name, list(conditions_of(connection, study.id)))
        invitations = [each for each in invitations_of(connection, study.id) if each.is_shared]
    options = parse_options(study.options)
    link = link_to(request, study, invitations[0].code) if invitations else None
    practised = [films for films in options.practice_pairs if films.dataset in compared]
    context = {
        **monitor_of(request, study, PATIENCE_S),
        "link": link,
        "is_of_platform": bool(options.outside.id),
        "is_filled": not unknown_placeholders(options.outside),
        "practised": practised,
        "telling": telling,
    }
    context |= {"forgets_at": forgets_at(options, study.closed_at)}
    context |= {"may_see_people": person.may(SEES_PEOPLE)}
    return study_page(request, "overview", person, study, context)


@router.get("/live")
async def live(request: Request, person: Person, study: AStudy) -> Response:
    """Send the monitor whenever it changes, as server-sent events."""
    may_see_people = person.may(SEES_PEOPLE)
    monitor = request.app.state.monitors.setdefault((study.id, may_see_people), SharedMonitor())
    render = partial(_rendered, request, study, may_see_people=may_see_people)
    return live_part(request, "monitor", lambda: monitor.at(anyio.current_time(), render))


@router.post("/failures")
def take_note(actor: Acting, study: AStudy, store: Store) -> Response:
    """Take note of all films that failed: they are no alarm any more."""
    with store.writing() as connection:
        n = settle_failures(connection, study.id, actor.now)
        actor.note(connection, "failing films noted", study, study.slug, failures=n)
    return see(f"/admin/studies/{study.slug}")


def _rendered(request: Request, study: Study, *, may_see_people: bool) -> str:
    with database(request).reading() as connection:
        progress = progress_of(connection, study.id)
        now_study = study_by_id(connection, study.id) or study  # a rule may have paused it since the page was opened
    context = {"study": now_study, "progress": progress, "may_see_people": may_see_people}
    return render_part(request, "_monitor", {**context, **monitor_of(request, study)})


def monitor_of(request: Request, study: Study, patience_s: float = 0.0) -> dict[str, Any]:
    """Return the monitor's content now; `patience_s` is how long to wait for flags."""
    moment = now(request)
    with database(request).reading() as connection:
        votes = vote_state(connection, study.id)
        going, ended = (
            participant_records(connection, study.id, SoughtPeople(standing=standing), limit=most, newest_first=True)
            for standing, most in (("going", MOST_GOING), ("ended", LINES))
        )
        n_in_stage = {row[0]: row[1] for row in session_state(connection, study.id)}
        n_voided = n_interrupted(connection, study.id)
        pace = votes_by_minute(connection, study.id, moment, PACE_MINUTES)
        n_finished, n_under_way = n_taken_in(connection, study, moment)
        why = why_closed(connection, study, moment)
    flags: Flags = request.app.state.flags
    flagged = flags.of(study.id, votes, moment, patience_s)
    lines = [_line(row, flagged.get(row["participant"], ()), moment) for row in [*going, *ended]]
    options = parse_options(study.options)
    stages = (*options.way, *(stage for stage in ENDS if stage != FINISHED))
    by_stage = [(stage, n_in_stage.get(stage, 0)) for stage in stages]
    in_order = sorted(lines, key=lambda line: (line["stage"] in ENDS, -line["last_at"].timestamp()))
    return {
        "lines": in_order,
        "most_lines": MOST_LINES,
        "n_here": sum(line["connection"] == "here" for line in lines),
        "by_stage": [(stage, n) for stage, n in by_stage if n or stage in options.way],
        "pace": pace,
        "limits": options.limits,
        "taken_in": {"n_finished": n_finished, "n_under_way": n_under_way, "why_closed": why},
        "peak": max([*pace, 1]),
        "n_voided": n_voided,
        "alarm": alarm_in(database(request), study),
    }


def _line(row: dict[str, Any], flags: tuple[str, ...], moment: datetime) -> dict[str, Any]:
    last_at = last_heard_at(row)
    return {**row, "connection": _connection(row["stage"], moment - last_at), "last_at": last_at, "flags": flags}


def _connection(stage: str, silent: timedelta) -> str:
    if stage in ENDS:
        return "done"
    return "here" if silent <= HERE else "quiet" if silent <= AWAY else "away"
