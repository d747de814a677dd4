"""Notes on trials and tags on them, by experimenters who work at once, on either kind of database."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait

from sqlalchemy import Connection, select

from app.store.database.engine import Database
from app.store.database.tables import trial_comment
from app.store.participants.comments import CommentPlace, comment_records, keep_trial_comment, tag_comment
from tests.seeded_studies import NOW, seed_voters

WAIT_S = 0.5  # who waits for nobody is done long before


def at_once(database: Database, first: Callable[[Connection], None], second: Callable[[Connection], None]) -> None:
    """Let the second transaction begin while the first is open."""

    def come_second() -> None:
        with database.writing() as connection:
            second(connection)

    with ThreadPoolExecutor(1) as pool:
        with database.writing() as connection:
            first(connection)
            other = pool.submit(come_second)
            wait([other], WAIT_S)
        other.result()


def test_two_who_note_something_on_a_trial_at_once_are_both_answered(database: Database) -> None:
    (trial_id, _), *_ = seed_voters(database, 1, 2)[0].trials
    at_once(
        database,
        lambda connection: keep_trial_comment(connection, 1, trial_id, "first", "Ada", NOW),
        lambda connection: keep_trial_comment(connection, 1, trial_id, "second", "Eva", NOW),
    )
    with database.reading() as connection:
        assert connection.scalars(select(trial_comment.c.comment)).all() == ["second"]


def test_two_who_give_comments_the_same_new_tag_at_once_are_both_answered(database: Database) -> None:
    (first, _), (second, _), *_ = seed_voters(database, 1, 3)[0].trials

    def tag(connection: Connection, trial_id: str) -> None:
        tag_comment(connection, 1, CommentPlace("P001", "trial", trial_id), "blur", "Ada", NOW)

    with database.writing() as connection:
        for trial_id in (first, second):
            keep_trial_comment(connection, 1, trial_id, "It is blurred.", "Ada", NOW)
    at_once(database, lambda connection: tag(connection, first), lambda connection: tag(connection, second))
    with database.reading() as connection:
        assert [row["tags"] for row in comment_records(connection, 1)] == [["blur"], ["blur"]]
