"""Who may: each gate returns what a route needs, or raises."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Annotated, Literal

from fastapi import Depends, Request

from app.errors import NoSessionError, NotFoundError, UnauthorisedError
from app.settings import Settings
from app.store.engine import Database
from app.store.experimenters import Experimenter, experimenter_by_token
from app.store.invitations import Invitation, invitation_by_code
from app.store.sessions import Session, session_by_token
from app.store.studies import Study, study_by_id, study_by_slug
from app.store.tokens import READ, scopes_of
from app.store.vote_writer import VoteWriter
from app.study.options import StudyOptions, parse_options

PARTICIPANT_COOKIE = "session"
EXPERIMENTER_COOKIE = "experimenter"


@dataclass(frozen=True)
class Entrance:
    """What stands behind an invitation's address; "mine": this browser's session was begun with it."""

    slug: str
    title: str
    state: Literal["open", "mine", "used", "closed"]
    is_shared: bool  # another participant may begin with it now
    options: StudyOptions


@dataclass(frozen=True)
class SignedIn:
    """A session, and the token that its participant holds."""

    session: Session
    token: str


def database(request: Request) -> Database:
    found: Database = request.app.state.database
    return found


def settings(request: Request) -> Settings:
    found: Settings = request.app.state.settings
    return found


def is_secure(request: Request) -> bool:
    """Whether cookies must keep to https."""
    return settings(request).secure_cookies or request.url.scheme == "https"


def now(request: Request) -> datetime:
    moment: datetime = request.app.state.clock()
    return moment


async def participant_token(request: Request) -> str:
    """What who asks holds, by bearer token or cookie; whether it opens a session is for the store to say."""
    token = _bearer(request) or request.cookies.get(PARTICIPANT_COOKIE)
    if not token:
        raise NoSessionError
    return token


def participant(request: Request, token: Annotated[str, Depends(participant_token)]) -> SignedIn:
    """The session of who asks."""
    with database(request).reading() as connection:
        session = session_by_token(connection, token)
    if session is None:
        raise NoSessionError
    return SignedIn(session, token)


def analyst(request: Request) -> None:
    """A bearer token that may read, or an experimenter's cookie."""
    token = _bearer(request)
    if token is None:
        experimenter(request)
        return
    with database(request).reading() as connection:
        scopes = scopes_of(connection, token)
    if scopes is None or READ not in scopes:
        raise UnauthorisedError("This token is not known here, or may not read results.")


def experimenter(request: Request) -> Experimenter:
    """The experimenter who is signed in by cookie."""
    token = request.cookies.get(EXPERIMENTER_COOKIE)
    with database(request).reading() as connection:
        found = experimenter_by_token(connection, token, now(request)) if token else None
    if found is None:
        raise UnauthorisedError("You are not signed in. Open the sign-in link that `reconstudy admin add NAME` prints.")
    return found


def study_called(request: Request, slug: str) -> Study:
    with database(request).reading() as connection:
        found = study_by_slug(connection, slug)
    if found is None:
        raise NotFoundError("There is no such study.")
    return found


def invitation_to(database: Database, slug: str, code: str) -> Invitation:
    """The invitation with this code, if it is one to this study."""
    with database.reading() as connection:
        invitation = invitation_by_code(connection, code)
        study = study_by_id(connection, invitation.study_id) if invitation else None
    if invitation is None or study is None or study.slug != slug:
        raise NotFoundError("There is no such invitation. Please check the code.")
    return invitation


def entrance(request: Request, code: str) -> Entrance | None:
    """What an invitation's address leads to; None if there is no such invitation. Looking uses nothing up."""
    with database(request).reading() as connection:
        invitation = invitation_by_code(connection, code)
        study = study_by_id(connection, invitation.study_id) if invitation else None
        token = request.cookies.get(PARTICIPANT_COOKIE)
        session = session_by_token(connection, token) if token else None
    if invitation is None or study is None:
        return None
    state: Literal["open", "mine", "used", "closed"] = "used" if invitation.is_used else "open"
    if session is not None and session.invitation_id == invitation.id:
        state = "mine"
    elif study.state == "closed":
        state = "closed"
    is_shared = study.state == "open" and not invitation.is_used
    return Entrance(study.slug, study.name, state, is_shared, parse_options(study.options))


def _bearer(request: Request) -> str | None:
    scheme, _, token = request.headers.get("authorization", "").partition(" ")
    return token.strip() if scheme.lower() == "bearer" and token.strip() else None


async def _database(request: Request) -> Database:  # async, because FastAPI sends a plain function to another thread
    return database(request)


async def _votes(request: Request) -> VoteWriter:
    writer: VoteWriter = request.app.state.votes
    return writer


async def _now(request: Request) -> datetime:
    return now(request)


Store = Annotated[Database, Depends(_database)]
Now = Annotated[datetime, Depends(_now)]
Votes = Annotated[VoteWriter, Depends(_votes)]
ParticipantToken = Annotated[str, Depends(participant_token)]
Participant = Annotated[SignedIn, Depends(participant)]
Person = Annotated[Experimenter, Depends(experimenter)]
AStudy = Annotated[Study, Depends(study_called)]
