"""The experimenter's pages: sign in, all studies, one study's results."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from fastapi import APIRouter, Form, Path, Request
from fastapi.responses import RedirectResponse, Response

from app.errors import NotFoundError, UnauthorisedError
from app.store.experimenters import SESSION_LASTS, sign_in, sign_out
from app.store.invitations import invitations_of
from app.store.studies import Progress, State, Study, all_studies, progress_of, set_state
from app.web.admin.results_view import results_view
from app.web.gates import EXPERIMENTER_COOKIE, AStudy, Now, Person, Store, database, is_secure
from app.web.results import analysis_of, scores_svg

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


@router.get("/login/{secret}")
def login(secret: Annotated[str, Path(max_length=100)], request: Request, database: Store, now: Now) -> Response:
    token = sign_in(database, secret, now)
    if token is None:
        raise UnauthorisedError(
            "This sign-in link is not valid any more. `reconstudy admin add NAME` prints a new one."
        )
    answer = RedirectResponse("/admin", status_code=303)
    lasts_s = int(SESSION_LASTS.total_seconds())
    answer.set_cookie(
        EXPERIMENTER_COOKIE, token, max_age=lasts_s, httponly=True, samesite="lax", secure=is_secure(request)
    )
    return answer


@router.post("/logout")
def logout(request: Request, database: Store) -> Response:
    if token := request.cookies.get(EXPERIMENTER_COOKIE):
        sign_out(database, token)
    answer = RedirectResponse("/", status_code=303)
    answer.delete_cookie(EXPERIMENTER_COOKIE, httponly=True, samesite="lax")
    return answer


@router.get("")
def studies_page(request: Request, person: Person, database: Store) -> Response:
    with database.reading() as connection:
        found = all_studies(connection)
    context = {"experimenter": person, "cards": [_card(request, study) for study in found]}
    return _page(request, "admin/studies.html", context)


@router.get("/studies/{slug}")
def results_page(request: Request, person: Person, study: AStudy, database: Store) -> Response:
    analysis = analysis_of(database, study.id)
    results = results_view(analysis) if analysis else None
    context = {"experimenter": person, "card": _card(request, study), "results": results}
    return _page(request, "admin/results.html", context)


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
def change_state(_person: Person, study: AStudy, state: Annotated[State, Form()], database: Store) -> Response:
    with database.writing() as connection:
        set_state(connection, study.id, state)
    return RedirectResponse(f"/admin/studies/{study.slug}", status_code=303)


def _card(request: Request, study: Study) -> Card:
    with database(request).reading() as connection:
        progress = progress_of(connection, study.id)
        invitations = invitations_of(connection, study.id)
    links = [InvitationLink(f"{request.base_url}s/{one.code}", one.places, one.n_used) for one in invitations]
    return Card(study, progress, links)


def _page(request: Request, template: str, context: dict[str, object]) -> Response:
    page: Response = request.app.state.templates.TemplateResponse(request, template, context)
    return page
