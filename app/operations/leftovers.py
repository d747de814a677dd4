"""Remove files that a killed process left half written in the data folder; no later process uses them."""

from __future__ import annotations

import logging
import shutil
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

from app.settings import Settings

LEFT_FOR = timedelta(days=1)  # younger files may still be written by another worker
# the names that app/files.py, app/web/admin/uploads.py and app/operations/attach.py give
FILES, UPLOADS, REPORTS = ".*.part*", ".upload-*", ".part-*"

log = logging.getLogger(__name__)


def remove_leftovers(settings: Settings, now: datetime) -> None:
    """Remove half-written files that have not changed for a day."""
    for path in _leftovers(settings):
        try:
            changed_at = datetime.fromtimestamp(path.stat().st_ctime, UTC)  # films get an artificial st_mtime
            if now - changed_at > LEFT_FOR:
                _remove(path)
                log.warning("removed %s, which was left half written", path)
        except OSError as error:  # another worker was quicker, or somebody else owns it
            log.warning("%s was left half written and cannot be removed: %s", path, error)


def _leftovers(settings: Settings) -> Iterator[Path]:
    data = settings.data_dir
    yield from settings.sets_dir.glob(UPLOADS)
    yield from (data / "uploads").glob(UPLOADS)
    yield from (data / "reports").glob(REPORTS)
    for folder in (settings.media_dir, data / "stills", data / "models"):
        yield from folder.glob(FILES)


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink()
