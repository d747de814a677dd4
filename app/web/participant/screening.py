"""The screening over REST: the server draws pictures and marks answers, and never tells what is right."""

from __future__ import annotations

import logging
import math
from dataclasses import asdict
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Path, Response
from pydantic import BaseModel, Field

from app.errors import ConflictError, InvalidError, NotFoundError
from app.store.database.engine import Database
from app.store.participants.screening import (
    Display,
    ServedItem,
    answer_item,
    display_of,
    end_test,
    item_of,
    item_to_show,
    keep_display,
    keep_distance,
    states_of,
)
from app.store.trials.sessions import Session
from app.study.options.options import StudyOptions
from app.study.screening.acuity import certifying_distance_mm, smallest_size
from app.study.screening.colour_vision import DIRECTIONS, NOTHING
from app.study.screening.pictures import png
from app.study.screening.screening import FARTHEST_CM, NEAREST_CM, TestName, draw, is_possible
from app.study.screening.viewing_distance import (
    N_BLIND_SPOTS,
    N_CARDS,
    ImplausibleError,
    blind_spot_distance_mm,
    checked_distance_mm,
    pixel_mm,
)
from app.study.stages import SCREENING
from app.web.gates import Now, Participant, SignedIn, Store
from app.web.participant.session_bodies import Strict

log = logging.getLogger(__name__)
router = APIRouter(prefix="/api/v1/session/screening", tags=["participants"])

Pixels = Annotated[float, Field(gt=0, le=100_000, allow_inf_nan=False)]
Number = Annotated[int, Path(ge=1, le=1000)]


class CardBody(Strict):
    """A bank card as it was fitted to the display."""

    card_widths: Annotated[list[Pixels], Field(min_length=N_CARDS, max_length=N_CARDS, description="CSS pixels")]
    device_pixel_ratio: Annotated[float, Field(gt=0, le=100, allow_inf_nan=False)]
    window_height: Annotated[int, Field(ge=1, le=100_000, description="CSS pixels")]


class DistanceBody(Strict):
    """How far the eyes are: typed, or by where a dot vanished in the blind spot."""

    typed_cm: Annotated[float, Field(gt=0, le=10_000, allow_inf_nan=False)] | None = None
    blind_spots: Annotated[list[Pixels], Field(max_length=N_BLIND_SPOTS, description="CSS pixels")] | None = None
    device_pixel_ratio: Annotated[float, Field(gt=0, le=100, allow_inf_nan=False)] = 1.0


class AnswerBody(Strict):
    answer: Annotated[int, Field(ge=0, le=7)] | None = Field(
        description="direction from 0 (right) anticlockwise by 45 degrees; null: no ring is seen"
    )
    response_ms: Annotated[float, Field(ge=0, le=86_400_000, allow_inf_nan=False)]


class SkipBody(Strict):
    reason: Annotated[str, Field(max_length=200)] = ""


class TestView(BaseModel):
    test: TestName
    has_begun: bool = Field(description="a picture was served, or it was left out; acuity: the display is settled")
    is_over: bool
    n_answered: int


class CertificateView(BaseModel):
    """Whether the acuity test can reach its limit on this display at this distance."""

    can_certify: bool = Field(description="whether the ring at the limit is at least two of the display's pixels wide")
    distance_cm: float
    needed_distance_cm: int = Field(description="from which it could")


class ScreeningView(BaseModel):
    """How far the screening is; only experimenters see results."""

    tests: list[TestView]
    distance: Literal["typed", "fixed", "blind spot"] = Field(description="how the distance is to be known")
    fixed_distance_cm: float | None
    pixel_mm: float | None = Field(description="of the display, once it was measured")
    certificate: CertificateView | None = Field(description="of the acuity test, once the distance is known")
    seat_cm: float | None = Field(description="the first distance measured: from where the films are to be seen")


class ItemView(BaseModel):
    """A ring or a plate to show."""

    test: str
    number: int
    total: int
    picture: str
    size: float | None = Field(description="of a ring, logMAR")
    choices: list[int] = Field(description="directions that may be answered")
    may_be_nothing: bool = Field(description="whether there may be no ring to see")


Test = Annotated[TestName, Path()]
OVER: dict[int | str, dict[str, Any]] = {204: {"description": "The test is over"}}


@router.get("")
def screening(signed_in: Participant, database: Store) -> ScreeningView:
    """Show how far the screening is."""
    return _view(database, _in_screening(signed_in))


@router.put("/display")
def measure_display(body: CardBody, signed_in: Participant, database: Store, now: Now) -> ScreeningView:
    """Take the display's size by a bank card, fitted twice. 422: the two differ; 409: the acuity test has begun."""
    session = _in_screening(signed_in)
    try:
        pitch = pixel_mm(body.card_widths, body.device_pixel_ratio)
    except ImplausibleError as error:
        raise InvalidError(f"This cannot be: {error}. Please measure again.") from error
    height_px = round(body.window_height * body.device_pixel_ratio)
    keep_display(database, session.id, pitch, height_px, body.model_dump(), now)
    if (distance_cm := _known_distance_cm(session.options)) is not None:
        keep_distance(database, session.id, 10 * distance_cm, "fixed", {})
    return _view(database, session)


