"""People from recruiting platforms: their outside ids, which stay apart from scores and votes, and completion codes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, insert, select, update

from app.store.database.keys import new_code
from app.store.database.tables import invitation, participant, recruit, session
from app.store.participants.exclusions import takes_part_in
from app.study.options.recruiting import Arrival, OutsideOptions
from app.study.stages import ENDS

EARLIER = "#"  # after an outside id, before the label of whom it belonged to; no id holds it
LONGEST_ID = 55  # characters of an id that are kept before


@dataclass(frozen=True)
class Recruit:
    """How a participant came, and the completion code made for them, empty where the study makes none."""

    outside_id: str | None
    kept: Mapping[str, str]
    completion_code: str

    @property
    def arrival(self) -> Arrival | None:
        return Arrival(self.outside_id, self.kept) if self.outside_id is not None else None


def insert_recruit(
    connection: Connection, study_id: int, participant_id: int, arrival: Arrival | None, options: OutsideOptions
) -> None:
    """Keep how a participant came, and make a completion code where the study has random ones."""
    values = {
        "outside_id": arrival.outside_id if arrival else None,
        "kept": dict(arrival.kept) if arrival else {},
        "completion_code": new_code() if options.random_codes else "",
    }
    connection.execute(insert(recruit).values(study_id=study_id, participant_id=participant_id, **values))


def renew_visit(connection: Connection, session_id: int, arrival: Arrival) -> None:
    """Keep the parameters of somebody's last visit: MTurk's assignment is another one each time."""
    participants = select(session.c.participant_id).where(session.c.id == session_id).scalar_subquery()
    connection.execute(update(recruit).where(recruit.c.participant_id == participants).values(kept=dict(arrival.kept)))


def let_in_again(connection: Connection, participant_id: int, label: str) -> None:
    """Let somebody begin anew, by the same invitation or outside id, in any browser: what they began is theirs no more.

    The outside id stays with what they began, marked by its label, so that whoever pays can tell both.
    """
    name = connection.execute(
        select(session.c.public_id).where(session.c.participant_id == participant_id)
    ).scalar_one()
    gone = {"token_hash": f"-{name}", "resume_hash": f"-{name}", "begin_hash": None}
    connection.execute(update(session).where(session.c.participant_id == participant_id).values(**gone))
    is_theirs = recruit.c.participant_id == participant_id
    outside_id = connection.scalar(select(recruit.c.outside_id).where(is_theirs))
    if outside_id is not None and EARLIER not in outside_id:
        earlier = f"{outside_id[:LONGEST_ID]}{EARLIER}{label}"
        connection.execute(update(recruit).where(is_theirs).values(outside_id=earlier))
    theirs = select(participant.c.invitation_id).where(participant.c.id == participant_id).scalar_subquery()
    this = (invitation.c.id == theirs, invitation.c.places.is_not(None))
    connection.execute(update(invitation).where(*this).values(places=invitation.c.places + 1))


def renew_codes(connection: Connection, study_id: int, options: OutsideOptions) -> None:
    """Give everybody under way a random completion code where their study makes some now, and take it where not."""
    rows = connection.execute(
        select(participant.c.id, recruit.c.completion_code)
        .select_from(participant.join(session).outerjoin(recruit, recruit.c.participant_id == participant.c.id))
        .where(takes_part_in(study_id), session.c.stage.not_in(ENDS))
    )
    for participant_id, code in rows.all():
        if code is None and options.random_codes:
            insert_recruit(connection, study_id, participant_id, None, options)
        elif code is not None and bool(code) != options.random_codes:
            this = recruit.c.participant_id == participant_id
            changed = new_code() if options.random_codes else ""
            connection.execute(update(recruit).where(this).values(completion_code=changed))


def recruit_of_session(connection: Connection, session_id: int) -> Recruit | None:
    """Return how a session's participant came; None for previews, and in studies that keep nothing of it."""
    participant_id = connection.execute(select(session.c.participant_id).where(session.c.id == session_id)).scalar_one()
    return recruit_of(connection, participant_id)


def recruit_of(connection: Connection, participant_id: int) -> Recruit | None:
    """Return how a participant came, as `recruit_of_session`."""
    query = select(recruit.c.outside_id, recruit.c.kept, recruit.c.completion_code)
    row = connection.execute(query.where(recruit.c.participant_id == participant_id)).one_or_none()
    return Recruit(**row._mapping) if row else None


def session_of_outside_id(connection: Connection, study_id: int, outside_id: str) -> int | None:
    """Return the id of the session that somebody with this outside id began in a study; None if nobody did."""
    query = select(session.c.id).select_from(recruit.join(participant).join(session))
    return connection.scalar(query.where(recruit.c.study_id == study_id, recruit.c.outside_id == outside_id))


def outside_ids_of(connection: Connection, study_id: int, labels: Sequence[str]) -> dict[str, str]:
    """Return the outside ids of some participants of a study, by label; who came without one is left out."""
    rows = connection.execute(
        select(participant.c.label, recruit.c.outside_id)
        .select_from(recruit.join(participant))
        .where(recruit.c.study_id == study_id, recruit.c.outside_id.is_not(None), participant.c.label.in_(labels))
    )
    return {row.label: row.outside_id for row in rows}


def recruit_records(connection: Connection, study_id: int, fixed_code: str) -> list[dict[str, Any]]:
    """Return everybody's outside id, state and completion code, in order of arrival, to pay them by."""
    rows = connection.execute(
        select(participant.c.label, recruit.c.outside_id, session.c.stage, recruit.c.completion_code)
        .select_from(recruit.join(participant).join(session))
        .where(takes_part_in(study_id))
        .order_by(participant.c.slot)
    )
    return [
        {"participant": label, "outside_id": outside_id, "state": stage, "completion_code": code or fixed_code}
        for label, outside_id, stage, code in rows
    ]
