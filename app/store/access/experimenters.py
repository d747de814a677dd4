"""Keep experimenters: accounts, roles, sign-in links, passwords and sessions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

from sqlalchemy import ColumnElement, Connection, Row, and_, delete, exists, func, insert, or_, select, update

from app.errors import ConflictError, NotFoundError
from app.store.access.rights import ROLES, Role
from app.store.database.engine import Database
from app.store.database.keys import digest, new_secret
from app.store.database.tables import api_token, experimenter, experimenter_session, study

LINK_LASTS = timedelta(hours=24)
SESSION_LASTS = timedelta(hours=12)  # a working day, as OWASP ASVS 3.3.2 has it at level 2
IDLE_LASTS = timedelta(hours=2)
TOKEN_LASTS = timedelta(minutes=15)  # then the session goes on under a new one
OLD_TOKEN_LASTS = timedelta(minutes=1)  # for requests that were under way
SEEN_EVERY = timedelta(minutes=1)  # a session's last use is stored this exactly
ALL_STUDIES = "*"  # in place of studies' short names
UNNAMED = "(set-up)"  # the owner-to-be, until the set-up link is used


@dataclass(frozen=True)
class Experimenter:
    id: int
    name: str
    role: Role
    has_password: bool
    has_second_factor: bool
    is_disabled: bool
    link_expires_at: datetime | None
    studies: tuple[str, ...] | None  # slugs of those that they see; None: all

    def may(self, role: Role) -> bool:
        """Whether this person has at least that role."""
        return ROLES.index(self.role) >= ROLES.index(role)


@dataclass(frozen=True)
class OpenSession:
    """A signed-in experimenter and the session's form token; `renewed` is the new token of a session just renewed."""

    experimenter: Experimenter
    form_token: str
    renewed: str | None


def renew_link(
    database: Database, name: str, now: datetime, role: Role | None = None, studies: Sequence[str] | None = None
) -> str:
    """Make a new sign-in link for an experimenter, who is added if need be; returns its secret.

    An older link ends. So do the password, which may be lost or known to others, and all sessions: each of them could
    choose the next password. A second factor is asked for beside the link (`end_second_factor` ends it).

    Parameters
    ----------
    role : None: unchanged; owner for a new experimenter
    studies : as `restrict`; None: unchanged

    Raises
    ------
    ConflictError
        If nobody would be left who is an owner, or an owner were restricted to some studies.
    NotFoundError
        If there is no study of a name.
    """
    secret = new_secret()
    values: dict[str, Any] = {"link_hash": digest(secret), "link_expires_at": now + LINK_LASTS, "disabled_at": None}
    if role is not None:
        values["role"] = role
    with database.writing() as connection:
        has_owners = _lock_owners(connection)
        known = experimenter_named(connection, name)
        if known is None:
            connection.execute(insert(experimenter).values(name=name, created_at=now, **values))
        else:
            end_all_sessions(connection, known.id)
            this = update(experimenter).where(experimenter.c.id == known.id)
            connection.execute(this.values(password_hash=None, **values))
        if studies is not None:
            restrict(connection, name, studies)
        if has_owners:
            _refuse_to_lock_out(connection)
    return secret


def set_up_link(database: Database, now: datetime) -> str | None:
    """Make a new set-up link while there are no experimenters; returns its secret, or None."""
    return None if has_anybody(database) else renew_link(database, UNNAMED, now, "owner")


def has_anybody(database: Database) -> bool:
    """Is there an experimenter, so that somebody can sign in?"""
    with database.reading() as connection:
        return bool(connection.scalar(select(_is_anybody_named())))


def is_set_up_link(connection: Connection, secret: str, now: datetime) -> bool:
    """Whether a set-up link is valid: until it is used, expires, is renewed, or somebody has been added."""
    return bool(connection.scalar(select(exists().where(*_good_set_up_link(secret, now)))))


