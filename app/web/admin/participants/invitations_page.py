"""Manage a study's invitations: links and QR codes for one participant, several, or an unlimited number."""

from __future__ import annotations

import io
import re
from codecs import BOM_UTF8
from typing import Annotated, Any

import segno
from fastapi import APIRouter, Form, Path, Request
from fastapi.responses import Response

from app.errors import InvalidError, NotFoundError
from app.operations.studies.invitations import MOST_AT_ONCE, make_invitations, name_invitation, stop_invitation
from app.operations.studies.manage import study_file_of
from app.store.participants.invitations import invitations_of
from app.store.participants.participants import group_counts
from app.store.studies.audit import Entry, record
from app.store.studies.studies import progress_of
from app.store.trials.designs import datasets_of
from app.store.trials.orders import n_taken_in
from app.study.design.groups import Group, check_groups
from app.study.options.options import StudyOptions, parse_options
from app.study.options.own_texts import NAME
from app.study.options.platforms import MTURK_ID, link_query, parameters, unknown_placeholders
from app.study.options.wording import first_language, own_texts
from app.study.planning import MOST_PLACES
from app.web.admin.layout import attachment, page, see, study_page, unix
from app.web.admin.studies.edit_page import Revision, save_study
from app.web.analyst.formats import CSV, csv_text
from app.web.gates import Now, Store, link_to
from app.web.roles import Acting, AStudy, Looking

LONGEST_LABEL = 200
LONGEST_PEOPLE = 20_000  # characters
LONGEST_GROUPS = 10_000
COLUMNS = ("label", "link", "code", "places", "used", "created_at")
MAIL_MERGE_COLUMNS = ("name", "email", "link")
ADDRESSED = re.compile(r"(.*?)[\s,;]*<?([^\s<>,;\"]+@[^\s<>,;\"]+)>?")  # a label that ends in an address

Code = Annotated[str, Path(max_length=40)]
Label = Annotated[str, Form(max_length=LONGEST_LABEL)]

router = APIRouter(prefix="/admin/studies/{slug}/invitations", include_in_schema=False)


@router.get("")
def invitations_page(request: Request, person: Looking, study: AStudy, database: Store, now: Now) -> Response:
    options = parse_options(study.options)
    with database.reading() as connection:
        invitations = invitations_of(connection, study.id)
        n_finished, n_under_way = n_taken_in(connection, study, now)
        counts = group_counts(connection, study.id)
        datasets = datasets_of(connection, study.id)
        has_begun = progress_of(connection, study.id).n_started > 0
    context = {
        "invitations": list(reversed(invitations)),
        "site": str(request.base_url),
        "query": link_query(options.outside),
        "unfilled": unknown_placeholders(options.outside),
        "parameters": parameters(options.outside),
        "is_of_mturk": options.outside.id == MTURK_ID,
        "n_finished": n_finished,
        "n_under_way": n_under_way,
        "limits": options.limits,
        "groups": [(group, *counts.get(group.name, (0, 0))) for group in options.groups],
        "group_lines": "\n".join(_line(group) for group in options.groups),
        "datasets": datasets,
        "has_begun": has_begun,
        "longest": {"label": LONGEST_LABEL, "people": LONGEST_PEOPLE, "groups": LONGEST_GROUPS},
        "most_at_once": MOST_AT_ONCE,
    }
    return study_page(request, "invitations", person, study, context)


@router.post("")
def invite(
    actor: Acting,
    study: AStudy,
    database: Store,
    places: Annotated[int | None, Form(ge=1, le=MOST_PLACES)] = None,
    number: Annotated[int, Form(ge=1, le=MOST_AT_ONCE)] = 1,
    label: Label = "",
) -> Response:
    make_invitations(database, study, places, [_tidy(label)] * number, actor)
    return _seen(study.slug)


@router.post("/people")
def invite_people(
    actor: Acting, study: AStudy, database: Store, people: Annotated[str, Form(max_length=LONGEST_PEOPLE)]
) -> Response:
    """Make an invitation for one participant for each line of a list, which becomes its label."""
    labels = [tidy for line in people.splitlines() if (tidy := _tidy(line))]
    if not 1 <= len(labels) <= MOST_AT_ONCE:
        raise InvalidError(f"The list has {len(labels)} lines, expected 1 to {MOST_AT_ONCE}. No invitation was made.")
    if too_long := [number for number, label in enumerate(labels, start=1) if len(label) > LONGEST_LABEL]:
        raise InvalidError(f"Line {too_long[0]} is longer than {LONGEST_LABEL} characters. No invitation was made.")
    make_invitations(database, study, 1, labels, actor)
    return _seen(study.slug)


