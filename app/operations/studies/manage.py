"""Manage the study server from the command line: list, export and invite to studies, attach results, admit people."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from app.operations.database import open_store, study_named
from app.operations.studies.attach import attach
from app.operations.studies.create import duplicate_study
from app.operations.studies.invitations import make_invitations
from app.operations.studies.standing import change_standing, delete_study
from app.settings import Settings
from app.store.access.experimenters import all_experimenters, disable, experimenter_named, renew_link, set_up_link
from app.store.access.rights import READING, Role
from app.store.access.second_factors import end_second_factor
from app.store.access.tokens import Token, all_tokens, insert_token, revoke_token
from app.store.database.engine import Database, Transaction, open_database
from app.store.database.keys import utc_now
from app.store.database.migrate import upgrade
from app.store.participants.invitations import Invitation, invitations_of
from app.store.studies import studies
from app.store.studies.audit import COMMAND_LINE, Actor
from app.store.trials.orders import study_plan, taken_orders
from app.study.design.balance import balance_report
from app.study.options.options import parse_options
from app.study.options.platforms import link_path
from app.study.options.study_file import StudyFile, write_study_file
from app.study.planning import MOST_PLACES


def upgrade_database(settings: Settings) -> dict[str, Any]:
    """Bring the database to the newest version."""
    with open_database(settings.url) as database:
        return {"version": upgrade(database)}


def export_study(settings: Settings, slug: str) -> str:
    """Return a study as a study file, to be imported on another server beside its stimulus set."""
    with open_store(settings) as database:
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
    with open_store(settings) as database:
        study = _study(database, slug)
        with database.reading() as connection:
            return balance_report(study_plan(connection, study), taken_orders(connection, study, utc_now()))


def list_studies(settings: Settings) -> list[dict[str, Any]]:
    """Return all studies with their progress and invitations, the newest first."""
    with open_store(settings) as database, database.reading() as connection:
        listed = studies.all_studies(connection)
        progress = studies.progress_by_study(connection)  # read second: it then covers every study listed
        return [
            study_summary(study, progress[study.id]) | _invited(study, invitations_of(connection, study.id))
            for study in listed
        ]


def _invited(study: studies.Study, invitations: Sequence[Invitation]) -> dict[str, list[str]]:
    outside = parse_options(study.options).outside
    links = {each.code: link_path(each.code, outside) for each in invitations}
    shared = [links[each.code] for each in invitations if each.is_shared]
    return {"invitations": list(links), "links": list(links.values()), "shared_links": shared}


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
    with open_store(settings) as database:
        study = _study(database, slug) if slug else _only_study(database)
        return attach(settings, database, study, paths, only=only, by=COMMAND_LINE, now=utc_now())


def add_invitation(settings: Settings, slug: str, *, places: int | None = None) -> dict[str, Any]:
    """Make an invitation for `places` participants, or without limit."""
    if places is not None and not 1 <= places <= MOST_PLACES:
        raise ValueError(f"{places} places: expected between 1 and {MOST_PLACES}")
    with open_store(settings) as database:
        study = _study(database, slug)
        (code,) = make_invitations(database, study, places, [""], _operator())
    link = link_path(code, parse_options(study.options).outside)
    return {"invitation": code, "path": f"/s/{code}", "link": link}


def invitation_for(settings: Settings, slug: str, n_people: int) -> str:
    """Return the code of an invitation of a study that lets in so many more.

    Raises
    ------
    ValueError
        If there is no such study, or no such invitation.
    """
    with open_store(settings) as database:
        study = _study(database, slug)
        with database.reading() as connection:
            codes = [each.code for each in invitations_of(connection, study.id) if each.has_places(n_people)]
    if not codes:
        raise ValueError(
            f"no invitation of the study {slug!r} lets in {n_people} more; `reconstudy study invite {slug}` makes one"
        )
    return codes[0]


def add_experimenter(
    settings: Settings, name: str, role: Role | None = None, studies: Sequence[str] | None = None
) -> dict[str, Any]:
    """Make a sign-in link for an experimenter, added if new; an older link, password or second factor ends.

    Parameters
    ----------
    settings : of the server
    name : the experimenter's
    role : None: the present one, or owner
    studies : short names of the studies that they see; None: unchanged, or all
    """
    name = _checked_name(name)
    with open_store(settings) as database:
        with database.reading() as connection:
            known = experimenter_named(connection, name)
        password_ended = known is not None and known.has_password
        secret = renew_link(database, name, utc_now(), role, studies)
        with database.writing() as connection:
            if known is not None:
                end_second_factor(connection, known.id)
            _note(connection, "sign-in link made", name, password_ended=password_ended, studies=studies)
    return {"name": name, "path": f"/admin/login/{secret}", "password_ended": password_ended}


def set_up_path(settings: Settings) -> str | None:
    """Return the path where the first experimenter sets up the server, once; None when somebody has been added."""
    with open_store(settings) as database:
        secret = set_up_link(database, utc_now())
    return None if secret is None else f"/admin/setup/{secret}"


def add_token(
    settings: Settings,
    name: str,
    scopes: Sequence[str] = READING,
    studies: Sequence[str] | None = None,
    *,
    days: int | None = None,
) -> dict[str, Any]:
    """Make a bearer token that may do what its scopes name; it is shown only once.

    Parameters
    ----------
    settings : of the server
    name : whom or what it is for
    scopes : of SCOPES
    studies : short names of the studies that it opens; None: all
    days : until it ends; None: it is valid until it is revoked
    """
    name, now = _checked_name(name), utc_now()
    ends = None if days is None else now + timedelta(days=days)
    with open_store(settings) as database, database.writing() as connection:
        token = insert_token(connection, name, scopes, COMMAND_LINE, now, expires_at=ends, studies=studies)
        _note(connection, "token made", name, scopes=list(scopes), studies=studies)
    granted = {"scopes": list(scopes), "studies": studies, "expires_at": ends and ends.isoformat()}
    return {"name": name, "token": token, **granted}


def only_study(settings: Settings) -> str:
    """Return the short name of the only study there is.

    Raises
    ------
    ValueError
        If there is none, or more than one.
    """
    with open_store(settings) as database:
        return _only_study(database).slug


@contextmanager
def own_token(settings: Settings, purpose: str) -> Iterator[str]:
    """Make a bearer token for this program's own use, to read, named by purpose and time; it ends with the block."""
    name = f"{purpose} {utc_now():%Y-%m-%d %H:%M:%S.%f}"
    try:
        yield str(add_token(settings, name)["token"])
    finally:
        end_token(settings, name)


