"""Note a participant's answers in the spoken interview."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from fastapi import APIRouter, Form, Path, Request
from fastapi.responses import Response

from app.errors import InvalidError
from app.operations.upkeep.people import note_interview
from app.store.participants.interviews import spoken_of
from app.store.participants.participants import participant_labelled
from app.study.options.options import parse_options
from app.study.questions.questionnaire import LONGEST_ANSWER
from app.web.admin.layout import see, study_page, unix
from app.web.gates import Store
from app.web.roles import Acting, AStudy, Looking

Label = Annotated[str, Path(max_length=40)]
Said = Annotated[list[Annotated[str, Form(max_length=2 * LONGEST_ANSWER)]], Form()]

router = APIRouter(prefix="/admin/studies/{slug}/participants/{label}/interview", include_in_schema=False)


@router.get("")
def interview_page(request: Request, person: Looking, study: AStudy, label: Label, database: Store) -> Response:
    with database.reading() as connection:
        participant = participant_labelled(connection, study.id, label)
        said = spoken_of(connection, participant.id)
    asked = parse_options(study.options).spoken_questions
    answers = {question: said.get(question, "") for question in (*asked, *said)}
    context = {"label": label, "answers": answers, "longest": LONGEST_ANSWER}
    return study_page(request, "interview", person, study, context)


@router.post("")
def keep_interview(
    actor: Acting,
    study: AStudy,
    label: Label,
    question: Said,
    answer: Said,
    database: Store,
    seen: Said = [],  # noqa: B006 (FastAPI copies it)
) -> Response:
    """Save the answers noted; a question that is not answered stays without an answer.

    Parameters
    ----------
    seen : the answers as the page showed them; an answer unchanged since was not noted here, and keeps its stored value
    """
    if len(question) != len(answer) or len(seen) not in (0, len(question)):
        raise InvalidError("The questions and their answers do not belong together. Load the page again.")
    note_interview(database, study, label, _by_question(question, answer), actor, _by_question(question, seen))
    return see(f"/admin/studies/{study.slug}/participants/{label}/interview?saved=1")


def _by_question(questions: Sequence[str], texts: Sequence[str]) -> dict[str, str]:
    """Return a form's texts by question, with a file's line ends."""
    return {asked: unix(text) for asked, text in zip(questions, texts, strict=False)}