def finish_set_up(connection: Connection, secret: str, name: str, password_hash: str, now: datetime) -> int | None:
    """Make the holder of the set-up link an owner and end the link; returns their id, None if the link is not valid."""
    return connection.execute(
        update(experimenter)
        .where(*_good_set_up_link(secret, now))
        .values(name=name, role="owner", password_hash=password_hash, **_no_link())
        .returning(experimenter.c.id)
    ).scalar_one_or_none()


def experimenter_by_link(connection: Connection, secret: str, now: datetime) -> Experimenter | None:
    """Find the experimenter of a sign-in link; it is valid until it is used, expires, or is renewed."""
    return _one(connection, experimenter.c.name != UNNAMED, *_good_link(secret, now))


def spend_link(connection: Connection, secret: str, now: datetime) -> Experimenter | None:
    """Use a sign-in link, which ends with it; returns its experimenter, None if the link is not valid."""
    person = experimenter_by_link(connection, secret, now)
    if person is None:
        return None
    this = update(experimenter).where(experimenter.c.id == person.id, *_good_link(secret, now))
    return person if connection.execute(this.values(**_no_link())).rowcount else None


def password_of(connection: Connection, name: str) -> tuple[int, str] | None:
    """Return id and password hash of the experimenter with a name; None if they may not sign in by password."""
    row = connection.execute(
        select(experimenter.c.id, experimenter.c.password_hash).where(
            experimenter.c.name == name, experimenter.c.password_hash.is_not(None), experimenter.c.disabled_at.is_(None)
        )
    ).one_or_none()
    return (row.id, row.password_hash) if row else None


def set_password(connection: Connection, experimenter_id: int, password_hash: str) -> None:
    """Store a new password; the sign-in link and all sessions end."""
    this = update(experimenter).where(experimenter.c.id == experimenter_id)
    connection.execute(this.values(password_hash=password_hash, **_no_link()))
    end_all_sessions(connection, experimenter_id)


def begin_experimenter_session(
    connection: Connection, experimenter_id: int, now: datetime, browser: str | None = None
) -> str:
    """Begin a session and return its token; expired sessions are deleted."""
    token = new_secret()
    connection.execute(delete(experimenter_session).where(experimenter_session.c.expires_at <= now))
    connection.execute(
        insert(experimenter_session).values(
            experimenter_id=experimenter_id,
            token_hash=digest(token),
            form_token=new_secret(),
            browser=browser,
            created_at=now,
            rotated_at=now,
            seen_at=now,
            expires_at=now + SESSION_LASTS,
        )
    )
    return token


def open_session(database: Database, token: str, now: datetime, *, may_renew: bool = True) -> OpenSession | None:
    """Find the session of a token, and renew the token when it is old; None if there is no such session."""
    with database.reading() as connection:
        row = _session_row(connection, token, now)
        person = _one(connection, experimenter.c.id == row.experimenter_id) if row else None
    if row is None or person is None or person.is_disabled:
        return None
    renewed = None
    if may_renew and row.token_hash == digest(token) and now - row.rotated_at > TOKEN_LASTS:
        renewed = _renew_token(database, row.id, row.token_hash, now)
    elif now - row.seen_at > SEEN_EVERY:
        with database.writing() as connection:
            connection.execute(
                update(experimenter_session).where(experimenter_session.c.id == row.id).values(seen_at=now)
            )
    return OpenSession(person, row.form_token, renewed)


def is_session_open(connection: Connection, form_token: str, now: datetime) -> bool:
    """Whether a session has not ended; its form token stays the same when its token is renewed."""
    person = experimenter_session.join(experimenter)
    open_now = (experimenter_session.c.form_token == form_token, experimenter.c.disabled_at.is_(None), *_lasts(now))
    return bool(connection.scalar(select(exists().select_from(person).where(*open_now))))


def sign_out(connection: Connection, token: str) -> None:
    connection.execute(delete(experimenter_session).where(_has_token(token)))