@router.put("/distance")
def measure_distance(body: DistanceBody, signed_in: Participant, database: Store) -> ScreeningView:
    """Take the distance of the eyes. 422: it cannot be; 409: the display is not measured, or the test has begun."""
    session = _in_screening(signed_in)
    with database.reading() as connection:
        display = display_of(connection, session.id)
    if display is None:
        raise ConflictError("The display has not been measured yet.")
    try:
        distance_mm, source = _distance(body, display)
    except ImplausibleError as error:
        raise InvalidError(f"This cannot be: {error}. Please measure again.") from error
    keep_distance(database, session.id, distance_mm, source, body.model_dump(exclude_none=True))
    return _view(database, session)


@router.get("/{test}", response_model=ItemView, responses=OVER)
def next_item(test: Test, signed_in: Participant, database: Store, now: Now) -> ItemView | Response:
    """Send the ring or plate to show now; the same one until it is answered. 204: the test is over."""
    session = _in_screening(signed_in)
    _refuse_other_tests(session, test)
    return _item_view(test, item_to_show(database, session.id, test, session.options.screening, now))


@router.put("/{test}/skip", status_code=204)
def skip(test: Test, body: SkipBody, signed_in: Participant, database: Store, now: Now) -> None:
    """Leave a test out, for a reason that is recorded; one that is over stays as it is."""
    session = _in_screening(signed_in)
    _refuse_other_tests(session, test)
    end_test(database, session.id, test, body.reason or "skipped", now)
    log.info("session %s: %s test skipped (%s)", session.public_id, test, body.reason)


@router.get("/{test}/{number}.png", response_class=Response)
def picture(test: Test, number: Number, signed_in: Participant, database: Store) -> Response:
    """Draw a ring or plate; it is never cached, as the next participant at this browser gets another one.

    Show a ring pixel by pixel: one of the picture is one of the display.
    """
    with database.reading() as connection:
        served = item_of(connection, signed_in.session.id, test, number)
    return Response(png(draw(test, served.setup, served.content)), media_type="image/png")


@router.put("/{test}/{number}", response_model=ItemView, responses=OVER)
def answer(
    test: Test, number: Number, body: AnswerBody, signed_in: Participant, database: Store, now: Now
) -> ItemView | Response:
    """Answer, and learn what comes next; the same answer may be sent again. 409: it has another one."""
    session = _in_screening(signed_in)
    given = NOTHING if body.answer is None else body.answer
    if not is_possible(test, given):
        raise InvalidError(f"The answer {body.answer} is none that the {test} test offers.")
    return _item_view(test, answer_item(database, session.id, test, number, given, body.response_ms, now))


def _in_screening(signed_in: SignedIn) -> Session:
    session = signed_in.session
    if SCREENING not in session.options.way:
        raise NotFoundError("This study has no screening.")
    if session.stage != SCREENING:
        raise ConflictError(f"The session is in the stage {session.stage}, not in the screening.")
    return session


def _refuse_other_tests(session: Session, test: TestName) -> None:
    if test not in session.options.screening.tests:
        raise NotFoundError("This study has no such test.")


def _distance(body: DistanceBody, display: Display) -> tuple[float, str]:
    if (body.typed_cm is None) == (body.blind_spots is None):
        raise ImplausibleError("expected either a typed distance or blind spots")
    if body.typed_cm is not None:
        return checked_distance_mm(10 * body.typed_cm), "typed"
    css_mm = display.pixel_mm * body.device_pixel_ratio
    return blind_spot_distance_mm([css_mm * offset for offset in body.blind_spots or ()]), "blind spot"


def _known_distance_cm(options: StudyOptions) -> float | None:
    """Return the distance that no participant is asked for: the option, else what the lab sheet says of the room."""
    if options.screening.distance != "typed":
        return options.screening.distance_cm
    noted = options.lab_sheet.distance_cm
    return noted if noted is not None and NEAREST_CM <= noted <= FARTHEST_CM else None


def _view(database: Database, session: Session) -> ScreeningView:
    options = session.options.screening
    known_cm = _known_distance_cm(session.options)
    with database.reading() as connection:
        states = states_of(connection, session.id, options)
        display = display_of(connection, session.id)
    return ScreeningView(
        tests=[TestView(**asdict(state)) for state in states],
        distance=options.distance if known_cm is None else "fixed",
        fixed_distance_cm=known_cm,
        pixel_mm=display.pixel_mm if display else None,
        certificate=_certificate(display, options.acuity_limit) if display else None,
        seat_cm=round(display.seat_mm / 10, 1) if display and display.seat_mm is not None else None,
    )


def _certificate(display: Display, limit: float) -> CertificateView | None:
    if display.distance_mm is None:
        return None
    return CertificateView(
        can_certify=smallest_size(display.pixel_mm, display.distance_mm) <= limit,
        distance_cm=round(display.distance_mm / 10, 1),
        needed_distance_cm=math.ceil(certifying_distance_mm(display.pixel_mm, limit) / 10),
    )


def _item_view(test: TestName, served: ServedItem | None) -> ItemView | Response:
    if served is None:
        return Response(status_code=204)
    is_ring = test == "acuity"
    return ItemView(
        test=test,
        number=served.number,
        total=served.total,
        picture=f"/api/v1/session/screening/{test}/{served.number}.png",
        size=served.content["size"] if is_ring else None,
        choices=list(range(8)) if is_ring else list(DIRECTIONS),
        may_be_nothing=not is_ring,
    )
