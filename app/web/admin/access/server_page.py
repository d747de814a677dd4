"""Show the server's settings to its owners."""

from __future__ import annotations

import platform
import shutil
from importlib.metadata import version

from fastapi import APIRouter, Request
from fastapi.responses import Response

from app.store.database.migrate import newest_version
from app.web.admin.layout import page
from app.web.gates import settings
from app.web.roles import Owner

router = APIRouter(prefix="/admin", include_in_schema=False)


@router.get("/settings")
def settings_page(request: Request, person: Owner) -> Response:
    current = settings(request)
    disk = shutil.disk_usage(current.data_dir)
    facts = {
        "Version": version("reconstudy"),
        "Python": platform.python_version(),
        "Database": "SQLite in the data folder" if current.is_embedded else current.url.split("://", 1)[0],
        "Version of the tables": newest_version(),
        "Data folder": str(current.data_dir.absolute()),
        "Stimulus sets": str(current.sets_dir.absolute()),
        "Intake folder": str(current.intake_dir.absolute()),
        "Free disk space": f"{disk.free / 1e9:.1f} GB of {disk.total / 1e9:.1f} GB",
    }
    described = [
        (f"RECONSTUDY_{name.upper()}", getattr(current, name), field.description or "")
        for name, field in type(current).model_fields.items()
        if name != "database_url"  # it may hold a password
    ]
    return page(request, "settings", person, {"facts": facts, "described": described})
