"""Votes over REST: one is acknowledged once it is on disk.

On the way there a vote passes eight modules: web/gates, this one, store/vote_writer, store/vote_records, which asks
study/valid_vote, study/smoothness and store/keys, and store/engine. It is a `VoteBody`, then a `Vote`, a row, and a
`KeptVote`.
"""

from __future__ import annotations

from asyncio import wrap_future
from datetime import datetime
from typing import Annotated, Literal

from fastapi import APIRouter, Path, Request, Response
from pydantic import BaseModel

from app.store.trials.vote_records import Vote
from app.web.gates import Now, ParticipantToken, meant_session, vote_writer
from app.web.participant.trial_bodies import VoteBody

router = APIRouter(prefix="/api/v1/session", tags=["participants"])


class VoteView(BaseModel):
    """A vote that is on disk; the same again for the same vote."""

    id: str
    trial: str
    number: int
    choice: Literal["a", "b", "none"] | None
    rating: int | None
    received_at: datetime


@router.put("/trials/{trial}/vote", responses={201: {"model": VoteView, "description": "Kept"}})
async def vote(
    trial: Annotated[str, Path(max_length=32)],
    body: VoteBody,
    token: ParticipantToken,
    now: Now,
    request: Request,
    response: Response,
) -> VoteView:
    """Vote: by a choice in the protocol PC, by a rating in all others.

    201: the vote is on disk; 200: it was already; 409: the trial has another vote; 503: send it again soon.
    """
    sent = Vote(token, trial, body.id, body.choice, body.viewing, now, meant_session(request), body.rating)
    kept = await wrap_future(vote_writer(request).submit(sent))
    response.status_code = 201 if kept.is_new else 200
    return VoteView(
        id=body.id,
        trial=trial,
        number=kept.number,
        choice=body.choice,
        rating=body.rating,
        received_at=kept.received_at,
    )
