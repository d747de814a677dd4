"""Bodies of trials: the trial that a page is given, and the viewing record and vote that it sends back."""

from __future__ import annotations

from typing import Annotated, Any, Literal, NotRequired

from pydantic import AfterValidator, BaseModel, Field, with_config
from typing_extensions import TypedDict

from app.films.strips import LIGHTER, MEDIA_TYPES
from app.store.trials.designs import SECOND_FILM, STRIPS, PairFilm, PracticePair
from app.store.trials.sessions import Done, Session
from app.store.trials.trials import MOST_ATTEMPTS, NextTrial
from app.study.options.options import FullScreen, Pixels, StudyOptions
from app.study.protocols import CCR, Protocol
from app.study.trial.smoothness import allowed_gap_ms
from app.study.trial.technique import Technique
from app.study.trial.trial import Disturbance, Half, Interruption, Label
from app.study.trial.valid_vote import without_unknowns
from app.web.participant.session_bodies import UUID, Strict

LONGEST_MS = 24 * 3600 * 1000.0  # a day: a trial that was left open overnight still counts
MOST_SWITCHES = 2000
MOST_HAPPENINGS = 500

Milliseconds = Annotated[float, Field(ge=0, le=LONGEST_MS, allow_inf_nan=False)]
Seconds = Annotated[float, Field(ge=0, le=LONGEST_MS / 1000, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=0, le=10_000_000)]
Happening = Literal["hidden", "visible", "full screen left", "full screen", "blur", "focus", "resize", "shown again"]


class SecondView(BaseModel):
    """The same film in another codec."""

    url: str
    type: str = Field(description="MIME type with the codec, to ask the browser about")


class MediaView(BaseModel):
    url: str = Field(description="H.264")
    second: SecondView | None = Field(description="for browsers that do not play H.264, where the study has it")
    lighter: str | None = Field(description="with fewer bytes, for slow lines; null where the study has none")
    singles: list[str] | None = Field(
        description="each strip alone, from the top, for browsers that play neither; null where the study has none"
    )
    layout: Literal["stacked", "single"] = Field(
        description="stacked: A and B in one film, one above the other; single: one stimulus, called A"
    )
    a: Literal["top", "bottom"]
    width: int = Field(description="of one half, pixels")
    height: int = Field(description="of one half, pixels")
    guard_rows: int = Field(description="rows between the halves that belong to neither")
    reference: bool = Field(description="whether the reference lies below both, after as many guard rows")
    fps: float
    n_frames: int
    pixels: Pixels = Field(description="fit: as large as the window allows; 1:1: a pixel of the film is the display's")


class GradesView(BaseModel):
    """The scale to rate on, in whole numbers."""

    low: int = Field(description="the worst; in CCR: B is much worse than A")
    high: int = Field(description="the best; in CCR: B is much better than A")


class OneTrialView(BaseModel):
    """A trial for the participant's player, without names of what is compared."""

    trial: str
    attempt: int = Field(description="from 2 when it is repeated because it was interrupted")
    number: int = Field(description="from 1, as it is shown: one more than there are votes")
    place: int = Field(description="its own number, from 1, which it keeps when it comes again")
    total: int
    is_practice: bool = Field(description="whether it is for practice only")
    exposure_s: float
    free_exposure: bool = Field(description="the participant ends the exposure; the film goes on until then")
    see_both: bool = Field(description="the vote waits until both A and B were on screen")
    minimum_viewing_s: float = Field(
        description="the vote waits until A and B were each on screen as long; 0: no limit"
    )
    protocol: Protocol = Field(description="how to judge; in DCR A is the reference and B is rated")
    grades: GradesView | None = Field(description="null in PC, where the vote is a choice and not a rating")
    longest_gap_ms: float = Field(description="between two frames; after a longer one the look is void: suspended")
    void_on: list[Disturbance] = Field(description="what interrupts a look; whatever else happens is recorded only")
    full_screen: FullScreen = Field(description="required: the film is shown in full screen only")
    minimum_window: list[int] = Field(description="width and height of the smallest window, CSS pixels; empty: any")
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
    frame_ms: NotRequired[Annotated[Milliseconds | None, Field(description="of the animation frame that drew it")]]
    presented_ms: NotRequired[
        Annotated[Milliseconds | None, Field(description="when that frame went to the display: the refresh after it")]
    ]


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
class SmoothnessBody(TypedDict):
    longest_gap_ms: Annotated[Milliseconds, Field(description="between two frames on the display, or until the end")]
    n_presented: NotRequired[Annotated[Count | None, Field(description="frames that the display got")]]
    n_refreshes: NotRequired[Annotated[Count | None, Field(description="of the display, as far as the page was told")]]


@with_config(Strict.model_config)
class HappeningBody(TypedDict):
    what: Happening
    at_ms: Annotated[
        float,
        Field(ge=-LONGEST_MS, le=LONGEST_MS, allow_inf_nan=False, description="negative before the first frame shown"),
    ]


