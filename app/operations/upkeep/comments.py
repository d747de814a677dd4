"""Note comments on trials, and code a study's comments by tags: dashboard and REST; the audit log says who did."""

from __future__ import annotations

from app.errors import ConflictError, InvalidError
from app.store.database.engine import Database
from app.store.participants.comments import (
    LONGEST_COMMENT,
    CommentPlace,
    add_tag,
    delete_tag,
    keep_trial_comment,
    rename_tag,
    tag_comment,
    tag_names,
    trial_comment_of,
    untag_comment,
)
from app.store.studies.audit import Actor
from app.store.studies.studies import Study


def new_tag(database: Database, study: Study, tag: str, actor: Actor) -> None:
    """Add a tag to a study; ConflictError if it has it already."""
    name = _in_one_line(tag)
    with database.writing() as connection:
        add_tag(connection, study.id, name, actor.now)
        actor.note(connection, "tag added", study, name)


def keep_tag(database: Database, study: Study, tag: str, actor: Actor) -> None:
    """Add a tag to a study that may have it already."""
    with database.reading() as connection:
        known = tag_names(connection, study.id)
    if _in_one_line(tag) not in known:
        new_tag(database, study, tag, actor)


def call_tag(database: Database, study: Study, tag: str, new: str, actor: Actor) -> None:
    """Give a tag another name; its comments keep it."""
    name = _in_one_line(new)
    with database.writing() as connection:
        rename_tag(connection, study.id, tag, name)
        actor.note(connection, "tag renamed", study, tag, new=name)


def remove_tag(database: Database, study: Study, tag: str, actor: Actor) -> None:
    """Delete a tag, which nothing brings back onto its comments."""
    with database.writing() as connection:
        delete_tag(connection, study.id, tag)
        actor.note(connection, "tag deleted", study, tag)


def put_tag(database: Database, study: Study, place: CommentPlace, tag: str, actor: Actor) -> None:
    """Give a comment a tag, which is added to the study if it is new."""
    with database.writing() as connection:
        tag_comment(connection, study.id, place, _in_one_line(tag), actor.name, actor.now)
        actor.note(connection, "comment tagged", study, place.participant)  # not the tag: the log outlives an erasure


def take_tag_off(database: Database, study: Study, place: CommentPlace, tag: str, actor: Actor) -> None:
    """Take a tag off a comment."""
    with database.writing() as connection:
        untag_comment(connection, study.id, place, tag)
        actor.note(connection, "tag taken off", study, place.participant)


def note_on_trial(
    database: Database, study: Study, trial: str, comment: str, actor: Actor, seen: str | None = None
) -> None:
    """Note what was said or seen at a trial; an empty text deletes the note.

    Parameters
    ----------
    seen : the note as a page showed it; None: it is replaced, whatever it is

    Raises
    ------
    InvalidError
        If it is too long.
    ConflictError
        If somebody else has noted something meanwhile.
    """
    if len(comment) > LONGEST_COMMENT:
        raise InvalidError(f"The comment is longer than {LONGEST_COMMENT} characters. Nothing was kept.")
    if seen == comment:
        return
    with database.writing() as connection:
        kept = trial_comment_of(connection, trial)
        if seen is not None and (kept.comment if kept else "") not in (seen, comment):
            raise ConflictError("Somebody else has noted something on this trial meanwhile. Nothing was kept.")
        keep_trial_comment(connection, study.id, trial, comment, actor.name, actor.now)
        actor.note(connection, "trial commented on", study, trial)


def _in_one_line(name: str) -> str:
    if not (tidy := " ".join(name.split())):
        raise InvalidError("A tag needs a name. Nothing was changed.")
    return tidy
