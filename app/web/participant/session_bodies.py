"""Bodies of requests and answers about a participant's session, and the view of it that they send."""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from app.errors import NoSessionError
from app.store.database.engine import Database, Transaction
from app.store.database.keys import resume_code
from app.store.participants.recruits import recruit_of_session
from app.store.studies.film_failures import is_stuck
from app.store.studies.images import image_digests
from app.store.trials.sessions import Session, done_of, last_answer_at, session_by_token
from app.study.options.duration import stage_minutes
from app.study.options.own_texts import DEBRIEFING, NAME
from app.study.options.recruiting import MOST_KEPT, Ending
from app.study.options.wording import first_language, own_texts
from app.study.protocols import Protocol
from app.study.stages import ALL_STAGES, ENDS, FINISHED, SCREENED_OUT, TIMED_OUT, TRIAL, WITHDRAWN
from app.web.markdown import render_markdown
from ground.fields import Expected

LONG_ABSENCE = timedelta(minutes=30)  # then the page shows the instructions again
ENDING_OF: dict[str, Ending] = {
    FINISHED: "complete",
    SCREENED_OUT: "screened_out",
    TIMED_OUT: "timed_out",
    WITHDRAWN: "withdrawn",
}

UUID = Annotated[
    str,
    Field(pattern=r"^[0-9a-f]{8}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{12}$"),
    Expected("a UUID in lower case"),
]
LinkName = Annotated[str, Field(max_length=40)]
LinkValue = Annotated[str, Field(max_length=100)]
StageName = Annotated[str, Field(json_schema_extra={"enum": [*ALL_STAGES, WITHDRAWN, SCREENED_OUT, TIMED_OUT]})]
Code = Annotated[str, Field(max_length=40, pattern=r"^[A-Za-z0-9_-]+$", examples=["k7m2p9xq4wva"])]


OWN_DATA: dict[str, Any] = {  # how OpenAPI describes what a participant downloads
    "schema": {"type": "object"},
    "example": {
        "study": "Temple",
        "participant": "P001",
        "stage": "finished",
        "votes": [{"choice": "a", "rating": None, "first_shown": "b", "shown_ms": 15000.0, "response_ms": 900.0}],
    },
}


class Strict(BaseModel):
    """A request body: no other keys, no conversion of types."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class AdmissionBody(Strict):
    invitation: Code
    key: UUID | None = Field(
        default=None, description="random, made by the client: the same key again opens the same session"
    )
    outside: dict[LinkName, LinkValue] = Field(
        default={},
        max_length=MOST_KEPT + 1,
        description="parameters of a recruiting platform's link, by name; needed where the study knows people by them: "
        "the same id again opens the same session",
        examples=[{"PROLIFIC_PID": "5f2a9c0de1b7a4001c3d8e90"}],
    )
    language: Annotated[str, Field(max_length=40)] | None = Field(
        default=None, description="of the texts that the participant reads; null: the client has texts of its own"
    )
    texts_sha256: Annotated[str, Field(max_length=64)] | None = Field(
        default=None, description="digest of the texts that the page has shown so far; 412 where they have changed"
    )


class TurnedAwayBody(AdmissionBody):
    why: Literal["films", "cookies", "phone", "screen", "full_screen"] = Field(
        default="films", description="what this browser or device lacks for the study, or that it is a phone"
    )


class Resumption(Strict):
    resume_code: Annotated[str, Field(max_length=40, pattern=r"^[A-Za-z0-9_ -]+$", examples=["k7m2-p9xq-4wva"])]
    key: UUID | None = Field(
        default=None, description="random, made by the client: the same code with it leads to the same session again"
    )


class ErasureBody(Strict):
    confirmed: Literal[True] = Field(description="there is no way back")


class StageData(Strict):
    data: dict[str, Any] = Field(default={}, examples=[{"language": "en"}])


class ComprehensionBody(Strict):
    answer: Annotated[str, Field(max_length=40, examples=["wait"])]


class ComprehensionView(BaseModel):
    understood: bool = Field(description="else the instructions are to be read once more")


class StudyView(BaseModel):
    slug: str
    title: str
    exposure_s: float


class ProgressView(BaseModel):
    done: int
    total: int


class EndingView(BaseModel):
    """Where a participant of a recruiting platform goes at the end."""

    code: str | None = Field(description="completion code, to be shown; null where there is none")
    url: str | None = Field(description="https address to go to; null where there is none")
    after_s: int = Field(description="seconds after which the page goes there by itself; 0: never")


class SessionView(BaseModel):
    """A session's stage and progress."""

    session: str = Field(
        description="its id; a request with it in the header Session-Id is refused (401) where the token is another's"
    )
    study: StudyView
    stage: StageName
    stages: list[StageName]
    progress: ProgressView
    minutes: dict[str, float] = Field(description="about how long each stage takes as a whole, by its name")
    language: str | None = Field(description="of all its texts; null: it was begun by another client than the page")
    was_away_long: bool = Field(description="the trials have begun, and the last answer is long ago")
    resume_code: str = Field(description="lets its participant go on in another browser")
    stopped: bool = Field(
        description="a film has failed in this session as often as it may be tried: `ending` says where to go"
    )
    debriefing: str | None = Field(description="Markdown for the end; null before it, as it may tell what is compared")
    debriefing_html: str | None = Field(description="the same as HTML; raw HTML in it is escaped")
    ending: EndingView | None = Field(description="null before the end, and where the study says nothing of it")


