"""Keep invitations: codes that let participants in."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import ColumnElement, Connection, Select, delete, exists, false, func, insert, select, update

from app.store.database.keys import digest, new_code
from app.store.database.tables import exclusion, invitation, participant, session
from app.store.participants.exclusions import AGAIN, in_force


@dataclass(frozen=True)
class Invitation:
    """A code that lets participants in.

    Parameters
    ----------
    places : how many it lets in; None: any number; 0: previews only
    label : whom it is for, in the experimenter's words; empty: nobody in particular
    n_used : how many have begun with it
    is_for_one : whether it is for one person, who may have got a further place to take part again
    """

    id: int
    study_id: int
    code: str
    places: int | None
    label: str
    created_at: datetime
    n_used: int
    is_for_one: bool

    @property
    def is_named(self) -> bool:
        """Whether it has a label for one participant, which may name the person."""
        return self.is_for_one and self.label != ""

    @property
    def is_shared(self) -> bool:
        """Whether its link lets in whoever gets it; one person's is nobody else's."""
        return not (self.is_for_one or self.is_used)

    @property
    def is_used(self) -> bool:
        return not self.has_places(1)

    def has_places(self, n: int) -> bool:
        """Whether that many more participants may begin."""
        return self.places is None or self.n_used + n <= self.places


def insert_invitation(connection: Connection, study_id: int, places: int | None, now: datetime, label: str = "") -> str:
    """Make an invitation and return its code."""
    values = {"study_id": study_id, "code": new_code(), "places": places, "label": label, "created_at": now}
    connection.execute(insert(invitation).values(**values))
    return str(values["code"])


def label_invitation(connection: Connection, study_id: int, code: str, label: str) -> bool:
    """Say whom an invitation is for; returns whether the study has one with this code."""
    this = (invitation.c.study_id == study_id, invitation.c.code == code, invitation.c.places.is_distinct_from(0))
    return connection.execute(update(invitation).where(*this).values(label=label)).rowcount > 0


def preview_invitation(connection: Connection, study_id: int, now: datetime) -> int:
    """Return the id of the invitation that a study's previews belong to; it has no places and lets nobody in.

    The caller has locked the study, so that only one is made.
    """
    if (known := connection.scalar(_of_previews(study_id).with_only_columns(invitation.c.id))) is not None:
        return int(known)
    code = insert_invitation(connection, study_id, 0, now)
    return int(connection.execute(select(invitation.c.id).where(invitation.c.code == code)).scalar_one())


def preview_code(connection: Connection, study_id: int) -> str:
    """Return the code of the invitation that a study's previews belong to; it exists once a preview has begun."""
    return str(connection.execute(_of_previews(study_id).with_only_columns(invitation.c.code)).scalar_one())


def _of_previews(study_id: int) -> Select[Any]:
    """Return the first preview invitation; databases of older versions may hold several."""
    is_preview = (invitation.c.study_id == study_id) & (invitation.c.places == 0)
    return select(invitation).where(is_preview).order_by(invitation.c.id).limit(1)


def end_invitation(connection: Connection, study_id: int, code: str) -> bool:
    """Let nobody else in by an invitation; returns whether the study has one with this code."""
    row = connection.execute(
        _invitations().where(invitation.c.study_id == study_id, invitation.c.code == code)
    ).one_or_none()
    if row is None or row.places == 0:
        return False
    if row.n_used:
        connection.execute(update(invitation).where(invitation.c.id == row.id).values(places=row.n_used))
    else:
        connection.execute(delete(invitation).where(invitation.c.id == row.id))
    return True


def invitation_by_code(connection: Connection, code: str) -> Invitation | None:
    row = connection.execute(_invitations().where(invitation.c.code == code)).one_or_none()
    return Invitation(**row._mapping) if row else None


def invitation_of_session(connection: Connection, token: str) -> str | None:
    """Return the code of the invitation that a token's session began with."""
    query = select(invitation.c.code).select_from(session.join(participant).join(invitation))
    return connection.scalar(query.where(session.c.token_hash == digest(token)))


def invitations_of(connection: Connection, study_id: int) -> list[Invitation]:
    is_shown = (invitation.c.study_id == study_id) & invitation.c.places.is_distinct_from(0)
    rows = connection.execute(_invitations().where(is_shown).order_by(invitation.c.id))
    return [Invitation(**row._mapping) for row in rows]


def lets_in_one() -> ColumnElement[bool]:
    """SQL condition: the invitation is for one person, who has a further place each time they take part again."""
    anew = exists().where(in_force(participant.c.id), exclusion.c.reason == AGAIN).correlate(participant)
    theirs = participant.c.invitation_id == invitation.c.id
    n_anew = select(func.count(participant.c.id)).where(theirs, anew).correlate(invitation).scalar_subquery()
    return (invitation.c.places > 0) & (invitation.c.places <= 1 + n_anew)


def _invitations() -> Select[Any]:
    used = select(func.count()).where(participant.c.invitation_id == invitation.c.id).scalar_subquery()
    names = ("id", "study_id", "code", "places", "label", "created_at")
    is_for_one = func.coalesce(lets_in_one(), false())
    return select(*(invitation.c[name] for name in names), used.label("n_used"), is_for_one.label("is_for_one"))
