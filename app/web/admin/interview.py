"""The form for the spoken interview: an experimenter notes what a participant says."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Form, Path, Request
from fastapi.responses import Response

from app.errors import InvalidError
from app.store.interviews import keep_spoken, spoken_of
from app.store.participants import participant_labelled
from app.study.options import parse_options
from app.study.questionnaire import LONGEST_ANSWER
from app.web.admin.shell import see, study_page
from app.web.gates import Acting, AStudy, Looking, Store

Label = Annotated[str, Path(max_length=40)]
Said = Annotated[list[Annotated[str, Form(max_length=2 * LONGEST_ANSWER)]], Form()]

router = APIRouter(prefix="/admin/studies/{slug}/participants/{label}/interview", include_in_schema=False)


@router.get("")
def interview_page(request: Request, person: Looking, study: AStudy, label: Label, database: Store) -> Response:
    with database.reading() as connection:
        found = participant_labelled(connection, study.id, label)
        said = spoken_of(connection, found.id)
    asked = parse_options(study.options).spoken_questions
    answers = {question: said.get(question, "") for question in (*asked, *said)}
    context = {
        "label": label,
        "answers": answers,
        "longest": LONGEST_ANSWER,
        "is_saved": "saved" in request.query_params,
    }
    return study_page(request, "interview", person, study, context)


@router.post("")
def keep_interview(
    actor: Acting, study: AStudy, label: Label, question: Said, answer: Said, database: Store
) -> Response:
    """Keep what was noted; a question that is not answered stays without an answer."""
    with database.writing() as connection:
        found = participant_labelled(connection, study.id, label)
        if found.erased_at is not None:
            raise InvalidError(f"{label} was erased; nothing is kept of them any more.")
        known = {*parse_options(study.options).spoken_questions, *spoken_of(connection, found.id)}
        noted = {asked: said.replace("\r\n", "\n").strip() for asked, said in zip(question, answer, strict=False)}
        if unknown := sorted(set(noted) - known):
            raise InvalidError(f"This study does not ask {unknown[0]!r:.80}.")
        if long := [asked for asked, said in noted.items() if len(said) > LONGEST_ANSWER]:
            raise InvalidError(f"The answer to {long[0]!r:.80} is longer than {LONGEST_ANSWER} characters.")
        keep_spoken(connection, found.id, noted, actor.name, actor.now)
        actor.note(connection, "interview noted", study, label)
    return see(f"/admin/studies/{study.slug}/participants/{label}/interview?saved=1")
