"""Keep bearer tokens of analysts: given out once, stored as digests."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, Select, exists, insert, or_, select, update

from app.store.access.experimenters import check_studies, experimenter_named
from app.store.access.rights import SCOPES, SCOPES_OF_ROLE
from app.store.database.keys import digest, new_secret
from app.store.database.tables import api_token


@dataclass(frozen=True)
class Token:
    """A token without its secret, which is not stored."""

    name: str
    scopes: tuple[str, ...]
    studies: tuple[str, ...] | None  # slugs of those that it opens; None: all
    created_at: datetime
    created_by: str | None
    expires_at: datetime | None
    revoked_at: datetime | None


def insert_token(
    connection: Connection,
    name: str,
    scopes: Sequence[str],
    by: str,
    now: datetime,
    expires_at: datetime | None = None,
    studies: Sequence[str] | None = None,
) -> str:
    """Make a token and return its secret, of which only a digest is stored.

    Parameters
    ----------
    connection : of a writing transaction
    name : whom or what it is for
    scopes : of SCOPES
    by : who makes it
    now : the time
    expires_at : None: it is valid until it is revoked
    studies : slugs of those that it opens; None: all

    Raises
    ------
    ValueError
        If there is a token of this name, or a scope is not known.
    NotFoundError
        If there is no study of a name.
    """
    if not scopes or not set(scopes) <= SCOPES.keys():
        raise ValueError(f"scopes {list(scopes)}: expected some of {', '.join(SCOPES)}")
    if connection.scalar(select(exists().where(api_token.c.name == name))):
        raise ValueError(f"there is already a token called {name!r}; choose another name")
    secret = new_secret()
    known = None if studies is None else check_studies(connection, studies)
    values = {"name": name, "token_hash": digest(secret), "scopes": list(scopes), "studies": known, "created_at": now}
    connection.execute(insert(api_token).values(**values, created_by=by, expires_at=expires_at))
    return secret


def token_by_secret(connection: Connection, secret: str, now: datetime) -> Token | None:
    """Find a valid token by its secret; it does and opens no more than its maker may by now."""
    row = connection.execute(
        _tokens().where(
            api_token.c.token_hash == digest(secret),
            api_token.c.revoked_at.is_(None),
            or_(api_token.c.expires_at.is_(None), api_token.c.expires_at > now),
        )
    ).one_or_none()
    if row is None:
        return None
    token = _token(row._mapping)
    maker = experimenter_named(connection, token.created_by) if token.created_by else None
    if maker is None:
        return token
    token = replace(token, scopes=tuple(scope for scope in token.scopes if scope in SCOPES_OF_ROLE[maker.role]))
    if maker.studies is None:
        return token
    common = maker.studies if token.studies is None else set(token.studies) & set(maker.studies)
    return replace(token, studies=tuple(common))


def all_tokens(connection: Connection) -> list[Token]:
    """Return all tokens, the newest first."""
    return [_token(row._mapping) for row in connection.execute(_tokens().order_by(api_token.c.id.desc()))]


def revoke_token(connection: Connection, name: str, now: datetime) -> bool:
    """Revoke a token; returns whether it was valid until now."""
    changed = connection.execute(
        update(api_token).where(api_token.c.name == name, api_token.c.revoked_at.is_(None)).values(revoked_at=now)
    )
    return bool(changed.rowcount)


def _tokens() -> Select[Any]:
    return select(*(api_token.c[name] for name in Token.__dataclass_fields__))


def _token(facts: Mapping[Any, Any]) -> Token:
    studies = facts["studies"]
    return Token(**{**facts, "scopes": tuple(facts["scopes"]), "studies": None if studies is None else tuple(studies)})
