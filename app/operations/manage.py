"""Manage the study server from the command line: list, export and invite to studies, attach results, admit people."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from app.operations.attach import attach
from app.settings import Settings
from app.store import studies
from app.store.audit import COMMAND_LINE, Entry, record, record_alone
from app.store.engine import Database, open_database
from app.store.experimenters import Role, experimenter_named, renew_link, set_up_link
from app.store.invitations import insert_invitation, invitations_of
from app.store.keys import utc_now
from app.store.migrate import upgrade, why_not_ready
from app.store.orders import study_plan, taken_orders
from app.store.tokens import SCOPES, insert_token
from app.study.balance import balance_report
from app.study.options import parse_options
from app.study.study_file import StudyFile, write_study_file


def open_store(settings: Settings) -> Database:
    """Open the database; the embedded one is upgraded to the newest version first.

    Raises
    ------
    ValueError
        If another database is not at the newest version.
    """
    database = open_database(settings.url)
    if settings.is_embedded:
        upgrade(database)
    elif reason := why_not_ready(database):
        database.dispose()
        raise ValueError(reason)
    return database


@contextmanager
def opened_store(settings: Settings) -> Iterator[Database]:
    """Open the database while the block runs."""
    database = open_store(settings)
    try:
        yield database
    finally:
        database.dispose()


def upgrade_database(settings: Settings) -> dict[str, Any]:
    """Bring the database to the newest version."""
    database = open_database(settings.url)
    try:
        return {"version": upgrade(database)}
    finally:
        database.dispose()


def export_study(settings: Settings, slug: str) -> str:
    """Return a study as a study file, to be imported on another server beside its stimulus set."""
    with opened_store(settings) as database:
        study = _study(database, slug)
    return write_study_file(study_file_of(study))


def study_file_of(study: studies.Study) -> StudyFile:
    """Return the content of a study's file."""
    return StudyFile(
        name=study.name,
        manifest_sha256=study.manifest_sha256,
        exposure_s=study.exposure_s,
        seed=study.seed,
        options=parse_options(study.options),
    )


def study_balance(settings: Settings, slug: str) -> dict[str, Any]:
    """Report whether a study's orders follow from its seed and are balanced, see `balance_report`."""
    with opened_store(settings) as database:
        study = _study(database, slug)
        with database.reading() as connection:
            return balance_report(study_plan(connection, study), taken_orders(connection, study, utc_now()))


def list_studies(settings: Settings) -> list[dict[str, Any]]:
    """Return all studies with their progress and invitations, the newest first."""
    with opened_store(settings) as database, database.reading() as connection:
        listed = studies.all_studies(connection)
        progress = studies.progress_by_study(connection)  # read second: it then covers every study listed
        return [
            study_summary(study, progress[study.id])
            | {"invitations": [invitation.code for invitation in invitations_of(connection, study.id)]}
            for study in listed
        ]


def study_summary(study: studies.Study, progress: studies.StudyCounts) -> dict[str, Any]:
    """Return a study's name, state and progress, for lists."""
    return {
        "slug": study.slug,
        "name": study.name,
        "state": study.standing,
        "exposure_s": study.exposure_s,
        "created_at": study.created_at.isoformat(),
        **asdict(progress),
    }


def attach_results(
    settings: Settings, paths: Sequence[Path], slug: str | None = None, *, only: Sequence[str] = ()
) -> dict[str, Any]:
    """Attach reports of objective evaluation, and models, to a study; earlier ones of the same subject are replaced.

    Parameters
    ----------
    paths, only : as in `attach`
    slug : of the study; None: the only study there is

    Raises
    ------
    ValueError
        If a path cannot be read, none of its content is what the study compares, or the study is ambiguous.
    """
    with opened_store(settings) as database:
        study = _study(database, slug) if slug else _only_study(database)
        return attach(settings, database, study, paths, only=only, by=COMMAND_LINE, now=utc_now())


def add_invitation(settings: Settings, slug: str, *, places: int | None = None) -> dict[str, Any]:
    """Make an invitation for `places` participants, or without limit."""
    if places is not None and not 1 <= places <= 1_000_000:
        raise ValueError(f"{places} places: expected between 1 and 1000000")
    with opened_store(settings) as database:
        study = _study(database, slug)
        with database.writing() as connection:
            code = insert_invitation(connection, study.id, places, utc_now())
            record(connection, COMMAND_LINE, Entry("invitation made", study.id, detail={"places": places}), utc_now())
    return {"invitation": code, "path": f"/s/{code}"}


def add_experimenter(settings: Settings, name: str, role: Role | None = None) -> dict[str, Any]:
    """Make a sign-in link for an experimenter, added if new; an older link or password ends.

    Parameters
    ----------
    role : None: the present one, or owner
    """
    if not 1 <= len(name.strip()) <= 100:
        raise ValueError(f"{name!r}: expected a name of 1 to 100 characters")
    with opened_store(settings) as database:
        with database.reading() as connection:
            known = experimenter_named(connection, name.strip())
        password_ended = known is not None and known.has_password
        secret = renew_link(database, name.strip(), utc_now(), role)
        _note(database, "sign-in link made", name.strip(), password_ended=password_ended)
    return {"name": name.strip(), "path": f"/admin/login/{secret}", "password_ended": password_ended}


def set_up_path(settings: Settings) -> str | None:
    """Return the path where the first experimenter sets up the server, once; None when somebody has been added."""
    with opened_store(settings) as database:
        secret = set_up_link(database, utc_now())
    return None if secret is None else f"/admin/setup/{secret}"


def add_token(settings: Settings, name: str, scopes: Sequence[str] = tuple(SCOPES)) -> dict[str, Any]:
    """Make a bearer token that may read what its scopes name; it is shown only once."""
    if not 1 <= len(name.strip()) <= 100:
        raise ValueError(f"{name!r}: expected a name of 1 to 100 characters")
    with opened_store(settings) as database:
        with database.writing() as connection:
            token = insert_token(connection, name.strip(), scopes, COMMAND_LINE, utc_now())
        _note(database, "token made", name.strip(), scopes=list(scopes))
    return {"name": name.strip(), "token": token, "scopes": list(scopes)}


def add_own_token(settings: Settings, purpose: str) -> str:
    """Make a bearer token for this program's own use, named by purpose and time."""
    return str(add_token(settings, f"{purpose} {utc_now().isoformat(timespec='microseconds')}")["token"])


def _note(database: Database, action: str, subject: str, study_id: int | None = None, **detail: Any) -> None:
    record_alone(database, COMMAND_LINE, Entry(action, study_id, subject, detail), utc_now())


def _only_study(database: Database) -> studies.Study:
    with database.reading() as connection:
        there = studies.all_studies(connection)
    if len(there) != 1:
        names = ", ".join(study.slug for study in there) or "none"
        raise ValueError(f"there are several studies or none ({names}); say which is meant with --study")
    return there[0]


def _study(database: Database, slug: str) -> studies.Study:
    with database.reading() as connection:
        study = studies.study_by_slug(connection, slug)
    if study is None:
        raise ValueError(f"there is no study {slug!r}; `reconstudy study list` shows all")
    return study
