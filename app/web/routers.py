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
    file_routes,
    job_routes,
    material_routes,
    people_routes,
    routes,
    study_routes,
    upload_routes,
)
from app.web.monitoring import health
from app.web.participant import beginning, joined, pages, screening, session, trials

# OpenAPI describes them in this order.
REST = (
    trials,
    beginning,
    session,
    screening,
    routes,
    study_routes,
    people_routes,
    upload_routes,
    material_routes,
    file_routes,
)
MORE_REST = (api_page, job_routes, media, health)
DASHBOARD = (sign_in_page, account_page, users_page, server_page, background, manual_page)
WORK = (sets_page, file_uploads, strokes_page, tables_page, files_page, jobs_page)
STUDIES = (new_study_page, lifecycle_page, overview_page, design_page, films_page, edit_page, texts_page)
PEOPLE = (comments_page, demographics_page, records_page, interview_page, votes_page, invitations_page)
RESULTS = (scores_page, objective_page, models_page, attachments)
MODULES = (*REST, *MORE_REST, *DASHBOARD, *WORK, *STUDIES, *PEOPLE, *RESULTS, pages, joined)
ROUTERS: tuple[APIRouter, ...] = tuple(module.router for module in MODULES)


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
