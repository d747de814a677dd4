"""Send a part of a page whenever it changes, as server-sent events."""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from typing import Any

import anyio
from fastapi import Request
from fastapi.responses import Response
from sse_starlette import EventSourceResponse, ServerSentEvent
from starlette.concurrency import run_in_threadpool

from app.web.roles import is_still_signed_in

REFRESH_S = 1.0
CHECK_SIGNED_IN_S = 3.0  # between checks that the viewer is still signed in
STREAM_LASTS_S = 300.0  # then the browser opens another stream


def live_part(request: Request, event: str, render: Callable[[], Awaitable[str]]) -> Response:
    """Answer with a stream of events.

    Parameters
    ----------
    event : their name, by which the page knows the part
    render : returns the part as HTML; called once a second
    """
    stopped = anyio.Event()
    changes = _changes(request, event, render, stopped)
    return EventSourceResponse(changes, shutdown_event=stopped, shutdown_grace_period=REFRESH_S)


def render_part(request: Request, template: str, context: Mapping[str, Any]) -> str:
    """Render a part of a page."""
    return str(request.app.state.templates.get_template(f"admin/{template}.html").render(**context))


async def _changes(
    request: Request, event: str, render: Callable[[], Awaitable[str]], stopped: anyio.Event
) -> AsyncIterator[ServerSentEvent]:
    """Yield what is rendered whenever it changes, until the page is left, its session ends, or the server stops."""
    last, checked_s = "", anyio.current_time()
    with anyio.move_on_after(STREAM_LASTS_S):
        while not (stopped.is_set() or request.app.state.is_stopping or await request.is_disconnected()):
            if anyio.current_time() >= checked_s + CHECK_SIGNED_IN_S:
                if not await run_in_threadpool(is_still_signed_in, request):
                    return
                checked_s = anyio.current_time()
            shown = await render()
            if shown != last:
                last = shown
                yield ServerSentEvent(shown, event=event)
            with anyio.move_on_after(REFRESH_S - anyio.current_time() % REFRESH_S):  # all pages at once
                await stopped.wait()
