"""What a study tells its participants of their data, and for how long it keeps what is personal in them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from datetime import datetime, timedelta
from typing import TYPE_CHECKING, Any

from app.study.stages import INTERVIEW, PRACTICE, SCREENING

if TYPE_CHECKING:
    from app.study.options import StudyOptions

LONGEST_CONTACT = 500  # characters
LONGEST_KEPT_DAYS = 36_500  # a hundred years


@dataclass(frozen=True)
class PrivacyOptions:
    """Who answers for participants' data, and when their personal data are deleted.

    Parameters
    ----------
    responsible : a person or an institution, as participants read it; empty: the page does not say
    contact : how to reach them, such as an address of mail; empty: the page does not say
    keep_days : days after the study was closed for which personal data are kept; 0: no limit
    """

    responsible: str = ""
    contact: str = ""
    keep_days: int = 0


def parse_privacy(content: Any) -> PrivacyOptions:
    """Read the table [options.privacy] of a study file.

    Raises
    ------
    ValueError
        Naming the key, the value and what is expected.
    """
    if not isinstance(content, Mapping):
        raise ValueError(f"privacy is {content!r}, expected a table of its own")
    known = [field.name for field in fields(PrivacyOptions)]
    if unknown := sorted(set(content) - set(known)):
        raise ValueError(f"privacy: {unknown[0]!r} is not known; expected some of {', '.join(known)}")
    days = content.get("keep_days", 0)
    if isinstance(days, bool) or not isinstance(days, int) or not 0 <= days <= LONGEST_KEPT_DAYS:
        raise ValueError(f"privacy: keep_days is {days!r}, expected a whole number from 0 to {LONGEST_KEPT_DAYS}")
    return PrivacyOptions(_line(content, "responsible"), _line(content, "contact"), days)


def collected(options: StudyOptions) -> list[str]:
    """Return what a study collects, as keys of the texts `privacy.collected` of the language packs.

    Parameters
    ----------
    options : the study's
    """
    stages = {"screening": SCREENING, "practice": PRACTICE, "interview": INTERVIEW}
    given = {
        "votes": True,
        "viewing": True,
        **{name: stage in options.way for name, stage in stages.items()},
        "notes": bool(options.spoken_questions),
        "outside": options.outside.is_on,
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
    return ended_at + timedelta(days=options.privacy.keep_days)


def _line(content: Mapping[str, Any], name: str) -> str:
    value = content.get(name, "")
    if not isinstance(value, str) or len(value) > LONGEST_CONTACT:
        raise ValueError(f"privacy: {name}: expected a text of at most {LONGEST_CONTACT} characters")
    return value.strip()
