"""Show experimenters their account: the password, a second factor, and the sessions that are open."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Form, Request
from fastapi.responses import Response
from pydantic import StringConstraints

from app.errors import ConflictError, InvalidError, NotFoundError
from app.store.access.experimenters import (
    begin_experimenter_session,
    end_all_sessions,
    end_other_sessions,
    end_session,
    open_session,
    password_of,
    sessions_of,
    set_password,
)
from app.store.access.second_factors import (
    confirm_second_factor,
    end_second_factor,
    n_recovery_codes,
    prepare_second_factor,
    second_factor_of,
)
from app.store.database.engine import Database
from app.store.studies.audit import Actor
from app.web.admin.access.passwords import is_password, new_password_hash
from app.web.admin.access.second_factor import is_code, new_totp_secret, totp_picture
from app.web.admin.layout import page, see
from app.web.gates import Now, Store, address, browser_of, database, delete_cookie, now, throttle
from app.web.limits.throttle import SIGN_INS_AS
from app.web.roles import EXPERIMENTER_COOKIE, Myself, Person, lacks_second_factor, set_experimenter_cookie

Name = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=100), Form()]
Password = Annotated[str, Form(max_length=1000)]
Code = Annotated[str, Form(max_length=40)]

router = APIRouter(prefix="/admin/account", include_in_schema=False)


@router.get("")
def account_page(request: Request, person: Person, database: Store, now: Now) -> Response:
    with database.reading() as connection:
        sessions = sessions_of(connection, person.id, now)
        factor = second_factor_of(connection, person.id)
        n_codes = n_recovery_codes(connection, person.id)
    is_being_set_up = factor is not None and factor.since is None
    context = {
        "is_saved": "saved" in request.query_params,
        "sessions": sessions,
        "factor": factor,
        "n_codes": n_codes,
        "is_lacking": lacks_second_factor(request, person),
        "picture": totp_picture(factor.secret, person.name) if factor and is_being_set_up else None,
    }
    return page(request, "account", person, context)


@router.post("/password")
def change_password(
    request: Request,
    actor: Myself,
    password: Password,
    again: Password,
    database: Store,
    current: Password = "",
    name: Annotated[str, Form(max_length=100)] = "",  # noqa: ARG001 (password managers look for it)
) -> Response:
    _check_current(request, database, actor, current)
    kept = new_password_hash(actor.name, password, again)
    with database.writing() as connection:
        set_password(connection, actor.id, kept)
        token = begin_experimenter_session(connection, actor.id, actor.now, browser_of(request))
        actor.note(connection, "password changed")
    request.state.renewed_token = None
    return signed_in(request, token, "/admin/account?saved=1")


@router.post("/second-factor")
def set_up_second_factor(actor: Myself, person: Person, database: Store) -> Response:
    """Make the secret of a second factor; it is asked for once a code has confirmed it."""
    if not person.has_password:
        raise ConflictError("Choose a password first: the second factor is asked for beside it.")
    with database.writing() as connection:
        prepare_second_factor(connection, actor.id, new_totp_secret())
    return see("/admin/account#second-factor")


@router.post("/second-factor/confirm")
def turn_on_second_factor(
    request: Request, actor: Myself, person: Person, database: Store, code: Code, current: Password = ""
) -> Response:
    """Ask for the second factor from now on, which takes the password; show the recovery codes, once."""
    _check_current(request, database, actor, current)
    with database.writing() as connection:
        factor = second_factor_of(connection, actor.id)
        if factor is None or factor.since is not None:
            raise ConflictError("No second factor is being set up. Look at your account again.")
        if not is_code(connection, actor.id, factor.secret, code, actor.now):
            raise InvalidError("This is not the code of now. Check the clock of your telephone, and type the next one.")
        codes = confirm_second_factor(connection, actor.id, actor.now)
        end_other_sessions(connection, actor.id, request.state.form_token)
        actor.note(connection, "second factor turned on")
    return page(request, "recovery_codes", person, {"codes": codes})


@router.post("/second-factor/end")
def turn_off_second_factor(request: Request, actor: Myself, database: Store, current: Password = "") -> Response:
    """Turn the second factor off, which takes the password; or give up setting it up."""
    with database.reading() as connection:
        factor = second_factor_of(connection, actor.id)
    if factor is not None and factor.since is not None:
        _check_current(request, database, actor, current)
    with database.writing() as connection:
        end_second_factor(connection, actor.id)
        end_other_sessions(connection, actor.id, request.state.form_token)
        actor.note(connection, "second factor turned off")
    return see("/admin/account#second-factor")


@router.post("/sessions/end")
def end_one_session(
    request: Request,
    actor: Myself,
    database: Store,
    session: Annotated[int, Form(ge=1, le=2**31 - 1)],
    current: Password = "",
) -> Response:
    _check_current(request, database, actor, current)
    with database.writing() as connection:
        if not end_session(connection, actor.id, session):
            raise NotFoundError("This session has ended already.")
        actor.note(connection, "session ended")
    return see("/admin/account#sessions")


@router.post("/sessions/end-all")
def sign_out_everywhere(request: Request, actor: Myself, database: Store, current: Password = "") -> Response:
    """End all sessions of the person, this one too."""
    _check_current(request, database, actor, current)
    with database.writing() as connection:
        n_ended = end_all_sessions(connection, actor.id)
        actor.note(connection, "signed out everywhere", sessions=n_ended)
    return signed_out(request)


def signed_in(request: Request, token: str, path: str = "/admin") -> Response:
    """Lead to a page, with the cookie of a session; to the account where only that is open without a second factor."""
    session = open_session(database(request), token, now(request), may_renew=False)
    is_lacking = session is not None and lacks_second_factor(request, session.experimenter)
    answer = see("/admin/account#second-factor" if is_lacking else path)
    set_experimenter_cookie(request, answer, token)
    return answer


def signed_out(request: Request) -> Response:
    """Lead to the sign-in, without the cookie of a session."""
    request.state.renewed_token = None
    answer = see("/admin/sign-in")
    delete_cookie(request, answer, EXPERIMENTER_COOKIE)
    return answer


def _check_current(request: Request, database: Database, actor: Actor, password: str) -> None:
    """Refuse who does not know the account's password; an account without one has nothing to know."""
    throttle(request).count(SIGN_INS_AS, address(request), actor.name.lower())
    with database.reading() as connection:
        known = password_of(connection, actor.name)
    if known and not is_password(password, known[1]):
        raise InvalidError("The current password is not right. Nothing was changed.")
    throttle(request).forget(SIGN_INS_AS, address(request), actor.name.lower())
