"""Trials over REST: which comes next is the server's decision, and a vote is acknowledged once it is on disk."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Literal

from fastapi import APIRouter, Path, Response
from pydantic import BaseModel, Field

from app.errors import ConflictError
from app.store.sessions import Session, done_of
from app.store.trials import NextTrial, mark_served, next_trials
from app.store.votes import keep_vote
from app.study.stages import FINISHED, TRIAL
from app.study.votes import Vote
from app.web.gates import Now, Participant, Store
from app.web.participant import Strict

router = APIRouter(prefix="/api/v1/session/trials", tags=["participants"])

LONGEST_MS = 24 * 3600 * 1000.0  # a day: whoever leaves a trial open overnight has still seen it
MOST_SWITCHES = 2000

Label = Literal["a", "b"]
Milliseconds = Annotated[float, Field(ge=0, le=LONGEST_MS, allow_inf_nan=False)]
Seconds = Annotated[float, Field(ge=0, le=LONGEST_MS / 1000, allow_inf_nan=False)]
UUID = r"^[0-9a-f]{8}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{12}$"


class MediaView(BaseModel):
    url: str
    layout: Literal["stacked"]
    a: Literal["top", "bottom"]
    width: int = Field(description="of one half, pixels")
    height: int = Field(description="of one half, pixels")
    guard_rows: int = Field(description="rows between the halves that belong to neither")
    fps: float
    n_frames: int


class TrialView(BaseModel):
    """What a participant's player needs, and no name of what is compared."""

    trial: str
    number: int
    total: int
    exposure_s: float
    first_shown: Label
    media: MediaView
    next_media: str | None = Field(description="to fetch meanwhile; null at the last trial")


class SwitchBody(Strict):
    to: Label
    at_ms: Milliseconds
    media_time_s: Seconds


class ViewingBody(Strict):
    first_shown: Label
    shown_ms: Milliseconds
    response_ms: Milliseconds
    switches: Annotated[list[SwitchBody], Field(max_length=MOST_SWITCHES)]


class VoteBody(Strict):
    id: Annotated[str, Field(pattern=UUID, examples=["6f1c2e0a-6d3b-4f5e-9a51-0c6b7f3d2e18"])]
    choice: Literal["a", "b", "none"]
    viewing: ViewingBody


class VoteView(BaseModel):
    """A vote that is on disk; the same again for the same vote."""

    id: str
    trial: str
    number: int
    choice: Literal["a", "b", "none"]
    received_at: datetime


@router.get("/next", response_model=TrialView, responses={204: {"description": "No trial is left"}})
def next_trial(signed_in: Participant, database: Store, now: Now) -> TrialView | Response:
    """The trial to show now; the same one until its vote is in. 409: the trials have not begun."""
    session = signed_in.session
    if session.stage == FINISHED:
        return Response(status_code=204)
    if session.stage != TRIAL:
        raise ConflictError(f"The trials have not begun: the session is in the stage {session.stage}.")
    with database.reading() as connection:
        upcoming = next_trials(connection, session.id)
        total = done_of(connection, session.id).n_total
    if not upcoming:  # the last vote came in between
        return Response(status_code=204)
    current, *following = upcoming
    if current.served_at is None:
        mark_served(database, current.id, now)
    return _trial_view(session, current, total, following[0] if following else None)


@router.put("/{trial}/vote", response_model=VoteView, responses={201: {"model": VoteView, "description": "Kept"}})
def vote(
    trial: Annotated[str, Path(max_length=32)],
    body: VoteBody,
    signed_in: Participant,
    response: Response,
    database: Store,
    now: Now,
) -> VoteView:
    """Vote. 201: the vote is on disk; 200: it was already; 409: the trial has another vote."""
    sent = Vote(body.id, body.choice, body.viewing.model_dump())
    kept = keep_vote(database, signed_in.session, trial, sent, now)
    response.status_code = 201 if kept.is_new else 200
    return VoteView(
        id=kept.vote.client_id,
        trial=trial,
        number=kept.number,
        choice=kept.vote.choice,
        received_at=kept.received_at,
    )


def _trial_view(session: Session, current: NextTrial, total: int, following: NextTrial | None) -> TrialView:
    media = {
        "url": media_url(current.media),
        "layout": "stacked",
        "a": current.a_half,
        "width": current.width,
        "height": current.height,
        "guard_rows": current.guard_rows,
        "fps": current.fps,
        "n_frames": current.n_frames,
    }
    return TrialView(
        trial=current.public_id,
        number=current.position + 1,
        total=total,
        exposure_s=session.exposure_s,
        first_shown="a" if current.first_shown == "a" else "b",
        media=MediaView.model_validate(media),
        next_media=media_url(following.media) if following else None,
    )


def media_url(media: str) -> str:
    return f"/media/{media}"
