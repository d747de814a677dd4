"""Say what a study tells its participants of their data, and until when it keeps what is personal in them."""

from __future__ import annotations

from datetime import datetime, timedelta

from app.study.option_fields import SettingError
from app.study.options.options import StudyOptions
from app.study.stages import INTERVIEW, PRACTICE, SCREENING


def collected(options: StudyOptions, *, is_named: bool = False) -> list[str]:
    """Return what a study collects, as keys of the texts `privacy.collected` of the language packs.

    Parameters
    ----------
    options : the study's
    is_named : does an invitation for one participant bear a label, which may be a name?
    """
    stages = {"screening": SCREENING, "practice": PRACTICE, "interview": INTERVIEW}
    given = {
        "votes": True,
        "viewing": True,
        **{name: stage in options.way for name, stage in stages.items()},
        "notes": bool(options.spoken_questions),
        "outside": options.outside.is_on,
        "invitation": is_named,
    }
    return [name for name, is_collected in given.items() if is_collected]


def forgets_at(options: StudyOptions, closed_at: datetime | None) -> datetime | None:
    """Return when a study's personal data are to be deleted; None: it is open, or keeps them without limit.

    Parameters
    ----------
    options : the study's
    closed_at : when it was closed; None: it was not, but may have ended by `limits.open_until`
    """
    until = options.limits.open_until
    ended_at = closed_at or (datetime.fromisoformat(until) if until else None)
    if ended_at is None or not options.privacy.keep_days:
        return None
    try:
        return ended_at + timedelta(days=options.privacy.keep_days)
    except OverflowError:  # after the year 9999, which stands for no end
        return None


def check_days_left(options: StudyOptions, closed_at: datetime | None, now: datetime) -> None:
    """Refuse options by which a study's personal data would be deleted at once: who set them shall have a day to think.

    Parameters
    ----------
    options : as they are to be
    closed_at : as in `forgets_at`
    now : the time

    Raises
    ------
    ValueError
        If the study ended longer ago than `privacy.keep_days` says.
    """
    end = forgets_at(options, closed_at)
    if end is None or end > now:
        return
    ended_at = end - timedelta(days=options.privacy.keep_days)
    least = (now - ended_at).days + 1
    raise SettingError(
        "privacy.keep_days",
        f"is {options.privacy.keep_days}, but the study ended on {ended_at.date()}, so its personal "
        f"data would be deleted within the hour; expected {least} or more ({least}: they go within a day), or 0",
    )