def sessions_of(connection: Connection, experimenter_id: int, now: datetime) -> Sequence[Row[Any]]:
    """Return an experimenter's open sessions, the last used first: id, form_token, browser, created_at, seen_at."""
    names = ("id", "form_token", "browser", "created_at", "seen_at")
    return connection.execute(
        select(*(experimenter_session.c[name] for name in names))
        .where(experimenter_session.c.experimenter_id == experimenter_id, *_lasts(now))
        .order_by(experimenter_session.c.seen_at.desc(), experimenter_session.c.id.desc())
    ).all()


def end_session(connection: Connection, experimenter_id: int, session_id: int) -> bool:
    """End one of an experimenter's sessions; returns whether there was one."""
    this = (experimenter_session.c.id == session_id, experimenter_session.c.experimenter_id == experimenter_id)
    return connection.execute(delete(experimenter_session).where(*this)).rowcount > 0


def end_all_sessions(connection: Connection, experimenter_id: int) -> int:
    """End all sessions of an experimenter; returns how many there were."""
    theirs = experimenter_session.c.experimenter_id == experimenter_id
    return connection.execute(delete(experimenter_session).where(theirs)).rowcount


def end_other_sessions(connection: Connection, experimenter_id: int, form_token: str) -> None:
    """Sign a person out everywhere but in the session whose forms carry a token."""
    others = (
        experimenter_session.c.experimenter_id == experimenter_id,
        experimenter_session.c.form_token != form_token,
    )
    connection.execute(delete(experimenter_session).where(*others))


def all_experimenters(connection: Connection) -> list[Experimenter]:
    rows = connection.execute(
        select(experimenter).where(experimenter.c.name != UNNAMED).order_by(func.lower(experimenter.c.name))
    )
    return [_experimenter(row) for row in rows]


def set_role(connection: Connection, name: str, role: Role) -> None:
    """Give somebody a role.

    Raises
    ------
    ConflictError
        If nobody would be left who is an owner.
    """
    _lock_owners(connection)
    connection.execute(update(experimenter).where(experimenter.c.name == name).values(role=role))
    _refuse_to_lock_out(connection)


def restrict(connection: Connection, name: str, studies: Sequence[str]) -> None:
    """Let somebody see and change some studies only, or all of them; their sessions end, so that it holds at once.

    Parameters
    ----------
    connection : of a writing transaction
    name : the experimenter's
    studies : short names, or ALL_STUDIES

    Raises
    ------
    ConflictError
        If an owner were restricted.
    NotFoundError
        If there is no study of a name.
    """
    person = experimenter_named(connection, name)
    known = check_studies(connection, studies)
    if known is not None and person is not None and person.may("owner"):
        raise ConflictError(f"{name} is an owner, who sees all studies. Give another role first.")
    connection.execute(update(experimenter).where(experimenter.c.name == name).values(studies=known))
    if person is not None:
        end_all_sessions(connection, person.id)


def check_studies(connection: Connection, slugs: Sequence[str]) -> list[str] | None:
    """Return the short names of studies, each once, to restrict somebody to; None: all, as ALL_STUDIES among them says.

    Raises
    ------
    NotFoundError
        If there is no study of a name.
    """
    if ALL_STUDIES in slugs:
        return None
    known = set(connection.scalars(select(study.c.slug).where(study.c.slug.in_(slugs))))
    if unknown := [slug for slug in slugs if slug not in known]:
        raise NotFoundError(f"There is no study {unknown[0]!r}. Nothing was changed.")
    return sorted(known)


def disable(connection: Connection, name: str, now: datetime) -> list[str]:
    """Disable an account, end its sessions and revoke the tokens it has made; a new link enables the account again.

    Returns
    -------
    names of the tokens that were valid until now

    Raises
    ------
    ConflictError
        If nobody would be left who is an owner.
    """
    has_owners = _lock_owners(connection)
    ended = update(experimenter).where(experimenter.c.name == name).values(disabled_at=now, **_no_link())
    for experimenter_id in connection.scalars(ended.returning(experimenter.c.id)).all():
        end_all_sessions(connection, experimenter_id)
    if has_owners:
        _refuse_to_lock_out(connection)
    theirs = (api_token.c.created_by == name, api_token.c.revoked_at.is_(None))
    revoked = update(api_token).where(*theirs).values(revoked_at=now).returning(api_token.c.name)
    return list(connection.scalars(revoked))


