"""The experimenter's pages: sign in, all studies, one study's results."""

from __future__ import annotations

from fastapi import APIRouter

router = APIRouter(prefix="/admin", include_in_schema=False)
