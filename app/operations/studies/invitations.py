"""Make and end a study's invitations: dashboard, REST and command line; the audit log says who did."""

from __future__ import annotations

from collections.abc import Sequence

from app.errors import NotFoundError
from app.store.database.engine import Database
from app.store.participants.invitations import end_invitation, insert_invitation, label_invitation
from app.store.studies.audit import Actor
from app.store.studies.studies import Study

MOST_AT_ONCE = 200
CODE_SHOWN = 8  # characters of a code that the audit log shows: a whole one lets people in


def make_invitations(
    database: Database, study: Study, places: int | None, labels: Sequence[str], actor: Actor
) -> set[str]:
    """Make an invitation for each label, and return their codes.

    Parameters
    ----------
    places : how many participants each lets in; None: any number
    labels : whom each is for, in the experimenter's words; empty: nobody in particular
    """
    with database.writing() as connection:
        codes = {insert_invitation(connection, study.id, places, actor.now, label) for label in labels}
        actor.note(connection, "invitations made", study, study.slug, number=len(labels), places=places)
    return codes


def name_invitation(database: Database, study: Study, code: str, label: str, actor: Actor) -> None:
    """Say whom an invitation is for.

    Raises
    ------
    NotFoundError
        If the study has none with this code.
    """
    with database.writing() as connection:
        if not label_invitation(connection, study.id, code, " ".join(label.split())):
            raise NotFoundError("This study has no such invitation.")
        actor.note(connection, "invitation labelled", study, code[:CODE_SHOWN])


def stop_invitation(database: Database, study: Study, code: str, actor: Actor) -> None:
    """Let nobody else in by an invitation.

    Raises
    ------
    NotFoundError
        If the study has none with this code.
    """
    with database.writing() as connection:
        if not end_invitation(connection, study.id, code):
            raise NotFoundError("This study has no such invitation.")
        actor.note(connection, "invitation ended", study, code[:CODE_SHOWN])
