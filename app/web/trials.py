"""Trials over REST: which comes next is the server's decision, and a vote is acknowledged once it is on disk."""

from __future__ import annotations

import asyncio
import logging
from datetime import datetime
from typing import Annotated, Literal

from fastapi import APIRouter, Path, Response
from pydantic import BaseModel, Field

from app.errors import ConflictError, GoneError
from app.store.designs import PracticePair, practice_pairs
from app.store.sessions import Done, Session, done_of
from app.store.trials import MOST_ATTEMPTS, NextTrial, mark_served, next_trials, void_trial
from app.store.votes import Ballot
from app.study.stages import SCREENED_OUT, TRIAL, is_past
from app.study.trial import Half
from app.study.votes import Vote
from app.web.gates import Now, Participant, ParticipantToken, Store, Votes
from app.web.participant import UUID, Strict

log = logging.getLogger(__name__)

router = APIRouter(prefix="/api/v1/session", tags=["participants"])

LONGEST_MS = 24 * 3600 * 1000.0  # a day: whoever leaves a trial open overnight has still seen it
MOST_SWITCHES = 2000

# H.264 is not among them: what a browser must play is known to the page. Levels as two films of full HD need them.
FILM_TYPES = {"vp9": 'video/mp4; codecs="vp09.00.51.08"', "av1": 'video/mp4; codecs="av01.0.12M.08"'}

Label = Literal["a", "b"]
Milliseconds = Annotated[float, Field(ge=0, le=LONGEST_MS, allow_inf_nan=False)]
Seconds = Annotated[float, Field(ge=0, le=LONGEST_MS / 1000, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=0, le=10_000_000)]
Reason = Literal["full screen", "hidden"]


class SecondView(BaseModel):
    """The same film in another codec."""

    url: str
    type: str = Field(description="MIME type with the codec, to ask the browser about")


class MediaView(BaseModel):
    url: str = Field(description="H.264")
    second: SecondView | None = Field(description="for browsers that do not play H.264, where the study has it")
    layout: Literal["stacked"]
    a: Literal["top", "bottom"]
    width: int = Field(description="of one half, pixels")
    height: int = Field(description="of one half, pixels")
    guard_rows: int = Field(description="rows between the halves that belong to neither")
    reference: bool = Field(description="whether the reference lies below both, after as many guard rows")
    fps: float
    n_frames: int


class OneTrialView(BaseModel):
    """What a participant's player needs, and no name of what is compared."""

    trial: str
    attempt: int = Field(description="2 when it is repeated because it was interrupted")
    number: int
    total: int
    exposure_s: float
    free_exposure: bool = Field(description="the participant ends the exposure; the film goes on until then")
    first_shown: Label
    media: MediaView


class TrialView(OneTrialView):
    """The trial to show, and the one after it, so that the study goes on while the connection is gone."""

    next_media: str | None = Field(description="to fetch meanwhile; null at the last trial")
    following: OneTrialView | None = Field(description="the trial of `next_media`; it may be voted on as well")


class SwitchBody(Strict):
    to: Label | Literal["reference"]
    at_ms: Milliseconds
    media_time_s: Seconds
    frame: Count | None = Field(default=None, description="number of the frame on screen, from 0")


class DwellBody(Strict):
    a: Milliseconds
    b: Milliseconds
    reference: Milliseconds | None = None


class DisplayBody(Strict):
    window_width: Count
    window_height: Count
    device_pixel_ratio: Annotated[float, Field(gt=0, le=100, allow_inf_nan=False)]
    full_screen: bool


class ViewingBody(Strict):
    """How a trial was looked at; what a client does not know it leaves out."""

    first_shown: Label
    shown_ms: Milliseconds
    response_ms: Milliseconds
    switches: Annotated[list[SwitchBody], Field(max_length=MOST_SWITCHES)]
    dwell_ms: DwellBody | None = Field(default=None, description="how long each was on screen")
    n_changes: Count | None = Field(default=None, description="how often the choice was changed before Next")
    n_frames: Count | None = Field(default=None, description="frames that the browser decoded")
    n_dropped: Count | None = Field(default=None, description="of these, not shown")
    n_stalls: Count | None = Field(default=None, description="how often the film waited for data")
    interruption: Reason | None = Field(default=None, description="of a repetition, which is not repeated again")
    display: DisplayBody | None = None


class VoidBody(Strict):
    """An attempt that was interrupted, and what was seen until then."""

    reason: Reason
    viewing: ViewingBody


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


