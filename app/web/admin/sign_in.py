"""Sign experimenters in: the set-up link, sign-in links, passwords; and show their account."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated

from fastapi import APIRouter, Depends, Form, Path, Request
from fastapi.responses import RedirectResponse, Response

from app.errors import InvalidError, UnauthorisedError
from app.store.audit import STRANGER, Entry, record, record_alone
from app.store.engine import Database
from app.store.experimenters import (
    begin_experimenter_session,
    experimenter_by_link,
    experimenter_named,
    finish_set_up,
    is_set_up_link,
    password_of,
    set_password,
    sign_out,
)
from app.web.admin.layout import page, see
from app.web.admin.passwords import check_password, hash_password, is_password
from app.web.form_token import entry_token, own_form, remember_entry
from app.web.gates import EXPERIMENTER_COOKIE, Myself, Now, Person, Store, address, is_secure, throttle
from app.web.security import set_experimenter_cookie
from app.web.throttle import SIGN_INS, SIGN_INS_AS

Secret = Annotated[str, Path(max_length=100)]
Name = Annotated[str, Form(min_length=1, max_length=100)]
Password = Annotated[str, Form(max_length=1000)]

router = APIRouter(prefix="/admin", include_in_schema=False)


@router.get("/setup/{secret}")
def set_up_page(secret: Secret, request: Request, database: Store, now: Now) -> Response:
    throttle(request).count(SIGN_INS, address(request))
    with database.reading() as connection:
        is_valid = is_set_up_link(connection, secret, now)
    if not is_valid:
        raise _set_up_refused(database, now)
    context = {"secret": secret, "form_token": entry_token(request)}
    return remember_entry(request, request.app.state.templates.TemplateResponse(request, "admin/set_up.html", context))


@router.post("/setup/{secret}", dependencies=[Depends(own_form)])
def set_up(
    secret: Secret, request: Request, name: Name, password: Password, again: Password, database: Store, now: Now
) -> Response:
    throttle(request).count(SIGN_INS, address(request))
    kept = _new_password(name.strip(), password, again)
    with database.writing() as connection:
        if experimenter_named(connection, name.strip()):
            raise InvalidError("There is somebody of this name already. Please choose another one.")
        experimenter_id = finish_set_up(connection, secret, name.strip(), kept, now)
        token = begin_experimenter_session(connection, experimenter_id, now) if experimenter_id else None
        if token:
            record(connection, name.strip(), Entry("server set up", subject=name.strip()), now)
    if token is None:
        raise _set_up_refused(database, now)
    return _signed_in(request, token)


def _set_up_refused(database: Database, now: datetime) -> UnauthorisedError:
    record_alone(database, STRANGER, Entry("set-up refused", detail={"by": "link"}), now)
    return UnauthorisedError("This set-up link is not valid any more. `reconstudy serve` prints a new one.")


@router.get("/login/{secret}")
def sign_in_by_link(secret: Secret, request: Request, database: Store, now: Now) -> Response:
    throttle(request).check(SIGN_INS, address(request))
    with database.writing() as connection:
        person = experimenter_by_link(connection, secret, now)
        token = begin_experimenter_session(connection, person.id, now) if person else None
        if person:
            record(connection, person.name, Entry("signed in", detail={"by": "link"}), now)
    if token is None:
        throttle(request).count(SIGN_INS, address(request))
        record_alone(database, STRANGER, Entry("sign-in refused", detail={"by": "link"}), now)
        raise UnauthorisedError(
            "This sign-in link is not valid any more. `reconstudy admin add NAME` prints a new one."
        )
    return _signed_in(request, token)


@router.post("/sign-in", dependencies=[Depends(own_form)])
def sign_in(request: Request, name: Name, password: Password, database: Store, now: Now) -> Response:
    throttle(request).count(SIGN_INS, address(request))
    throttle(request).count(SIGN_INS_AS, name.strip().lower())
    with database.reading() as connection:
        known = password_of(connection, name.strip())
    if not is_password(password, known[1] if known else None) or known is None:
        record_alone(database, STRANGER, Entry("sign-in refused", subject=name.strip(), detail={"by": "password"}), now)
        raise UnauthorisedError("Name and password do not belong together. Please try again.")
    with database.writing() as connection:
        token = begin_experimenter_session(connection, known[0], now)
        record(connection, name.strip(), Entry("signed in", detail={"by": "password"}), now)
    return _signed_in(request, token)


@router.post("/logout")
def leave(request: Request, actor: Myself, database: Store) -> Response:
    with database.writing() as connection:
        sign_out(connection, request.cookies[EXPERIMENTER_COOKIE])
        actor.note(connection, "signed out")
    request.state.renewed_token = None
    answer = RedirectResponse("/", status_code=303)
    answer.delete_cookie(EXPERIMENTER_COOKIE, httponly=True, samesite="lax")
    return answer


@router.get("/account")
def account_page(request: Request, person: Person) -> Response:
    return page(request, "account", person, {})


@router.post("/account/password")
def change_password(
    request: Request,
    person: Person,
    actor: Myself,
    password: Password,
    again: Password,
    database: Store,
    current: Password = "",
) -> Response:
    throttle(request).count(SIGN_INS_AS, actor.name.lower())
    with database.reading() as connection:
        known = password_of(connection, actor.name)
    if known and not is_password(current, known[1]):
        raise InvalidError("The current password is not right. Nothing was changed.")
    kept = _new_password(person.name, password, again)
    with database.writing() as connection:
        set_password(connection, actor.id, kept)
        token = begin_experimenter_session(connection, actor.id, actor.now)
        actor.note(connection, "password changed")
    request.state.renewed_token = None
    return _signed_in(request, token, "/admin/account")


def _new_password(name: str, password: str, again: str) -> str:
    if password != again:
        raise InvalidError("The two passwords differ. Please type the same one twice.")
    try:
        check_password(password, name)
    except ValueError as error:
        raise InvalidError(str(error)) from error
    return hash_password(password)


def _signed_in(request: Request, token: str, path: str = "/admin") -> Response:
    answer = see(path)
    set_experimenter_cookie(answer, token, is_https=is_secure(request))
    return answer
