"""What a trial's page is told, and what it tells of how the trial was looked at."""

from __future__ import annotations

from typing import Annotated, Literal, NotRequired

from pydantic import AfterValidator, BaseModel, Field, with_config
from typing_extensions import TypedDict

from app.store.designs import STRIPS, PracticePair
from app.store.sessions import Done, Session
from app.store.trials import MOST_ATTEMPTS, NextTrial
from app.study.technique import Technique
from app.study.trial import Half
from app.study.valid_vote import without_unknowns
from app.web.participant.session import UUID, Strict

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
    singles: list[str] | None = Field(
        description="each strip alone, from the top, for browsers that play neither; null where the study has none"
    )
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


@with_config(Strict.model_config)
class SwitchBody(TypedDict):
    to: Label | Literal["reference"]
    at_ms: Milliseconds
    media_time_s: Seconds
    frame: NotRequired[Annotated[Count | None, Field(description="number of the frame on screen, from 0")]]
    frame_ms: NotRequired[Annotated[Milliseconds | None, Field(description="of the animation frame that showed it")]]


@with_config(Strict.model_config)
class DwellBody(TypedDict):
    a: Milliseconds
    b: Milliseconds
    reference: NotRequired[Milliseconds | None]


@with_config(Strict.model_config)
class DisplayBody(TypedDict):
    window_width: Count
    window_height: Count
    device_pixel_ratio: Annotated[float, Field(gt=0, le=100, allow_inf_nan=False)]
    full_screen: bool


@with_config(Strict.model_config)
class ViewingBody(TypedDict):
    """How a trial was looked at; what a client does not know it leaves out."""

    first_shown: Label
    technique: NotRequired[Annotated[Technique | None, Field(description="how A and B were kept in step")]]
    shown_ms: Milliseconds
    response_ms: Milliseconds
    switches: Annotated[list[SwitchBody], Field(max_length=MOST_SWITCHES)]
    wait_ms: NotRequired[
        Annotated[Milliseconds | None, Field(description="from when the participant was ready to the fixation")]
    ]
    dwell_ms: NotRequired[Annotated[DwellBody | None, Field(description="how long each was on screen")]]
    n_changes: NotRequired[Annotated[Count | None, Field(description="how often the choice was changed before Next")]]
    n_frames: NotRequired[Annotated[Count | None, Field(description="frames that the browser decoded")]]
    n_dropped: NotRequired[Annotated[Count | None, Field(description="of these, not shown")]]
    n_mismatches: NotRequired[
        Annotated[Count | None, Field(description="refreshes at which A and B were different frames")]
    ]
    n_stalls: NotRequired[Annotated[Count | None, Field(description="how often the film waited for data")]]
    interruption: NotRequired[
        Annotated[Reason | None, Field(description="of a repetition, which is not repeated again")]
    ]
    display: NotRequired[DisplayBody | None]


Viewing = Annotated[ViewingBody, AfterValidator(without_unknowns)]


class VoidBody(Strict):
    """An attempt that was interrupted, and what was seen until then."""

    reason: Reason
    viewing: Viewing


class TroubleBody(Strict):
    why: Annotated[str, Field(max_length=300, description="what the browser says")]


class VoteBody(Strict):
    id: Annotated[
        str,
        Field(
            pattern=UUID,
            examples=["019aad55-2c00-7f5e-9a51-0c6b7f3d2e18"],
            description="made by the client, the same whenever it sends the vote again; any UUID, best of version 7",
        ),
    ]
    choice: Literal["a", "b", "none"]
    viewing: Viewing


def trial_view(session: Session, current: NextTrial, done: Done, ahead: int) -> OneTrialView:
    """A trial that comes `ahead` trials after the present one."""
    return OneTrialView(
        trial=current.public_id,
        attempt=current.attempt,
        number=done.n_done + 1 + ahead,
        total=done.n_total,
        exposure_s=session.exposure_s,
        first_shown="a" if current.first_shown == "a" else "b",
        free_exposure=session.options.free_exposure,
        media=_media_view(
            current,
            "top" if current.a_half == "top" else "bottom",
            has_reference=bool(session.options.reference),
            singles_of=current.public_id,  # a name of its own in every session: the same stimulus is not known again
        ),
    )


def practice_view(session: Session, pair: PracticePair, total: int) -> OneTrialView:
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
        media=_media_view(pair, "top" if session.id % 2 else "bottom", has_reference=False, singles_of=pair.media),
    )


def _media_view(of: NextTrial | PracticePair, a_half: Half, *, has_reference: bool, singles_of: str) -> MediaView:
    strips = STRIPS if has_reference else STRIPS[:2]
    return MediaView(
        url=media_url(of.media),
        second=SecondView(url=media_url(of.second_media), type=FILM_TYPES[of.second_codec])
        if of.second_media and of.second_codec
        else None,
        singles=[media_url(f"{singles_of}.{strip}") for strip in strips] if of.has_singles else None,
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