def list_tokens(settings: Settings) -> list[dict[str, Any]]:
    """Return all tokens, the newest first, without their secrets; `state` is valid, expired or revoked."""
    now = utc_now()
    with open_store(settings) as database, database.reading() as connection:
        known = all_tokens(connection)
    return [
        {
            "name": token.name,
            "scopes": list(token.scopes),
            "studies": token.studies,
            "state": _token_state(token, now),
            "created_by": token.created_by,
            "created_at": token.created_at.isoformat(),
            "expires_at": token.expires_at.isoformat() if token.expires_at else None,
        }
        for token in known
    ]


def _token_state(token: Token, now: datetime) -> str:
    if token.revoked_at is not None:
        return "revoked"
    return "valid" if token.expires_at is None or token.expires_at > now else "expired"


def end_token(settings: Settings, name: str) -> bool:
    """Revoke a token; returns whether it was valid until now.

    Raises
    ------
    ValueError
        If there is no token of this name.
    """
    with open_store(settings) as database, database.writing() as connection:
        if name not in {token.name for token in all_tokens(connection)}:
            raise ValueError(f"there is no token called {name!r}; `reconstudy token list` shows all")
        was_valid = revoke_token(connection, name, utc_now())
        if was_valid:
            _note(connection, "token revoked", name)
    return was_valid


def list_experimenters(settings: Settings) -> list[dict[str, Any]]:
    """Return all experimenters by name; `state` is signed up, invited (by a sign-in link) or removed."""
    with open_store(settings) as database, database.reading() as connection:
        known = all_experimenters(connection)
    return [
        {
            "name": person.name,
            "role": person.role,
            "studies": person.studies,
            "state": "removed" if person.is_disabled else "signed up" if person.has_password else "invited",
        }
        for person in known
    ]


def remove_experimenter(settings: Settings, name: str) -> None:
    """End an experimenter's access, sessions and tokens; the audit log keeps their name, a new link lets them in again.

    Raises
    ------
    ValueError
        If there is nobody of this name; ConflictError if nobody would be left who is an owner.
    """
    with open_store(settings) as database, database.writing() as connection:
        if experimenter_named(connection, name) is None:
            raise ValueError(f"there is no experimenter called {name!r}; `reconstudy admin list` shows all")
        tokens = disable(connection, name, utc_now())
        _note(connection, "access ended", name, tokens=tokens)


def change_study_standing(settings: Settings, slug: str, standing: studies.Standing) -> dict[str, Any]:
    """Open, pause, close or archive a study, as the dashboard does."""
    with open_store(settings) as database:
        study = _study(database, slug)
        change_standing(database, study, standing, _operator())
    return {"study": slug, "state": standing, "before": study.standing}


def copy_study(settings: Settings, slug: str, name: str) -> dict[str, Any]:
    """Duplicate a study by its short name, see `duplicate_study`."""
    with open_store(settings) as database:
        copy = duplicate_study(database, _study(database, slug), name, _operator())
    return {"study": copy, "duplicate_of": slug}


def remove_study(settings: Settings, slug: str) -> dict[str, Any]:
    """Delete a study for good, see `delete_study`."""
    with open_store(settings) as database:
        study = _study(database, slug)
        with database.reading() as connection:
            progress = studies.progress_of(connection, study.id)
        delete_study(database, study, _operator())
    return {"study": slug, "participants": progress.n_started, "votes": progress.n_votes}


def _checked_name(name: str) -> str:
    if not 1 <= len(name.strip()) <= 100:
        raise ValueError(f"{name!r}: expected a name of 1 to 100 characters")
    return name.strip()


def _operator() -> Actor:
    return Actor(0, COMMAND_LINE, utc_now())


def _note(connection: Transaction, action: str, subject: str, **detail: object) -> None:
    _operator().note(connection, action, None, subject, **detail)


def _only_study(database: Database) -> studies.Study:
    with database.reading() as connection:
        there = studies.all_studies(connection)
    if not there:
        raise ValueError("there is no study yet; `reconstudy study create` makes one")
    if len(there) > 1:
        names = ", ".join(study.slug for study in there)
        raise ValueError(f"there are several studies: {names}; say which is meant with --study")
    return there[0]


def _study(database: Database, slug: str) -> studies.Study:
    with database.reading() as connection:
        return study_named(connection, slug)
