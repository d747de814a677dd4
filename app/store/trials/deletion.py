"""Delete what a participant gave, what a study's participants gave at the end of their time, previews, or a study."""

from __future__ import annotations

from collections.abc import Collection
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, Select, delete, select, update

from app.errors import ConflictError
from app.store.database.belonging import People, rows_of_people, rows_of_study
from app.store.database.schema import metadata
from app.store.database.tables import (
    assignment,
    audit_entry,
    comment_tag,
    comment_tagging,
    exclusion,
    invitation,
    participant,
    session,
    study,
    trial,
    vote,
)
from app.store.participants.invitations import lets_in_one
from app.store.participants.participants import Person, withdraw_participant
from app.store.studies.studies import Study, all_studies, change_reach
from app.study.options.options import parse_options
from app.study.options.privacy import forgets_at
from app.study.stages import ENDS, TIMED_OUT

ERASED = "erased"  # in the place of a reason
EXCLUDED = "participant excluded"  # as the audit log calls it, of which older entries hold the reason
# Their rows say that somebody came and what was shown, nothing about the person.
KEPT_AT_ERASURE = (participant, session, assignment, trial, exclusion)


def erase(connection: Connection, person: Person, now: datetime) -> None:
    """Delete a participant's votes, answers and screening for good. Label and slot stay, so that orders balance.

    That they were excluded stays too, without the reason, which may tell of the person. So may the label of an
    invitation that let in this participant alone, and a tag that only their comments bore: both go.

    Raises
    ------
    ConflictError
        If they were erased before.
    """
    this = (participant.c.id == person.id, participant.c.erased_at.is_(None))
    # first, as it locks their row: nobody keeps a note meanwhile
    if not connection.execute(update(participant).where(*this).values(erased_at=now)).rowcount:
        raise ConflictError(f"{person.label} was erased before.")
    withdraw_participant(connection, person, now)
    by_name = select(participant.c.invitation_id).where(participant.c.id == person.id).scalar_subquery()
    connection.execute(update(invitation).where(invitation.c.id == by_name, lets_in_one()).values(label=""))
    _delete_words_of(connection, [person.id], KEPT_AT_ERASURE)
    _end_access(connection, [person.id])
    _take_reasons(connection, [person.id])
    sessions = select(session.c.id).where(session.c.participant_id == person.id)
    connection.execute(update(trial).where(trial.c.session_id.in_(sessions)).values(void_viewing=None))


def studies_to_forget(connection: Connection, now: datetime) -> list[Study]:
    """Return the studies that have kept personal data for as long as they may, since they last ended."""
    ends = [(each, forgets_at(parse_options(each.options), each.closed_at)) for each in all_studies(connection)]
    return [
        each
        for each, end in ends
        if end is not None and end <= now and (each.forgotten_at is None or each.forgotten_at < end)
    ]


def forget_people(connection: Connection, study_id: int, now: datetime) -> None:
    """Delete all that a study's participants gave but their votes, and what leads from the votes to a person.

    Answers, screening, notes and tags, outside ids, names on invitations and reasons of exclusions go; labels, votes
    and that somebody is excluded stay.
    Nobody's link or code leads to a session any more.

    Parameters
    ----------
    connection : of a writing transaction
    study_id : whose participants are meant
    now : the time
    """
    people = select(participant.c.id).where(participant.c.study_id == study_id)
    _delete_words_of(connection, people, (*KEPT_AT_ERASURE, vote))
    _end_access(connection, people)
    _take_reasons(connection, people)
    is_open = (session.c.participant_id.in_(people), session.c.stage.not_in(ENDS))
    connection.execute(update(session).where(*is_open).values(stage=TIMED_OUT))
    connection.execute(update(invitation).where(invitation.c.study_id == study_id).values(label=""))
    connection.execute(update(study).where(study.c.id == study_id).values(forgotten_at=now))


def forget_preview_votes(connection: Connection, study_id: int) -> None:
    """Delete the votes and answers of a study's previews."""
    _delete_given(connection, _previews(study_id), KEPT_AT_ERASURE)


def delete_previews(connection: Connection, study_id: int) -> None:
    """Delete a study's previews with their trials, so that the pairs can go that they show."""
    _delete_given(connection, list(connection.scalars(_previews(study_id))))


def delete_study(connection: Connection, study_id: int) -> None:
    """Delete a study's rows from all tables; entries of the audit log stay, as of no study.

    Who may see it is no longer said, lest another study of its name be seen.
    """
    slug = connection.execute(select(study.c.slug).where(study.c.id == study_id)).scalar_one()
    change_reach(connection, slug, [])
    connection.execute(update(audit_entry).where(audit_entry.c.study_id == study_id).values(study_id=None))
    tables = list(reversed(metadata.sorted_tables))  # referring rows first
    tables.sort(key=lambda table: "of_media" not in table.c)  # films of pairs first: no reference puts them in order
    for table in tables:
        if table is not audit_entry and (belongs := rows_of_study(table, study_id)) is not None:
            connection.execute(delete(table).where(belongs))


def _previews(study_id: int) -> Select[Any]:
    return select(participant.c.id).where(participant.c.study_id == study_id, participant.c.is_preview.is_(True))


def _delete_given(connection: Connection, people: People, kept: Collection[Any] = ()) -> None:
    """Delete the rows of participants from all tables but some, referring rows first."""
    for table in reversed(metadata.sorted_tables):
        if table not in kept and (belongs := rows_of_people(table, people)) is not None:
            connection.execute(delete(table).where(belongs))


def _delete_words_of(connection: Connection, people: People, kept: Collection[Any]) -> None:
    """Delete what participants gave, and the tags that no comment of others bears."""
    theirs = select(session.c.id).where(session.c.participant_id.in_(people))
    tags = set(
        connection.scalars(select(comment_tagging.c.comment_tag_id).where(comment_tagging.c.session_id.in_(theirs)))
    )
    _delete_given(connection, people, kept)
    borne = select(comment_tagging.c.comment_tag_id)
    connection.execute(delete(comment_tag).where(comment_tag.c.id.in_(tags), comment_tag.c.id.not_in(borne)))


def _take_reasons(connection: Connection, people: People) -> None:
    """Delete why people were excluded, also from entries of the audit log that say so."""
    connection.execute(update(exclusion).where(exclusion.c.participant_id.in_(people)).values(reason=ERASED))
    studies_labels = select(participant.c.study_id, participant.c.label).where(participant.c.id.in_(people))
    for study_id, label in connection.execute(studies_labels).all():
        theirs = (audit_entry.c.study_id == study_id, audit_entry.c.subject == label, audit_entry.c.action == EXCLUDED)
        connection.execute(update(audit_entry).where(*theirs).values(detail={}))


def _end_access(connection: Connection, people: People) -> None:
    """Let nobody's token, code or key lead to a session of the participants any more."""
    nobodys: dict[str, Any] = {"token_hash": "-" + session.c.public_id, "resume_hash": "-" + session.c.public_id}
    theirs = session.c.participant_id.in_(people)
    connection.execute(update(session).where(theirs).values(**nobodys, begin_hash=None))
