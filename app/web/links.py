"""The links by which people come to a study."""

from __future__ import annotations

from fastapi import Request

from app.store.studies.studies import Study
from app.study.options.options import parse_options
from app.study.options.platforms import link_query


def link_to(request: Request, study: Study, code: str) -> str:
    """Return an invitation's whole link, with what a recruiting platform fills in where the study needs it."""
    return f"{request.base_url}s/{code}{link_query(parse_options(study.options).outside)}"
