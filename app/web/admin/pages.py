"""All studies, and one study's results."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from fastapi import APIRouter, Form, Path, Request
from fastapi.responses import Response

from app.errors import NotFoundError
from app.store.invitations import invitations_of
from app.store.studies import Progress, Standing, Study, all_studies, progress_of, set_standing
from app.web.admin.results_view import measure_names, results_view
from app.web.admin.shell import page, see
from app.web.gates import Acting, AStudy, Person, Store, database
from app.web.results import analysis_of, measure_svg, scores_svg

router = APIRouter(prefix="/admin", include_in_schema=False)


@dataclass(frozen=True)
class InvitationLink:
    url: str
    places: int | None
    n_used: int


@dataclass(frozen=True)
class Card:
    """What an experimenter sees of a study at a glance."""

    study: Study
    progress: Progress
    invitations: list[InvitationLink]


@router.get("")
def studies_page(request: Request, person: Person, database: Store) -> Response:
    with database.reading() as connection:
        found = all_studies(connection)
    return page(request, "studies", person, {"cards": [_card(request, study) for study in found]})


@router.get("/studies/{slug}")
def results_page(request: Request, person: Person, study: AStudy, database: Store) -> Response:
    analysis = analysis_of(database, study.id)
    results = results_view(analysis) if analysis else None
    return page(request, "results", person, {"card": _card(request, study), "results": results})


@router.get("/studies/{slug}/measures/{number}.svg")
def measure_plot(
    _person: Person, study: AStudy, number: Annotated[int, Path(ge=0, le=9999)], database: Store
) -> Response:
    analysis = analysis_of(database, study.id)
    names = measure_names(analysis) if analysis else []
    svg = measure_svg(analysis, names[number]) if analysis and number < len(names) else None
    if svg is None:
        raise NotFoundError("There is no such measure beside the scores.")
    return Response(svg, media_type="image/svg+xml")


@router.get("/studies/{slug}/scores/{comparison}.svg")
def scores_plot(
    _person: Person, study: AStudy, comparison: Annotated[str, Path(max_length=200)], database: Store
) -> Response:
    analysis = analysis_of(database, study.id)
    svg = scores_svg(analysis, comparison) if analysis else None
    if svg is None:
        raise NotFoundError("There are no such scores yet.")
    return Response(svg, media_type="image/svg+xml")


@router.post("/studies/{slug}/state")
def change_standing(actor: Acting, study: AStudy, state: Annotated[Standing, Form()], database: Store) -> Response:
    with database.writing() as connection:
        set_standing(connection, study.id, state, actor.now)
        actor.note(connection, f"study {state}", study, study.slug)
    return see(f"/admin/studies/{study.slug}")


def _card(request: Request, study: Study) -> Card:
    with database(request).reading() as connection:
        progress = progress_of(connection, study.id)
        invitations = invitations_of(connection, study.id)
    links = [InvitationLink(f"{request.base_url}s/{one.code}", one.places, one.n_used) for one in invitations]
    return Card(study, progress, links)