@router.post("/groups")
def assign_groups(
    request: Request,
    actor: Acting,
    study: AStudy,
    database: Store,
    revision: Revision,
    groups: Annotated[str, Form(max_length=LONGEST_GROUPS)] = "",
) -> Response:
    """Set the groups that participants are assigned to: a line for each, `NAME` or `NAME: DATASET, DATASET`."""
    with database.reading() as connection:
        datasets = datasets_of(connection, study.id)
    try:
        wanted = StudyOptions.read(
            {"groups": [_described(line) for line in unix(groups).splitlines() if line.strip()]}
        ).groups
        check_groups(wanted, datasets)
    except ValueError as error:
        raise InvalidError(f"Nothing was changed: {error}.") from error
    current = study_file_of(study)
    changed = current.but(options=current.options.but(groups=wanted))
    return save_study(request, study, changed, revision, actor, "invitations")


@router.get("/invitations.csv")
def export_invitations(request: Request, person: Looking, study: AStudy, database: Store, now: Now) -> Response:
    with database.writing() as connection:
        rows = [
            {
                "label": invitation.label,
                "link": link_to(request, study, invitation.code),
                "code": invitation.code,
                "places": invitation.places,
                "used": invitation.n_used,
                "created_at": invitation.created_at,
            }
            for invitation in invitations_of(connection, study.id)
        ]
        record(connection, person.name, Entry("invitations exported", study.id, study.slug), now)
    return _table(rows, COLUMNS, f"{study.slug}-invitations.csv")


@router.get("/mail-merge.csv")
def export_mail_merge(request: Request, person: Looking, study: AStudy, database: Store, now: Now) -> Response:
    """Export a row for each labelled invitation with places left: name and address of its label, and the link.

    It begins with the mark of UTF-8, without which office programs take names for those of another alphabet.
    """
    rows = []
    with database.writing() as connection:
        for invitation in invitations_of(connection, study.id):
            if invitation.label and not invitation.is_used:
                name, email = split_label(invitation.label)
                rows.append({"name": name, "email": email, "link": link_to(request, study, invitation.code)})
        record(connection, person.name, Entry("invitations exported", study.id, study.slug), now)
    return _table(rows, MAIL_MERGE_COLUMNS, f"{study.slug}-mail-merge.csv", BOM_UTF8)


@router.get("/print")
def print_sheet(request: Request, person: Looking, study: AStudy, database: Store) -> Response:
    """Show a sheet to print: a card with QR code, link and label for each invitation with places left."""
    with database.reading() as connection:
        invitations = [invitation for invitation in invitations_of(connection, study.id) if not invitation.is_used]
    links = [link_to(request, study, invitation.code) for invitation in invitations]
    cards = [
        (invitation, link, _qr(link).svg_inline(scale=4, border=2))
        for invitation, link in zip(invitations, links, strict=True)
    ]
    options = parse_options(study.options)
    title = own_texts(options, first_language(options)).get(NAME, study.name)  # as participants know the study
    return page(request, "print_sheet", person, {"study": study, "title": title, "cards": cards})


@router.post("/{code}/label")
def change_label(actor: Acting, study: AStudy, code: Code, database: Store, label: Label = "") -> Response:
    name_invitation(database, study, code, label, actor)
    return _seen(study.slug)


@router.post("/{code}/end")
def end(actor: Acting, study: AStudy, code: Code, database: Store) -> Response:
    stop_invitation(database, study, code, actor)
    return _seen(study.slug)


@router.get("/{code}/qr.svg")
def qr_code(request: Request, _person: Looking, study: AStudy, code: Code, database: Store) -> Response:
    with database.reading() as connection:
        invitation = next((each for each in invitations_of(connection, study.id) if each.code == code), None)
    if invitation is None:
        raise NotFoundError("This study has no such invitation.")
    picture = io.BytesIO()
    _qr(link_to(request, study, invitation.code)).save(picture, kind="svg", scale=5, border=2)
    return Response(picture.getvalue(), media_type="image/svg+xml")


def split_label(label: str) -> tuple[str, str]:
    """Split `Ada Example <ada@example.org>` or `Ada Example, ada@example.org` into name and address.

    A label without an address is a name; an address without a name is both.
    """
    addressed = ADDRESSED.fullmatch(label.strip())
    if addressed is None:
        return label, ""
    name, email = addressed.groups()
    return name.strip(' "') or email, email


def _qr(link: str) -> segno.QRCode:
    return segno.make(link, error="m")


def _table(rows: list[dict[str, Any]], columns: tuple[str, ...], name: str, beginning: bytes = b"") -> Response:
    headers = {"Content-Disposition": attachment(name)}
    return Response(beginning + csv_text(rows, columns).encode(), media_type=CSV, headers=headers)


def _tidy(label: str) -> str:
    """Return a label in one line."""
    return " ".join(label.split())


def _line(group: Group) -> str:
    return f"{group.name}: {', '.join(group.datasets)}" if group.datasets else group.name


def _described(line: str) -> dict[str, Any]:
    """Read a line as `_line` writes it."""
    name, _, datasets = line.partition(":")
    return {"name": name.strip(), "datasets": [tidy for part in datasets.split(",") if (tidy := part.strip())]}


def _seen(slug: str) -> Response:
    return see(f"/admin/studies/{slug}/invitations")
