"""Bearer tokens of analysts: given out once, kept as digests."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, exists, insert, or_, select, update

from app.store.keys import digest, new_secret
from app.store.tables import api_token

READ = "read"
PERSONAL = "personal"
AUDIT = "audit"
SCOPES = {
    READ: "studies, votes, trials, scores and all that is computed from them",
    PERSONAL: "participants, screening results, questionnaires, the archive",
    AUDIT: "the audit log",
}


COLUMNS = (
    api_token.c.name,
    api_token.c.scopes,
    api_token.c.created_at,
    api_token.c.created_by,
    api_token.c.expires_at,
    api_token.c.revoked_at,
)


@dataclass(frozen=True)
class Token:
    """A token without its secret, which is not stored."""

    name: str
    scopes: tuple[str, ...]
    created_at: datetime
    created_by: str | None
    expires_at: datetime | None
    revoked_at: datetime | None


def insert_token(
    connection: Connection, name: str, scopes: Sequence[str], by: str, now: datetime, expires_at: datetime | None = None
) -> str:
    """Make a token and return its secret, of which only a digest is stored.

    Raises
    ------
    ValueError
        If there is a token of this name, or a scope is not known.
    """
    if not scopes or not set(scopes) <= SCOPES.keys():
        raise ValueError(f"scopes {list(scopes)}: expected some of {', '.join(SCOPES)}")
    if connection.scalar(select(exists().where(api_token.c.name == name))):
        raise ValueError(f"there is already a token called {name!r}; choose another name")
    secret = new_secret()
    values = {"name": name, "token_hash": digest(secret), "scopes": list(scopes), "created_at": now}
    connection.execute(insert(api_token).values(**values, created_by=by, expires_at=expires_at))
    return secret


def token_by_secret(connection: Connection, secret: str, now: datetime) -> Token | None:
    """Find a valid token by its secret."""
    row = connection.execute(
        select(*COLUMNS).where(
            api_token.c.token_hash == digest(secret),
            api_token.c.revoked_at.is_(None),
            or_(api_token.c.expires_at.is_(None), api_token.c.expires_at > now),
        )
    ).one_or_none()
    return _token(row._mapping) if row else None


def all_tokens(connection: Connection) -> list[Token]:
    """All tokens, the newest first."""
    return [_token(row._mapping) for row in connection.execute(select(*COLUMNS).order_by(api_token.c.id.desc()))]


def revoke_token(connection: Connection, name: str, now: datetime) -> bool:
    """Revoke a token; returns whether it was valid until now."""
    changed = connection.execute(
        update(api_token).where(api_token.c.name == name, api_token.c.revoked_at.is_(None)).values(revoked_at=now)
    )
    return bool(changed.rowcount)


def _token(facts: Mapping[Any, Any]) -> Token:
    return Token(**{**facts, "scopes": tuple(facts["scopes"])})
