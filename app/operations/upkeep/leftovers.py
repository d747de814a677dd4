"""Remove files that a killed process left half written, or half deleted, in the data folder; nothing uses them.

What tells by its lock that nobody works on it goes at once, the rest after a day: another process may still write it.
"""

from __future__ import annotations

import logging
import shutil
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

from app.files import LOCK, is_locked
from app.intake.part_uploads import remove_expired, remove_killed
from app.settings import Settings

LEFT_FOR = timedelta(days=1)
# names that ground/files.py, app/files.py, app/web/uploads.py and app/operations/studies/stimulus_sets.py give
FILES, UPLOADS, DELETED = ".*.part*", ".upload-*", ".*.deleted"
BEGUN = ".*.*-*.part"  # what recon/runtime/files.py calls a folder that a job begins

log = logging.getLogger(__name__)


def remove_leftovers(settings: Settings, now: datetime) -> None:
    """Remove uploads whose process was killed, and half-written files that have not changed for a day."""
    for upload in remove_killed(settings.intake_dir):
        log.warning("the check of the upload %s was killed; whoever sends the file again repeats it", upload)
    for upload in remove_expired(settings.intake_dir, now):
        log.warning("removed the upload %s, which nobody had added to for a day", upload)
    for path in _leftovers(settings):
        try:
            changed_at = datetime.fromtimestamp(path.stat().st_ctime, UTC)  # films get an artificial st_mtime
            if now - changed_at > LEFT_FOR or _was_killed(path):
                _remove(path)
                log.warning("removed %s, which was left half written", path)
        except OSError as error:  # another worker was quicker, or somebody else owns it
            log.warning("%s was left half written and cannot be removed: %s", path, error)


def _leftovers(settings: Settings) -> Iterator[Path]:
    data = settings.data_dir
    for pattern in (UPLOADS, DELETED, FILES):
        yield from settings.sets_dir.glob(pattern)
    yield from settings.intake_dir.glob(f"*/{BEGUN}")
    yield from (data / "uploads").glob(UPLOADS)
    for folder in (settings.media_dir, data / "stills", data / "models", data / "reports"):
        yield from folder.glob(FILES)


def _was_killed(path: Path) -> bool:
    """Tell whether a folder of work has a lock that nobody holds."""
    return (path / LOCK).is_file() and not is_locked(path / LOCK)


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink()
