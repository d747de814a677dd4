"""Keep the server's house while it serves: remove leftovers, and personal data whose time is over."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from datetime import datetime

from app.errors import StudyError
from app.operations.upkeep.erasure import enforce_retention
from app.operations.upkeep.leftovers import remove_leftovers
from app.settings import Settings
from app.store.database.engine import Database

EVERY_S = 3600.0
LARGEST_JUMP_S = 43_200.0  # of the clock between two looks; retention counts days

log = logging.getLogger(__name__)


class Housekeeper:
    """Does what is due, again and again.

    Personal data go only when two looks, some time apart, agree about the time: a clock that jumped by days deletes
    nothing at once.

    Parameters
    ----------
    monotonic_s : a clock in seconds that nobody sets
    """

    def __init__(
        self, settings: Settings, database: Database, monotonic_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._settings, self._database, self._monotonic_s = settings, database, monotonic_s
        self._looked: tuple[datetime, float] | None = None

    def keep_house(self, now: datetime) -> None:
        """Do once what is due; what fails is logged, and tried again the next time."""
        try:
            remove_leftovers(self._settings, now)
            if self._is_sure_of(now):
                for slug in enforce_retention(self._settings, self._database, now):
                    log.warning("study %s: personal data were deleted, as its setting privacy.keep_days says", slug)
            self._database.shred_deleted()  # what a reader kept in the log when it was deleted
        except (StudyError, OSError, ValueError):
            log.exception("housekeeping failed; it is tried again in an hour")

    def _is_sure_of(self, now: datetime) -> bool:
        """Whether as much time has passed since the last look as the other clock says."""
        before, self._looked = self._looked, (now, self._monotonic_s())
        if before is None:
            return False
        jump_s = (now - before[0]).total_seconds() - (self._looked[1] - before[1])
        if abs(jump_s) > LARGEST_JUMP_S:
            log.warning("the clock jumped by %.1f days; no personal data are deleted at this look", jump_s / 86400)
            return False
        return True