@router.get("/trials/next", response_model=TrialView, responses={204: {"description": "No trial is left"}})
def next_trial(signed_in: Participant, database: Store, now: Now) -> TrialView | Response:
    """The trial to show now; the same one until its vote is in. 409: the trials have not begun."""
    session = signed_in.session
    if session.has_withdrawn:
        raise GoneError("You have withdrawn from the study. Thank you for the time you gave.")
    if session.stage == SCREENED_OUT or is_past(TRIAL, session.stage, session.options.way):
        return Response(status_code=204)
    if session.stage != TRIAL:
        raise ConflictError(f"The trials have not begun: the session is in the stage {session.stage}.")
    with database.reading() as connection:
        upcoming = next_trials(connection, session.id)
        done = done_of(connection, session.id)
    if not upcoming:  # the last vote came in between
        return Response(status_code=204)
    if any(trial.served_at is None for trial in upcoming):
        mark_served(database, [trial.id for trial in upcoming], now)
    views = [_trial_view(session, one, done, ahead) for ahead, one in enumerate(upcoming)]
    following = views[1] if len(views) > 1 else None
    return TrialView(**dict(views[0]), next_media=following.media.url if following else None, following=following)


@router.get("/practice")
def practice(signed_in: Participant, database: Store) -> list[OneTrialView]:
    """What to practise with; none where a study has no practice. What comes of it is told with the stage."""
    session = signed_in.session
    with database.reading() as connection:
        pairs = practice_pairs(connection, session.study_id)
    return [_practice_view(session, one, len(pairs)) for one in pairs]


@router.put(
    "/trials/{trial}/vote", response_model=VoteView, responses={201: {"model": VoteView, "description": "Kept"}}
)
async def vote(
    trial: Annotated[str, Path(max_length=32)],
    body: VoteBody,
    token: ParticipantToken,
    response: Response,
    votes: Votes,
    now: Now,
) -> VoteView:
    """Vote. 201: the vote is on disk; 200: it was already; 409: the trial has another vote; 503: send it again soon."""
    sent = Vote(body.id, body.choice, body.viewing.model_dump(exclude_none=True))
    kept = await asyncio.wrap_future(votes.submit(Ballot(token, trial, sent, now)))
    response.status_code = 201 if kept.is_new else 200
    return VoteView(
        id=kept.vote.client_id,
        trial=trial,
        number=kept.number,
        choice=kept.vote.choice,
        received_at=kept.received_at,
    )


@router.put("/trials/{trial}/void", status_code=204)
def void(
    trial: Annotated[str, Path(max_length=32)], body: VoidBody, signed_in: Participant, database: Store, now: Now
) -> None:
    """Say that a trial was interrupted: it comes once more at the end. 409: it has a vote, or came again already."""
    if signed_in.session.has_withdrawn:
        raise GoneError("You have withdrawn from the study.")
    viewing = body.viewing.model_dump(exclude_none=True)
    if void_trial(database, signed_in.session.id, trial, body.reason, viewing, now):
        log.info("session %s: trial %s interrupted (%s)", signed_in.session.public_id, trial, body.reason)


def _trial_view(session: Session, current: NextTrial, done: Done, ahead: int) -> OneTrialView:
    return OneTrialView(
        trial=current.public_id,
        attempt=current.attempt,
        number=done.n_done + 1 + ahead,
        total=done.n_total,
        exposure_s=session.exposure_s,
        first_shown="a" if current.first_shown == "a" else "b",
        free_exposure=session.options.free_exposure,
        media=_media_view(
            current, "top" if current.a_half == "top" else "bottom", has_reference=bool(session.options.reference)
        ),
    )


def _practice_view(session: Session, pair: PracticePair, total: int) -> OneTrialView:
    """Whether the better one is A or B differs between participants, and no practice is ever repeated as a trial is."""
    turn = (session.id + pair.position) % 2
    return OneTrialView(
        trial=f"practice-{pair.position + 1}",
        attempt=MOST_ATTEMPTS,
        number=pair.position + 1,
        total=total,
        exposure_s=session.exposure_s,
        first_shown="b" if turn else "a",
        free_exposure=session.options.free_exposure,
        media=_media_view(pair, "top" if session.id % 2 else "bottom", has_reference=False),
    )


def _media_view(of: NextTrial | PracticePair, a_half: Half, *, has_reference: bool) -> MediaView:
    return MediaView(
        url=media_url(of.media),
        second=SecondView(url=media_url(of.second_media), type=FILM_TYPES[of.second_codec])
        if of.second_media and of.second_codec
        else None,
        layout="stacked",
        a=a_half,
        width=of.width,
        height=of.height,
        guard_rows=of.guard_rows,
        reference=has_reference,
        fps=of.fps,
        n_frames=of.n_frames,
    )


def media_url(media: str) -> str:
    return f"/media/{media}"
