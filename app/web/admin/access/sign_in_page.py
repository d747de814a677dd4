"""Sign experimenters in and out: the set-up link, sign-in links, passwords with a second factor."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated

from fastapi import APIRouter, Depends, Form, Path, Request
from fastapi.responses import Response

from app.errors import InvalidError, UnauthorisedError
from app.store.access.experimenters import (
    begin_experimenter_session,
    experimenter_by_link,
    experimenter_named,
    finish_set_up,
    has_anybody,
    is_set_up_link,
    password_of,
    sign_out,
    spend_link,
)
from app.store.database.engine import Database
from app.store.studies.audit import STRANGER, Entry, record, record_alone
from app.web.admin.access.account_page import Name, Password, signed_in, signed_out
from app.web.admin.access.passwords import is_password, new_password_hash
from app.web.admin.access.second_factor import is_let_in
from app.web.admin.layout import see
from app.web.form_token import own_form, page_with_form
from app.web.gates import Now, Store, address, browser_of, cookie, throttle
from app.web.limits.throttle import SECOND_FACTORS, SIGN_INS, SIGN_INS_AS
from app.web.roles import EXPERIMENTER_COOKIE, Myself, signed_in_person

Secret = Annotated[str, Path(max_length=100)]
Code = Annotated[str, Form(max_length=40)]  # of an authenticator app, or to recover

router = APIRouter(prefix="/admin", include_in_schema=False)


@router.get("/setup/{secret}")
def set_up_page(secret: Secret, request: Request, database: Store, now: Now) -> Response:
    throttle(request).count(SIGN_INS, address(request))
    _check_set_up_link(database, secret, now)
    return page_with_form(request, "admin/set_up.html", {"secret": secret})


@router.post("/setup/{secret}", dependencies=[Depends(own_form)])
def set_up(
    secret: Secret, request: Request, name: Name, password: Password, again: Password, database: Store, now: Now
) -> Response:
    throttle(request).count(SIGN_INS, address(request))
    _check_set_up_link(database, secret, now)  # first: who has no link learns nothing of names
    kept = new_password_hash(name, password, again)
    with database.writing() as connection:
        if experimenter_named(connection, name):
            raise InvalidError("There is somebody of this name already. Please choose another one.")
        experimenter_id = finish_set_up(connection, secret, name, kept, now)
        if experimenter_id is None:
            raise UnauthorisedError("This set-up link was used meanwhile.")
        token = begin_experimenter_session(connection, experimenter_id, now, browser_of(request))
        record(connection, name, Entry("server set up", subject=name), now)
    return signed_in(request, token)


def _check_set_up_link(database: Database, secret: str, now: datetime) -> None:
    with database.reading() as connection:
        is_valid = is_set_up_link(connection, secret, now)
    if not is_valid:
        record_alone(database, STRANGER, Entry("set-up refused", detail={"by": "link"}), now)
        raise UnauthorisedError(
            "This set-up link is not valid any more. The server prints a new one when it starts and has nobody."
        )


@router.get("/login/{secret}")
def link_page(secret: Secret, request: Request, database: Store, now: Now) -> Response:
    """Ask whether to use a sign-in link: programs that follow links in messages, to look at them, do not use it up.

    Who is signed in and opens a link that was used, for example as a bookmark, gets the dashboard.
    """
    throttle(request).check(SIGN_INS, address(request))
    with database.reading() as connection:
        person = experimenter_by_link(connection, secret, now)
    if person is None and signed_in_person(request) is not None:
        return see("/admin")
    if person is None:
        raise _link_refused(request, database, now)
    return page_with_form(request, "admin/sign_in_by_link.html", {"secret": secret, "person": person})


@router.post("/login/{secret}", dependencies=[Depends(own_form)])
def sign_in_by_link(secret: Secret, request: Request, database: Store, now: Now, code: Code = "") -> Response:
    throttle(request).check(SIGN_INS, address(request))
    _check_code_beside_link(secret, request, database, now, code)
    with database.writing() as connection:
        person = spend_link(connection, secret, now)
        token = begin_experimenter_session(connection, person.id, now, browser_of(request)) if person else None
        if person:
            record(connection, person.name, Entry("signed in", detail={"by": "link"}), now)
    if token is None:
        raise _link_refused(request, database, now)
    return signed_in(request, token)


def _check_code_beside_link(secret: str, request: Request, database: Database, now: datetime, code: str) -> None:
    """Refuse who has the link of a person alone, where that person has a second factor; the link stays."""
    with database.reading() as connection:
        person = experimenter_by_link(connection, secret, now)
    if person is None or not person.has_second_factor:
        return
    throttle(request).count(SECOND_FACTORS, str(person.id))
    with database.writing() as connection:
        is_right = is_let_in(connection, person.id, code, now)
    if not is_right:
        record_alone(
            database, STRANGER, Entry("second factor refused", subject=person.name, detail={"by": "link"}), now
        )
        raise UnauthorisedError(
            "The code of the authenticator app is missing, wrong or was used before. Open the link again and type the "
            "next one, or a recovery code; who has lost both asks an owner."
        )
    throttle(request).forget(SECOND_FACTORS, str(person.id))


def _link_refused(request: Request, database: Database, now: datetime) -> UnauthorisedError:
    throttle(request).count(SIGN_INS, address(request))
    record_alone(database, STRANGER, Entry("sign-in refused", detail={"by": "link"}), now)
    return UnauthorisedError(
        "This sign-in link is not valid any more: a link works once, for a day. An owner makes a new one under People, "
        "or whoever runs the server."
    )


@router.get("/sign-in")
def sign_in_page(request: Request, store: Store, to: str = "/admin") -> Response:
    if signed_in_person(request) is not None:  # in another window, since this page was opened
        return see(_of_dashboard(to))
    context = {"detail": "", "typed": (), "asked": to, "is_new": not has_anybody(store)}
    return page_with_form(request, "admin/sign_in.html", context)


@router.post("/sign-in", dependencies=[Depends(own_form)])
def sign_in(
    request: Request,
    name: Name,
    password: Password,
    database: Store,
    now: Now,
    code: Code = "",
    to: str = "/admin",
) -> Response:
    """Sign in with a password, and lead to the page of the dashboard that was asked for."""
    throttle(request).count(SIGN_INS, address(request))
    throttle(request).count(SIGN_INS_AS, address(request), name.lower())  # a stranger locks out nobody else
    with database.reading() as connection:
        known = password_of(connection, name)
    token, refused = None, "sign-in refused"
    if is_password(password, known[1] if known else None) and known is not None:
        throttle(request).count(SECOND_FACTORS, str(known[0]))
        refused = "second factor refused"
        with database.writing() as connection:
            if is_let_in(connection, known[0], code, now):
                token = begin_experimenter_session(connection, known[0], now, browser_of(request))
                record(connection, name, Entry("signed in", detail={"by": "password"}), now)
    if token is None or known is None:
        # a name that nobody has may be a password, typed into the wrong field
        entry = Entry(refused, subject=name if known else "", detail={"by": "password", "known": known is not None})
        record_alone(database, STRANGER, entry, now)
        raise UnauthorisedError(
            "Name and password do not belong together, or the code of the authenticator app is missing or was used "
            "before. Please try again."
        )
    throttle(request).forget(SECOND_FACTORS, str(known[0]))
    return signed_in(request, token, _of_dashboard(to))


def _of_dashboard(address: str) -> str:
    """Return the address of a page of the dashboard, or else its first: a link never leads elsewhere from here."""
    return address if address.startswith("/admin/") else "/admin"


@router.post("/logout")
def leave(request: Request, actor: Myself, database: Store) -> Response:
    with database.writing() as connection:
        sign_out(connection, cookie(request, EXPERIMENTER_COOKIE) or "")
        actor.note(connection, "signed out")
    return signed_out(request)