def experimenter_named(connection: Connection, name: str) -> Experimenter | None:
    return _one(connection, experimenter.c.name == name)


def _no_link() -> dict[str, Any]:
    """Return the columns of an experimenter whose sign-in link has ended."""
    return {"link_hash": digest(new_secret()), "link_expires_at": None}


def _is_owner() -> ColumnElement[bool]:
    return and_(experimenter.c.role == "owner", experimenter.c.disabled_at.is_(None), experimenter.c.name != UNNAMED)


def _lock_owners(connection: Connection) -> bool:
    """Lock the rows of all owners; returns whether there are any.

    Otherwise two owners could remove each other at once, each seeing the other still there.
    """
    owners = select(experimenter.c.id).where(_is_owner()).order_by(experimenter.c.id)
    return bool(connection.execute(owners.with_for_update(key_share=True)).all())


def _refuse_to_lock_out(connection: Connection) -> None:
    if not connection.scalar(select(exists().where(_is_owner()))):
        raise ConflictError("Nobody would be left who is an owner. Make somebody else an owner first.")


def _session_row(connection: Connection, token: str, now: datetime) -> Row[Any] | None:
    return connection.execute(
        select(experimenter_session).where(
            _has_token(token),
            *_lasts(now),
            or_(
                experimenter_session.c.token_hash == digest(token),
                experimenter_session.c.rotated_at > now - OLD_TOKEN_LASTS,
            ),
        )
    ).one_or_none()


def _lasts(now: datetime) -> tuple[ColumnElement[bool], ...]:
    return experimenter_session.c.expires_at > now, experimenter_session.c.seen_at > now - IDLE_LASTS


def _has_token(token: str) -> ColumnElement[bool]:
    known = digest(token)
    return or_(experimenter_session.c.token_hash == known, experimenter_session.c.previous_hash == known)


def _renew_token(database: Database, session_id: int, token_hash: str, now: datetime) -> str | None:
    """Give a session a new token; None if another request has just done so."""
    token = new_secret()
    values = {"token_hash": digest(token), "previous_hash": token_hash, "rotated_at": now, "seen_at": now}
    with database.writing() as connection:
        changed = connection.execute(
            update(experimenter_session)
            .where(experimenter_session.c.id == session_id, experimenter_session.c.token_hash == token_hash)
            .values(**values)
        )
    return token if changed.rowcount else None


def _good_link(secret: str, now: datetime) -> tuple[ColumnElement[bool], ...]:
    return (
        experimenter.c.link_hash == digest(secret),
        experimenter.c.link_expires_at > now,
        experimenter.c.disabled_at.is_(None),
    )


def _good_set_up_link(secret: str, now: datetime) -> tuple[ColumnElement[bool], ...]:
    return (experimenter.c.name == UNNAMED, ~_is_anybody_named(), *_good_link(secret, now))


def _is_anybody_named() -> ColumnElement[bool]:
    named = experimenter.alias()
    return exists().where(named.c.name != UNNAMED)


def _one(connection: Connection, *conditions: ColumnElement[bool]) -> Experimenter | None:
    row = connection.execute(select(experimenter).where(*conditions)).one_or_none()
    return _experimenter(row) if row else None


def _experimenter(row: Row[Any]) -> Experimenter:
    return Experimenter(
        row.id,
        row.name,
        row.role,
        has_password=row.password_hash is not None,
        has_second_factor=row.totp_since is not None,
        is_disabled=row.disabled_at is not None,
        link_expires_at=row.link_expires_at,
        studies=None if row.studies is None or row.role == "owner" else tuple(row.studies),
    )