class AskedView(BaseModel):
    """What a study asks besides votes, for clients other than its own page."""

    consent: dict[str, str] | None = Field(description="version and sha256, to be sent with the introduction")
    comprehension: bool = Field(description="whether a right `comprehension` is to be sent with the introduction")
    practice: int = Field(description="how many rounds of practice are to be sent, where the study has a practice")
    protocol: Protocol = Field(
        description="how to judge; in ACR and ACR-HR other answers to the comprehension are right"
    )
    questions: list[dict[str, Any]] = Field(description="of the interview, to be sent as answers by name")


class OpenedSessionView(SessionView):
    token: str | None = Field(description="a bearer token for clients without cookies; null for browsers")


def present_view(database: Database, token: str, now: datetime) -> SessionView:
    """Make the view of a token's session as it is after a change.

    Raises
    ------
    NoSessionError
        If the session went on in another browser, or was erased, since the change.
    """
    with database.reading() as connection:
        session = session_by_token(connection, token)
    if session is None:
        raise NoSessionError
    return session_view(database, session, token, now)


def session_view(database: Database, session: Session, token: str, now: datetime) -> SessionView:
    """Make the view of a session for the holder of its token."""
    with database.reading() as connection:
        done = done_of(connection, session.id)
        answered_at = last_answer_at(connection, session.id)
        has_stopped = session.stage not in ENDS and is_stuck(connection, session.id)
        ending = _ending(connection, session, "failed" if has_stopped else ENDING_OF.get(session.stage))
        images = image_digests(connection, session.study_id) if session.stage == FINISHED else {}
    said = own_texts(session.options, session.language or first_language(session.options))
    debriefing = str(said.get(DEBRIEFING, "")) if session.stage == FINISHED else None
    title = str(said.get(NAME, session.name))
    return SessionView(
        session=session.public_id,
        study=StudyView(slug=session.slug, title=title, exposure_s=session.exposure_s),
        stage=session.stage,
        stages=list(session.options.way),
        progress=ProgressView(done=done.n_done, total=done.n_total),
        minutes=stage_minutes(session.options, done.n_total, session.exposure_s),
        language=session.language,
        was_away_long=session.stage == TRIAL and answered_at is not None and now - answered_at > LONG_ABSENCE,
        resume_code=resume_code(token),
        stopped=has_stopped,
        debriefing=debriefing,
        debriefing_html=None if debriefing is None else str(render_markdown(debriefing, images)),
        ending=ending,
    )


def _ending(connection: Transaction, session: Session, ending: Ending | None) -> EndingView | None:
    """Return where a session's participant goes, with the completion code of who has finished."""
    if ending is None or session.is_preview:
        return None
    options = session.options.outside
    recruit = recruit_of_session(connection, session.id)  # None, too, where the study took no ids when they began
    code = (recruit.completion_code if recruit else "") or options.code if ending == "complete" else ""
    url = options.address(ending, recruit.arrival if recruit else None, code)
    if not code and not url:
        return None
    return EndingView(code=code or None, url=url or None, after_s=options.redirect_after_s)
