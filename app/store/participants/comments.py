"""Collect the comments of a study (free answers, notes on interviews and trials), and keep the tags that code them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Literal, get_args

from sqlalchemy import ColumnElement, Connection, Row, Select, delete, func, insert, null, select, update

from app.errors import ConflictError, NotFoundError
from app.store.database.engine import insert_or_ignore
from app.store.database.tables import (
    assignment,
    comment_tag,
    comment_tagging,
    dataset,
    pair,
    participant,
    session,
    spoken_answer,
    stage_record,
    study,
    trial,
    trial_comment,
)
from app.store.participants.exclusions import COUNTING, counting, takes_part_in
from app.store.participants.participants import check_not_erased
from app.study.options.options import parse_options
from app.study.options.wording import asked_questions
from app.study.stages import INTERVIEW

Source = Literal["written", "spoken", "trial"]
SOURCES: tuple[Source, ...] = get_args(Source)
LONGEST_COMMENT = 2000  # characters of a note on a trial
LONGEST_TAG = 60
MOST_TAGS = 200  # of a study


@dataclass(frozen=True)
class SoughtComments:
    """Which comments to find.

    Parameters
    ----------
    text : part of the comment, in any case; empty: any
    source : one of SOURCES; anything else: any
    tag : a tag's name; empty: any
    participant : a label; empty: any
    is_untagged : only those without a tag
    """

    text: str = ""
    source: str = ""
    tag: str = ""
    participant: str = ""
    is_untagged: bool = False

    def fits(self, row: Mapping[str, Any]) -> bool:
        """Say whether a row of `comment_records` is sought."""
        return (
            self.text.casefold() in row["comment"].casefold()
            and (self.source not in SOURCES or row["source"] == self.source)
            and (not self.tag or self.tag in row["tags"])
            and (not self.participant or row["participant"] == self.participant)
            and not (self.is_untagged and row["tags"])
        )


EVERY_COMMENT = SoughtComments()


def comment_records(
    connection: Connection, study_id: int, sought: SoughtComments = EVERY_COMMENT
) -> list[dict[str, Any]]:
    """Return a row for each comment, in order of the participants' arrival: written, spoken, then on trials."""
    tags = _tags_by_comment(connection, study_id)
    people = takes_part_in(study_id)
    if sought.participant:
        people &= participant.c.label == sought.participant
    comments = [*_written(connection, study_id, people), *_spoken(connection, people), *_on_trials(connection, people)]
    comments.sort(key=lambda row: row["slot"])
    rows = (row | {"tags": tags.get((row["session_id"], row["source"], row["subject"]), [])} for row in comments)
    return [row for row in rows if sought.fits(row)]


def tag_records(
    connection: Connection, study_id: int, comments: Sequence[Mapping[str, Any]] | None = None
) -> list[dict[str, Any]]:
    """Return a study's tags by name, with how many comments bear each, and of how many participants.

    Parameters
    ----------
    comments : all of the study, as `comment_records` returns them; None: they are read
    """
    by_tag: dict[str, list[str]] = {name: [] for name in _tag_ids(connection, study_id)}
    for row in comment_records(connection, study_id) if comments is None else comments:
        for tag in row["tags"]:
            by_tag[tag].append(row["participant"])
    return [
        {"tag": tag, "n_comments": len(people), "n_participants": len(set(people))} for tag, people in by_tag.items()
    ]


def tag_names(connection: Connection, study_id: int) -> list[str]:
    """Return a study's tags in alphabetical order."""
    return list(_tag_ids(connection, study_id))


def add_tag(connection: Connection, study_id: int, name: str, now: datetime) -> None:
    """Add a tag to a study.

    Raises
    ------
    ConflictError
        If the study has it, or has too many.
    """
    known = _tag_ids(connection, study_id)
    if name in known:
        raise ConflictError(f"This study has the tag {name} already.")
    if len(known) >= MOST_TAGS:
        raise ConflictError(f"This study has {MOST_TAGS} tags already, which is the most. Delete one first.")
    row = {"study_id": study_id, "name": name, "created_at": now}
    insert_or_ignore(connection, comment_tag, [row], comment_tag.c.id)  # somebody may be adding it, too


