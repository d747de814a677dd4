"""Name the routers of all pages and of the REST interface, and join them."""

from __future__ import annotations

from collections.abc import Sequence

from fastapi import APIRouter
from fastapi.routing import APIRoute
from starlette.routing import BaseRoute, Route

from app.web import media
from app.web.admin import background, manual_page
from app.web.admin.access import account_page, server_page, sign_in_page, users_page
from app.web.admin.participants import (
    comments_page,
    demographics_page,
    interview_page,
    invitations_page,
    records_page,
    votes_page,
)
from app.web.admin.results import attachments, models_page, objective_page, scores_page
from app.web.admin.studies import (
    design_page,
    edit_page,
    films_page,
    lifecycle_page,
    new_study_page,
    overview_page,
    sets_page,
    texts_page,
)
from app.web.admin.work import file_uploads, files_page, jobs_page, strokes_page, tables_page
from app.web.analyst import (
    api_page,
    job_routes,
    material_routes,
    people_routes,
    routes,
    study_routes,
    upload_routes,
)
from app.web.monitoring import health
from app.web.participant import beginning, joined, pages, screening, session, trials

ROUTERS = (
    trials.router,
    beginning.router,
    session.router,
    screening.router,
    routes.router,
    study_routes.router,
    people_routes.router,
    upload_routes.router,
    material_routes.router,
    api_page.router,
    job_routes.router,
    media.router,
    health.router,
    sign_in_page.router,
    account_page.router,
    users_page.router,
    server_page.router,
    sets_page.router,
    file_uploads.router,
    strokes_page.router,
    tables_page.router,
    files_page.router,
    background.router,
    manual_page.router,
    jobs_page.router,
    new_study_page.router,
    lifecycle_page.router,
    overview_page.router,
    comments_page.router,
    demographics_page.router,
    records_page.router,
    interview_page.router,
    votes_page.router,
    design_page.router,
    films_page.router,
    invitations_page.router,
    scores_page.router,
    objective_page.router,
    models_page.router,
    attachments.router,
    edit_page.router,
    texts_page.router,
    pages.router,
    joined.router,
)


def joined_routers(routers: Sequence[APIRouter]) -> APIRouter:
    """Join routers, so that their order has no meaning: words of an address are tried before its placeholders."""
    joined = APIRouter()
    for router in routers:
        _answer_head(router)
        joined.routes += router.routes
    joined.routes.sort(key=_placeholders)
    return joined


def _placeholders(route: BaseRoute) -> list[bool]:
    assert isinstance(route, Route)
    return ["{" in part for part in route.path.split("/")]


def _answer_head(router: APIRouter) -> None:
    """Answer HEAD, the headers alone, wherever something is read: monitors and downloads ask for it."""
    routes = [(route, route.methods or set()) for route in router.routes if isinstance(route, APIRoute)]
    asked = {route.path for route, methods in routes if methods == {"HEAD"}}  # a process's applications share routers
    for route, methods in routes:
        if methods != {"GET"} or route.path in asked:
            continue
        if route.include_in_schema:  # described once, as GET
            path = route.path.removeprefix(router.prefix)
            router.add_api_route(
                path,
                route.endpoint,
                methods=["HEAD"],
                dependencies=route.dependencies,
                response_model=route.response_model,
                include_in_schema=False,
            )
        else:
            methods.add("HEAD")
