"""Show who took part in a study, as a paper's table of participants does."""

from __future__ import annotations

from itertools import groupby
from typing import Annotated

from fastapi import APIRouter, Query, Request
from fastapi.responses import Response

from app.store.trials.demographics import Among, demographics_among
from app.study.questions.demographics import demographic_sentence
from app.web.admin.layout import study_page
from app.web.gates import Store
from app.web.roles import AStudy, Looking

router = APIRouter(prefix="/admin/studies/{slug}/participants/demographics", include_in_schema=False)


@router.get("")
def demographics_page(
    request: Request,
    person: Looking,
    study: AStudy,
    database: Store,
    among: Annotated[Among, Query()] = "counted",
) -> Response:
    with database.reading() as connection:
        n_people, rows = demographics_among(connection, study.id, among)
    questions = [(text, list(answers)) for text, answers in groupby(rows, key=lambda row: row["text"])]
    context = {
        "n_people": n_people,
        "questions": questions,
        "sentence": demographic_sentence(n_people, rows),
        "among": among,
    }
    return study_page(request, "demographics", person, study, context)