def rename_tag(connection: Connection, study_id: int, name: str, new: str) -> None:
    """Rename a tag; its comments keep it.

    Raises
    ------
    NotFoundError
        If the study has no such tag.
    ConflictError
        If another tag is called so.
    """
    if new != name and new in _tag_ids(connection, study_id):
        raise ConflictError(f"This study has the tag {new} already.")
    changed = connection.execute(
        update(comment_tag).where(comment_tag.c.id == _tag_id(connection, study_id, name)).values(name=new)
    )
    assert changed.rowcount == 1


def delete_tag(connection: Connection, study_id: int, name: str) -> None:
    """Delete a tag, and take it off its comments.

    Raises
    ------
    NotFoundError
        If the study has no such tag.
    """
    tag_id = _tag_id(connection, study_id, name)
    connection.execute(delete(comment_tagging).where(comment_tagging.c.comment_tag_id == tag_id))
    connection.execute(delete(comment_tag).where(comment_tag.c.id == tag_id))


@dataclass(frozen=True)
class CommentPlace:
    """Which comment of a study is meant.

    Parameters
    ----------
    participant : the label
    source : where it was given
    subject : name of the question, the spoken question, or id of the trial
    """

    participant: str
    source: Source
    subject: str


def tag_comment(connection: Connection, study_id: int, place: CommentPlace, name: str, by: str, now: datetime) -> None:
    """Tag a comment; a tag that the study does not have yet is added. Done again, it changes nothing.

    Raises
    ------
    NotFoundError
        If there is no such comment.
    ConflictError
        If the study has too many tags.
    """
    session_id = _session_of(connection, study_id, place)
    if name not in _tag_ids(connection, study_id):
        add_tag(connection, study_id, name, now)
    values = {
        "session_id": session_id,
        "comment_tag_id": _tag_id(connection, study_id, name),
        "source": place.source,
        "subject": place.subject,
        "tagged_by": by,
        "tagged_at": now,
    }
    insert_or_ignore(connection, comment_tagging, [values], comment_tagging.c.id)


def untag_comment(connection: Connection, study_id: int, place: CommentPlace, name: str) -> None:
    """Take a tag off a comment.

    Raises
    ------
    NotFoundError
        If there is no such comment or tag.
    """
    session_id = _session_of(connection, study_id, place)
    connection.execute(
        delete(comment_tagging).where(
            comment_tagging.c.session_id == session_id,
            comment_tagging.c.source == place.source,
            comment_tagging.c.subject == place.subject,
            comment_tagging.c.comment_tag_id == _tag_id(connection, study_id, name),
        )
    )


def keep_trial_comment(
    connection: Connection, study_id: int, trial_id: str, comment: str, experimenter: str, now: datetime
) -> None:
    """Store what was said or seen at a trial; a later text replaces it, an empty one deletes it with its tags.

    Raises
    ------
    NotFoundError
        If the study has no such trial.
    InvalidError
        If its participant was erased.
    """
    row = connection.execute(
        select(trial.c.id, trial.c.session_id, session.c.participant_id)
        .select_from(trial.join(session).join(participant))
        .where(takes_part_in(study_id), trial.c.public_id == trial_id)
    ).one_or_none()
    if row is None:
        raise NotFoundError("This study has no such trial.")
    check_not_erased(connection, row.participant_id)
    values = {"comment": comment, "experimenter": experimenter, "written_at": now}
    this = trial_comment.c.trial_id == row.id
    if not comment:
        tagged = (comment_tagging.c.source == "trial", comment_tagging.c.subject == trial_id)
        connection.execute(delete(comment_tagging).where(comment_tagging.c.session_id == row.session_id, *tagged))
        connection.execute(delete(trial_comment).where(this))
    elif not connection.execute(update(trial_comment).where(this).values(**values)).rowcount:
        connection.execute(insert(trial_comment).values(session_id=row.session_id, trial_id=row.id, **values))


def trial_comment_of(connection: Connection, trial_id: str) -> Row[Any] | None:
    """Return the comment on a trial, with who noted it and when; None: there is none."""
    query = select(trial_comment).select_from(trial_comment.join(trial)).where(trial.c.public_id == trial_id)
    return connection.execute(query).one_or_none()


