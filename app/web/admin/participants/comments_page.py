"""Show all comments of a study, and code them by tags of one's own."""

from __future__ import annotations

from collections import Counter
from typing import Annotated
from urllib.parse import urlencode

from fastapi import APIRouter, Form, Query, Request
from fastapi.responses import Response

from app.errors import InvalidError
from app.operations.upkeep import comments
from app.store.participants.comments import (
    LONGEST_TAG,
    SOURCES,
    CommentPlace,
    SoughtComments,
    Source,
    comment_records,
    tag_records,
)
from app.store.studies.studies import Study
from app.study.questions.questionnaire import LONGEST_QUESTION
from app.web.admin.layout import see, study_page
from app.web.admin.listing import listed
from app.web.gates import Store
from app.web.roles import Acting, AStudy, Looking

LONGEST_FILTER = 100  # characters
LONGEST_BACK = 40 * LONGEST_FILTER  # three filters, each character of which may take twelve in an address
SOURCE_NAMES = {"written": "questionnaire", "spoken": "interview", "trial": "on a trial"}

Tag = Annotated[str, Form(min_length=1, max_length=LONGEST_TAG)]
Filter = Annotated[str, Query(max_length=LONGEST_FILTER)]

router = APIRouter(prefix="/admin/studies/{slug}/participants/comments", include_in_schema=False)


@router.get("")
def comments_page(
    request: Request,
    person: Looking,
    study: AStudy,
    database: Store,
    text: Filter = "",
    source: Filter = "",
    tag: Filter = "",
    participant: Filter = "",
    untagged: bool = False,
) -> Response:
    sought = SoughtComments(text.strip(), source, tag, participant.strip(), untagged)
    with database.reading() as connection:
        given = comment_records(connection, study.id)
        tags = tag_records(connection, study.id, given)
    rows = [row for row in given if sought.fits(row)]
    chosen = {"text": text, "source": source, "tag": tag, "participant": participant}
    chosen |= {"untagged": "true"} if untagged else {}
    shown = listed(request, rows)
    context = {
        "list": shown,
        "n_found": len(rows),
        "n_people": len({row["participant"] for row in rows}),
        "by_source": Counter(row["source"] for row in rows),
        "tags": tags,
        "sources": {source: SOURCE_NAMES[source] for source in SOURCES},
        "chosen": chosen,
        "back": urlencode({**chosen, "page": shown.page}),
        "longest_tag": LONGEST_TAG,
    }
    return study_page(request, "comments", person, study, context)


@router.post("/tags")
def new_tag(actor: Acting, study: AStudy, database: Store, tag: Tag) -> Response:
    comments.new_tag(database, study, tag, actor)
    return _seen(study)


@router.post("/tags/rename")
def change_tag(actor: Acting, study: AStudy, database: Store, tag: Tag, new: Tag) -> Response:
    comments.call_tag(database, study, tag, new, actor)
    return _seen(study)


@router.post("/tags/delete")
def remove_tag(
    actor: Acting,
    study: AStudy,
    database: Store,
    tag: Tag,
    again: Annotated[str, Form(max_length=LONGEST_TAG)] = "",
) -> Response:
    """Delete a tag, which nothing brings back onto its comments; typing it again prevents accidents."""
    if again.strip() != tag:
        raise InvalidError(f"To delete the tag {tag}, type {tag} into the field. Nothing was changed.")
    comments.remove_tag(database, study, tag, actor)
    return _seen(study)


@router.post("/tag")
def put_tag(
    actor: Acting,
    study: AStudy,
    database: Store,
    participant: Annotated[str, Form(max_length=40)],
    source: Annotated[Source, Form()],
    subject: Annotated[str, Form(max_length=LONGEST_QUESTION)],
    tag: Tag,
    take_off: Annotated[bool, Form()] = False,
    back: Annotated[str, Form(max_length=LONGEST_BACK)] = "",
) -> Response:
    """Give a comment a tag, which is added to the study if it is new; or take one off."""
    change = comments.take_tag_off if take_off else comments.put_tag
    change(database, study, CommentPlace(participant, source, subject), tag, actor)
    return _seen(study, back)


def _seen(study: Study, back: str = "") -> Response:
    return see(f"/admin/studies/{study.slug}/participants/comments{f'?{back}' if back else ''}")
