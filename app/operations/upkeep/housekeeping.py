"""Keep the server's house while it serves: remove leftovers, and personal data whose time is over."""

from __future__ import annotations

import logging
from datetime import datetime

from app.errors import StudyError
from app.operations.upkeep.erasure import enforce_retention
from app.operations.upkeep.leftovers import remove_leftovers
from app.settings import Settings
from app.store.database.engine import Database

EVERY_S = 3600.0

log = logging.getLogger(__name__)


def keep_house(settings: Settings, database: Database, now: datetime) -> None:
    """Do once what is due; what fails is logged, and tried again the next time."""
    try:
        remove_leftovers(settings, now)
        for slug in enforce_retention(settings, database, now):
            log.warning("study %s: personal data were deleted, as its setting privacy.keep_days says", slug)
        database.shred_deleted()  # what a reader kept in the log when it was deleted
    except (StudyError, OSError, ValueError):
        log.exception("housekeeping failed; it is tried again in an hour")