def _written(connection: Connection, study_id: int, people: ColumnElement[bool]) -> Iterator[dict[str, Any]]:
    options = connection.execute(select(study.c.options).where(study.c.id == study_id)).scalar_one()
    asked = {
        name: each.text
        for name, each in asked_questions(parse_options(options)).items()
        if each.question.kind == "text"
    }
    rows = _of_people(
        stage_record.c.data, stage_record.c.completed_at.label("written_at"), null().label("experimenter")
    ).join(stage_record)
    for row in connection.execute(rows.where(people, stage_record.c.stage == INTERVIEW)):
        answers = row.data.get("answers", {})
        for name, text in asked.items():
            if isinstance(comment := answers.get(name), str) and comment.strip():
                yield _row(row, "written", name, text, comment)


def _spoken(connection: Connection, people: ColumnElement[bool]) -> Iterator[dict[str, Any]]:
    rows = (
        _of_people(
            spoken_answer.c.question,
            spoken_answer.c.answer,
            spoken_answer.c.experimenter,
            spoken_answer.c.written_at,
        )
        .join(spoken_answer)
        .where(people, spoken_answer.c.answer != "")
        .order_by(spoken_answer.c.id)
    )
    for row in connection.execute(rows):
        yield _row(row, "spoken", row.question, row.question, row.answer)


def _on_trials(connection: Connection, people: ColumnElement[bool]) -> Iterator[dict[str, Any]]:
    rows = (
        _of_people(
            trial_comment.c.comment,
            trial_comment.c.experimenter,
            trial_comment.c.written_at,
            trial.c.public_id.label("trial"),
            assignment.c.position,
            dataset.c.name.label("dataset"),
        )
        .join(trial_comment, trial_comment.c.session_id == session.c.id)
        .join(trial, trial.c.id == trial_comment.c.trial_id)
        .join(assignment, assignment.c.id == trial.c.assignment_id)
        .join(pair, pair.c.id == assignment.c.pair_id)
        .join(dataset, dataset.c.id == pair.c.dataset_id)
        .where(people)
        .order_by(assignment.c.position, trial.c.attempt)
    )
    for row in connection.execute(rows):
        question = f"Trial {row.position + 1}, {row.dataset}"
        yield _row(row, "trial", row.trial, question, row.comment) | {"trial": row.trial, "dataset": row.dataset}


def _of_people(*columns: Any) -> Select[Any]:
    """Select columns beside their participant; the caller joins the tables of these columns to the session."""
    people = (participant.c.label.label("participant"), participant.c.slot, session.c.id.label("session_id"))
    return select(*people, *COUNTING, *columns).select_from(participant).join(session)


def _row(row: Row[Any], source: Source, subject: str, question: str, comment: str) -> dict[str, Any]:
    return {
        "participant": row.participant,
        "slot": row.slot,
        "session_id": row.session_id,
        "source": source,
        "subject": subject,
        "question": question,
        "comment": comment,
        "written_at": row.written_at,
        "experimenter": row.experimenter,
        "trial": None,
        "dataset": None,
        **counting(row),
    }


def _tags_by_comment(connection: Connection, study_id: int) -> dict[tuple[int, str, str], list[str]]:
    rows = connection.execute(
        select(comment_tagging.c.session_id, comment_tagging.c.source, comment_tagging.c.subject, comment_tag.c.name)
        .select_from(comment_tagging.join(comment_tag))
        .where(comment_tag.c.study_id == study_id)
        .order_by(func.lower(comment_tag.c.name))
    )
    tags: dict[tuple[int, str, str], list[str]] = defaultdict(list)
    for session_id, source, subject, name in rows:
        tags[session_id, source, subject].append(name)
    return tags


def _tag_ids(connection: Connection, study_id: int) -> dict[str, int]:
    """Return the ids of a study's tags by name, in alphabetical order."""
    rows = select(comment_tag.c.name, comment_tag.c.id).where(comment_tag.c.study_id == study_id)
    return {row.name: row.id for row in connection.execute(rows.order_by(func.lower(comment_tag.c.name)))}


def _tag_id(connection: Connection, study_id: int, name: str) -> int:
    tag_id = _tag_ids(connection, study_id).get(name)
    if tag_id is None:
        raise NotFoundError("This study has no such tag.")
    return tag_id


def _session_of(connection: Connection, study_id: int, place: CommentPlace) -> int:
    """Return the session of a comment, which must be there."""
    sought = SoughtComments(source=place.source, participant=place.participant)
    for row in comment_records(connection, study_id, sought):
        if row["subject"] == place.subject:
            return int(row["session_id"])
    raise NotFoundError("This study has no such comment; it may have been erased or changed meanwhile.")
