"""What tests ask of answers."""

from __future__ import annotations

import httpx


def is_problem(answer: httpx.Response, status: int) -> bool:
    """Whether an answer is an RFC 9457 problem of this status."""
    body = answer.json()
    return (
        answer.status_code == status == body["status"]
        and answer.headers["content-type"] == "application/problem+json"
        and {"type", "title", "detail"} <= body.keys()
    )
