"""Votes over REST: one is acknowledged once it is on disk."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Literal

from fastapi import Path, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute
from pydantic import BaseModel, ValidationError
from pydantic_core import to_json
from starlette.requests import ClientDisconnect
from starlette.types import Receive, Scope, Send

from app.store.vote_records import Ballot
from app.study.valid_vote import Vote
from app.web.gates import ParticipantToken, meant_session, now, participant_token, vote_writer
from app.web.participant.bodies import VoteBody

JSON = "application/json"
LONGEST_TRIAL = 32  # characters of its id


class VoteView(BaseModel):
    """A vote that is on disk; the same again for the same vote."""

    id: str
    trial: str
    number: int
    choice: Literal["a", "b", "none"]
    received_at: datetime


async def vote(
    trial: Annotated[str, Path(max_length=LONGEST_TRIAL)], body: VoteBody, token: ParticipantToken, request: Request
) -> Response:
    """Vote. 201: the vote is on disk; 200: it was already; 409: the trial has another vote; 503: send it again soon."""
    sent = Vote(body.id, body.choice, body.viewing)
    kept = await vote_writer(request).submit(Ballot(token, trial, sent, now(request), meant_session(request)))
    view = {
        "id": kept.vote.client_id,
        "trial": trial,
        "number": kept.number,
        "choice": kept.vote.choice,
        "received_at": kept.received_at,
    }
    return Response(to_json(view), 201 if kept.is_new else 200, media_type=JSON)


class _VoteRoute(APIRoute):
    """Described as `vote` declares it, but called without what FastAPI does around a function: that takes longer than
    all the rest of a vote, and votes are what comes most (bench/server.py)."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.app = _take


async def _take(scope: Scope, receive: Receive, send: Send) -> None:
    request, trial = Request(scope, receive), scope["path_params"]["trial"]
    if len(trial) > LONGEST_TRIAL:
        raise _refusal("path", "trial", f"expected at most {LONGEST_TRIAL} characters")
    body = _read(request, await _content(receive))
    response = await vote(trial, body, await participant_token(request), request)
    await response(scope, receive, send)


async def _content(receive: Receive) -> bytes:
    """What `Request.body` gives, whose three layers take as long as checking a vote."""
    content, is_more = b"", True
    while is_more:
        message = await receive()
        if message["type"] == "http.disconnect":
            raise ClientDisconnect
        content += message.get("body", b"")
        is_more = message.get("more_body", False)
    return content


def _read(request: Request, content: bytes) -> VoteBody:
    media_type = request.headers.get("content-type", "none").partition(";")[0].strip().lower()
    if media_type != JSON:
        raise _refusal("header", "content-type", f"{media_type}: expected {JSON}")
    try:
        return VoteBody.model_validate_json(content)
    except ValidationError as error:
        raise RequestValidationError([{**fault, "loc": ("body", *fault["loc"])} for fault in error.errors()]) from error


def _refusal(part: str, name: str, message: str) -> RequestValidationError:
    return RequestValidationError([{"type": "value_error", "loc": (part, name), "msg": message}])


vote_route = _VoteRoute(
    "/api/v1/session/trials/{trial}/vote",
    vote,
    methods=["PUT"],
    tags=["participants"],
    response_model=VoteView,
    responses={201: {"model": VoteView, "description": "Kept"}},
)
