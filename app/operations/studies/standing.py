"""Change where a study stands, or its address, or delete it: from the dashboard, over REST or from the command line."""

from __future__ import annotations

from app.errors import ConflictError
from app.operations.studies.check_films import check_file
from app.operations.studies.create import slugify
from app.settings import Settings
from app.store.database.engine import Database
from app.store.studies.audit import Actor
from app.store.studies.film_failures import settle_failures
from app.store.studies.studies import Standing, Study, give_address, lock_study, progress_of, set_standing
from app.store.trials import deletion


def change_standing(database: Database, study: Study, standing: Standing, actor: Actor) -> None:
    """Open, pause, close or archive a study; nothing happens if it is so already."""
    if study.standing == standing:
        return
    with database.writing() as connection:
        set_standing(connection, study.id, standing, actor.now)
        if standing == "open":
            settle_failures(connection, study.id, actor.now)  # else the rule would pause it again at once
        actor.note(connection, f"study {standing}", study, study.slug, before=study.standing)


def give_new_address(settings: Settings, database: Database, study: Study, actor: Actor) -> str:
    """Give a study that was renamed the address of its name, and return the slug. Participants' links stay.

    Raises
    ------
    ConflictError
        If another study has this address.
    """
    slug = slugify(study.name)
    if slug == study.slug:
        return slug
    with database.writing() as connection:
        give_address(connection, study, slug)
        actor.note(connection, "study address changed", study, slug, before=study.slug)
    known = check_file(settings, study.slug)
    if known.is_file():
        known.rename(check_file(settings, slug))
    return slug


def delete_study(database: Database, study: Study, actor: Actor) -> None:
    """Delete a study for good, with all that was given in it; the audit log keeps what was done, and films stay.

    Raises
    ------
    ConflictError
        If somebody has begun, and the study is not archived.
    """
    with database.writing() as connection:
        now = lock_study(connection, study.id)
        progress = progress_of(connection, study.id)
        if progress.n_started and now.standing != "archived":
            raise ConflictError(
                f"Begun in this study: {progress.n_started}. Archive it first, then delete it; nothing was deleted."
            )
        deletion.delete_study(connection, study.id)
        actor.note(
            connection, "study deleted", None, study.slug, participants=progress.n_started, votes=progress.n_votes
        )
    database.shred_deleted()