@with_config(Strict.model_config)
class ViewingBody(TypedDict):
    """How a trial was looked at; a client leaves out what it does not know."""

    first_shown: Label
    technique: NotRequired[Annotated[Technique | None, Field(description="how A and B were kept in step")]]
    lighter_film: NotRequired[Annotated[bool | None, Field(description="was the film shown that is for slow lines?")]]
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
    smoothness: NotRequired[Annotated[SmoothnessBody | None, Field(description="how the film ran on the display")]]
    n_stalls: NotRequired[Annotated[Count | None, Field(description="how often the film waited for data")]]
    happened: NotRequired[
        Annotated[
            list[HappeningBody] | None,
            Field(max_length=MOST_HAPPENINGS, description="to the page, from loading to Next"),
        ]
    ]
    interruption: NotRequired[
        Annotated[Interruption | None, Field(description="of a repetition, which is not repeated again")]
    ]
    display: NotRequired[DisplayBody | None]


Viewing = Annotated[ViewingBody, AfterValidator(without_unknowns)]


class VoidBody(Strict):
    """An interrupted attempt with its viewing record so far."""

    reason: Interruption
    viewing: Viewing


class TroubleBody(Strict):
    why: Annotated[str, Field(max_length=300, description="what the browser says")]


class VoteBody(Strict):
    id: Annotated[
        UUID,
        Field(
            examples=["019aad55-2c00-7f5e-9a51-0c6b7f3d2e18"],
            description="made by the client, the same whenever it sends the vote again; any UUID, best of version 7",
        ),
    ]
    choice: Literal["a", "b", "none"] | None = Field(default=None, description="in PC")
    rating: Annotated[int, Field(ge=-100, le=100)] | None = Field(default=None, description="in all other protocols")
    viewing: Viewing


def trial_view(session: Session, current: NextTrial, done: Done, ahead: int) -> OneTrialView:
    """Make the view of a trial that comes `ahead` trials after the present one."""
    return OneTrialView(
        trial=current.public_id,
        attempt=current.attempt,
        number=done.n_done + 1 + ahead,
        place=current.position + 1,
        total=done.n_total,
        is_practice=False,
        first_shown="a" if current.first_shown == "a" else "b",
        see_both=session.options.see_both and not session.options.is_shown_alone,
        minimum_viewing_s=0.0 if session.options.is_shown_alone else session.options.minimum_viewing_s,
        longest_gap_ms=allowed_gap_ms(current.fps),
        media=trial_media(session, current),
        **_same_in_every_trial(session),
    )


def trial_media(session: Session, current: NextTrial) -> MediaView:
    """Make the view of what a trial shows."""
    return _media_view(
        session.options,
        current,
        "top" if current.a_half == "top" else "bottom",
        has_reference=bool(session.options.reference_beside),
        name=current.public_id,  # of this trial alone, so that neither a pair nor a stimulus is recognised
    )


def practice_view(session: Session, pair: PracticePair, total: int) -> OneTrialView:
    """Make the view of a practice trial, never repeated; sessions differ in which film is A, and which comes first."""
    options = session.options
    is_turned = options.grades is None or options.protocol == CCR
    turn = (session.id // 2 + pair.position) % 2 if is_turned else 0
    a_half: Half = "top" if session.id % 2 or not is_turned else "bottom"
    return OneTrialView(
        trial=f"practice-{pair.position + 1}",
        attempt=MOST_ATTEMPTS,
        number=pair.position + 1,
        place=pair.position + 1,
        total=total,
        is_practice=True,
        first_shown="b" if turn else "a",
        see_both=False,  # the page shows a pair of the practice again by itself
        minimum_viewing_s=0.0,
        longest_gap_ms=allowed_gap_ms(pair.fps),
        media=_media_view(options, pair, a_half, has_reference=False, name=pair.media),
        **_same_in_every_trial(session),
    )


def _same_in_every_trial(session: Session) -> dict[str, Any]:
    options = session.options
    return {
        "exposure_s": session.exposure_s,
        "free_exposure": options.free_exposure,
        "protocol": options.protocol,
        "grades": GradesView(low=options.grades.low, high=options.grades.high) if options.grades else None,
        "void_on": list(options.disturbances),
        "full_screen": options.full_screen,
        "minimum_window": list(options.minimum_window),
    }


def _media_view(options: StudyOptions, shown: PairFilm, a_half: Half, *, has_reference: bool, name: str) -> MediaView:
    strips = STRIPS if has_reference else STRIPS[:1] if options.is_shown_alone else STRIPS[:2]
    return MediaView(
        url=media_url(name),
        second=SecondView(url=media_url(f"{name}.{SECOND_FILM}"), type=MEDIA_TYPES[shown.second_codec])
        if shown.second_codec
        else None,
        lighter=media_url(f"{name}.{LIGHTER}") if shown.has_lighter else None,
        singles=[media_url(f"{name}.{strip}") for strip in strips] if shown.has_singles else None,
        layout="single" if options.is_shown_alone else "stacked",
        a=a_half,
        width=shown.width,
        height=shown.height,
        guard_rows=shown.guard_rows,
        reference=has_reference,
        fps=shown.fps,
        n_frames=shown.n_frames,
        pixels=options.pixels,
    )


def media_url(media: str) -> str:
    return f"/media/{media}"
