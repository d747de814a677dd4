"""Bearer tokens of analysts: given out once, kept as digests."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import Connection, exists, insert, select

from app.store.engine import Database
from app.store.keys import digest, new_secret
from app.store.tables import api_token

READ = "read"
SCOPES = (READ,)


def insert_token(database: Database, name: str, now: datetime) -> str:
    """Make a token that may read every study's results.

    Raises
    ------
    ValueError
        If there is a token of this name.
    """
    secret = new_secret()
    with database.writing() as connection:
        if connection.scalar(select(exists().where(api_token.c.name == name))):
            raise ValueError(f"there is already a token called {name!r}; choose another name")
        values = {"name": name, "token_hash": digest(secret), "scopes": [READ], "created_at": now}
        connection.execute(insert(api_token).values(**values))
    return secret


def scopes_of(connection: Connection, secret: str) -> tuple[str, ...] | None:
    """What the bearer of a token may do; None if there is no such token."""
    found = connection.execute(select(api_token.c.scopes).where(api_token.c.token_hash == digest(secret)))
    scopes = found.scalar_one_or_none()
    return None if scopes is None else tuple(scopes)
