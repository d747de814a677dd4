"""Experimenters: who may see the administration, and the links and cookies by which they are known."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta

from sqlalchemy import Connection, delete, insert, select, update

from app.store.engine import Database
from app.store.keys import digest, new_secret
from app.store.tables import experimenter, experimenter_session

SESSION_LASTS = timedelta(days=14)


@dataclass(frozen=True)
class Experimenter:
    id: int
    name: str


def renew_link(database: Database, name: str, now: datetime) -> str:
    """The secret of a new sign-in link for an experimenter, who is added if need be; an older link ends."""
    secret = new_secret()
    with database.writing() as connection:
        changed = connection.execute(
            update(experimenter).where(experimenter.c.name == name).values(link_hash=digest(secret))
        )
        if not changed.rowcount:
            connection.execute(insert(experimenter).values(name=name, link_hash=digest(secret), created_at=now))
    return secret


def sign_in(database: Database, secret: str, now: datetime) -> str | None:
    """The token of a new session for who has this link; None if nobody has."""
    with database.writing() as connection:
        owner = select(experimenter.c.id).where(experimenter.c.link_hash == digest(secret))
        experimenter_id = connection.execute(owner).scalar_one_or_none()
        if experimenter_id is None:
            return None
        token = new_secret()
        connection.execute(delete(experimenter_session).where(experimenter_session.c.expires_at <= now))
        connection.execute(
            insert(experimenter_session).values(
                experimenter_id=experimenter_id,
                token_hash=digest(token),
                created_at=now,
                expires_at=now + SESSION_LASTS,
            )
        )
    return token


def experimenter_by_token(connection: Connection, token: str, now: datetime) -> Experimenter | None:
    row = connection.execute(
        select(experimenter.c.id, experimenter.c.name)
        .join(experimenter_session)
        .where(experimenter_session.c.token_hash == digest(token), experimenter_session.c.expires_at > now)
    ).one_or_none()
    return Experimenter(row.id, row.name) if row else None


def sign_out(database: Database, token: str) -> None:
    with database.writing() as connection:
        connection.execute(delete(experimenter_session).where(experimenter_session.c.token_hash == digest(token)))
