"""Manage a study's invitations: links and QR codes for one participant, several, or an unlimited number."""

from __future__ import annotations

import io
from typing import Annotated

import segno
from fastapi import APIRouter, Form, Path, Request
from fastapi.responses import Response

from app.errors import NotFoundError
from app.store.invitations import end_invitation, insert_invitation, invitations_of
from app.web.admin.layout import see, study_page
from app.web.gates import Acting, AStudy, Looking, Store

MOST_AT_ONCE = 200
MOST_PLACES = 100_000
SHOWN = 8  # characters of a code that the audit log shows

Code = Annotated[str, Path(max_length=40)]

router = APIRouter(prefix="/admin/studies/{slug}/invitations", include_in_schema=False)


@router.get("")
def invitations_page(request: Request, person: Looking, study: AStudy, database: Store) -> Response:
    with database.reading() as connection:
        invitations = invitations_of(connection, study.id)
    context = {"invitations": list(reversed(invitations)), "site": str(request.base_url)}
    return study_page(request, "invitations", person, study, context)


@router.post("")
def invite(
    actor: Acting,
    study: AStudy,
    database: Store,
    places: Annotated[int | None, Form(ge=1, le=MOST_PLACES)] = None,
    number: Annotated[int, Form(ge=1, le=MOST_AT_ONCE)] = 1,
) -> Response:
    with database.writing() as connection:
        for _ in range(number):
            insert_invitation(connection, study.id, places, actor.now)
        actor.note(connection, "invitations made", study, study.slug, number=number, places=places)
    return see(f"/admin/studies/{study.slug}/invitations")


@router.post("/{code}/end")
def end(actor: Acting, study: AStudy, code: Code, database: Store) -> Response:
    with database.writing() as connection:
        if not end_invitation(connection, study.id, code):
            raise NotFoundError("This study has no such invitation.")
        actor.note(connection, "invitation ended", study, code[:SHOWN])
    return see(f"/admin/studies/{study.slug}/invitations")


@router.get("/{code}/qr.svg")
def qr_code(request: Request, _person: Looking, study: AStudy, code: Code, database: Store) -> Response:
    with database.reading() as connection:
        if code not in {invitation.code for invitation in invitations_of(connection, study.id)}:
            raise NotFoundError("This study has no such invitation.")
    picture = io.BytesIO()
    segno.make(f"{request.base_url}s/{code}", error="m").save(picture, kind="svg", scale=5, border=2)
    return Response(picture.getvalue(), media_type="image/svg+xml")
