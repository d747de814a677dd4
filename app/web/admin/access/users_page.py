"""Manage who may use the dashboard, the tokens of analysts, and the audit log."""

from __future__ import annotations

from datetime import timedelta
from typing import Annotated

from fastapi import APIRouter, Form, Query, Request
from fastapi.responses import Response

from app.errors import ConflictError, InvalidError, NotFoundError
from app.store.access.experimenters import (
    ALL_STUDIES,
    Experimenter,
    all_experimenters,
    disable,
    end_all_sessions,
    experimenter_named,
    renew_link,
    restrict,
    set_role,
)
from app.store.access.rights import LONGEST_TOKEN_DAYS, SCOPES, Role
from app.store.access.second_factors import end_second_factor
from app.store.access.tokens import all_tokens, insert_token, revoke_token
from app.store.database.engine import Transaction
from app.store.studies.audit import SORTABLE, audit_records, audit_state
from app.store.studies.studies import all_studies
from app.web.admin.access.account_page import Name
from app.web.admin.layout import page, see
from app.web.admin.listing import listing
from app.web.gates import Store, database
from app.web.roles import ActingOwner, Looking, Owner

Chosen = Annotated[list[str], Form(max_length=1000)]

router = APIRouter(prefix="/admin", include_in_schema=False)


@router.get("/users")
def users_page(request: Request, person: Owner) -> Response:
    return _page(request, person)


@router.post("/users")
def add_user(
    request: Request, person: Owner, actor: ActingOwner, name: Name, role: Annotated[Role, Form()], database: Store
) -> Response:
    with database.reading() as connection:
        known = experimenter_named(connection, name)
    if known:
        raise ConflictError(
            f"{name} is here already. Nothing was changed; use New link beside the name to let them in."
        )
    secret = renew_link(database, name, actor.now, role)
    with database.writing() as connection:
        actor.note(connection, "sign-in link made", subject=name, role=role)
    return _with_link(request, person, name, secret)


@router.post("/users/link")
def new_link(request: Request, person: Owner, actor: ActingOwner, name: Name, database: Store) -> Response:
    """Make a sign-in link that replaces somebody's password or earlier link."""
    with database.reading() as connection:
        known = _person(connection, name)
    if known.name == actor.name:
        raise ConflictError("You are signed in already; change your password under your name.")
    secret = renew_link(database, name, actor.now)
    with database.writing() as connection:
        actor.note(connection, "sign-in link made", subject=name, role=known.role, password_ended=known.has_password)
    return _with_link(request, person, name, secret)


def _with_link(request: Request, person: Experimenter, name: str, secret: str) -> Response:
    """Show all people, and a link that is shown only once."""
    return _page(request, person, {"name": name, "url": f"{request.base_url}admin/login/{secret}"})


def _page(request: Request, person: Experimenter, link: dict[str, str] | None = None) -> Response:
    with database(request).reading() as connection:
        people = all_experimenters(connection)
        slugs = [study.slug for study in all_studies(connection)]
    return page(request, "users", person, {"people": people, "slugs": slugs, "link": link})


@router.post("/users/second-factor")
def end_factor(actor: ActingOwner, name: Name, database: Store) -> Response:
    """End the second factor of somebody who has lost telephone and recovery codes, and their sessions."""
    with database.writing() as connection:
        known = _person(connection, name)
        end_second_factor(connection, known.id)
        end_all_sessions(connection, known.id)
        actor.note(connection, "second factor ended", subject=name)
    return see("/admin/users")


@router.post("/users/role")
def change_role(actor: ActingOwner, name: Name, role: Annotated[Role, Form()], database: Store) -> Response:
    with database.writing() as connection:
        _person(connection, name)
        set_role(connection, name, role)
        actor.note(connection, "role changed", subject=name, role=role)
    return see("/admin/users")


@router.post("/users/studies")
def change_studies(actor: ActingOwner, name: Name, database: Store, study: Chosen = []) -> Response:  # noqa: B006
    """Let somebody see the chosen studies only, or all."""
    with database.writing() as connection:
        _person(connection, name)
        restrict(connection, name, study)
        actor.note(connection, "studies changed", subject=name, studies=study)
    return see("/admin/users")


@router.post("/users/disable")
def disable_user(actor: ActingOwner, name: Name, database: Store) -> Response:
    with database.writing() as connection:
        _person(connection, name)
        tokens = disable(connection, name, actor.now)
        actor.note(connection, "access ended", subject=name, tokens=tokens)
    return see("/admin/users")


def _person(connection: Transaction, name: str) -> Experimenter:
    known = experimenter_named(connection, name)
    if known is None:
        raise NotFoundError("There is nobody of this name.")
    return known


@router.get("/tokens")
def tokens_page(request: Request, person: Owner) -> Response:
    return _tokens_page(request, person, None)


def _tokens_page(request: Request, person: Experimenter, made: dict[str, str] | None) -> Response:
    with database(request).reading() as connection:
        tokens = all_tokens(connection)
        slugs = [study.slug for study in all_studies(connection)]
    return page(request, "tokens", person, {"tokens": tokens, "scopes": SCOPES, "slugs": slugs, "made": made})


@router.post("/tokens")
def add_token(
    request: Request,
    person: Owner,
    actor: ActingOwner,
    name: Name,
    database: Store,
    scope: Annotated[list[str], Form(max_length=len(SCOPES))] = [],  # noqa: B006 (FastAPI copies it)
    days: Annotated[int | None, Form(ge=1, le=LONGEST_TOKEN_DAYS)] = None,
    study: Chosen = [ALL_STUDIES],  # noqa: B006
) -> Response:
    """Make a token, shown only once."""
    expires_at = actor.now + timedelta(days=days) if days else None
    try:
        with database.writing() as connection:
            secret = insert_token(connection, name, scope, actor.name, actor.now, expires_at, study)
            actor.note(connection, "token made", subject=name, scopes=scope, days=days, studies=study)
    except ValueError as error:
        raise InvalidError(f"This token was not made: {error}.") from error
    return _tokens_page(request, person, {"name": name, "secret": secret})


@router.post("/tokens/revoke")
def end_token(actor: ActingOwner, name: Name, database: Store) -> Response:
    with database.writing() as connection:
        if not revoke_token(connection, name, actor.now):
            raise NotFoundError("There is no such token, or it was revoked before.")
        actor.note(connection, "token revoked", subject=name)
    return see("/admin/tokens")


@router.get("/audit")
def audit_page(
    request: Request,
    person: Looking,
    database: Store,
    search: Annotated[str, Query(max_length=100)] = "",
) -> Response:
    sought = search.strip()
    with database.reading() as connection:
        shown = listing(request, audit_state(connection, search=sought)[0], SORTABLE)
        entries = audit_records(connection, search=sought, sort=shown.sort, limit=shown.size, offset=shown.offset)
    return page(request, "audit", person, {"entries": entries, "list": shown, "search": search})
