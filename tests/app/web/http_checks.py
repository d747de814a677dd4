"""What tests ask of answers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import anyio
import httpx


def is_problem(answer: httpx.Response, status: int) -> bool:
    """Whether an answer is an RFC 9457 problem of this status."""
    body = answer.json()
    return (
        answer.status_code == status == body["status"]
        and answer.headers["content-type"] == "application/problem+json"
        and {"type", "title", "detail"} <= body.keys()
    )


def ask(app: Any, path: str = "/", headers: Mapping[str, str] | None = None) -> httpx.Response:
    """One request to an ASGI app without a server."""

    async def request() -> httpx.Response:
        transport = httpx.ASGITransport(app=app)
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
            return await client.get(path, headers=headers)

    with ThreadPoolExecutor(1) as pool:  # the browser tests leave an event loop in this one
        return pool.submit(anyio.run, request).result()


def all_routes(routes: Any) -> Iterator[Any]:
    """The routes of an app, also those of the routers that it includes."""
    for route in routes:
        if hasattr(route, "methods"):
            yield route
        yield from all_routes(getattr(getattr(route, "original_router", None), "routes", ()))
