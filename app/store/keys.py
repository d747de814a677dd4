"""Secrets that are given out once and kept only as digests."""

from __future__ import annotations

import hashlib
import hmac
import secrets
from datetime import UTC, datetime

CODE_ALPHABET = "23456789abcdefghjkmnpqrstuvwxyz"  # without what is misread: 0 o, 1 l i
CODE_LENGTH = 12  # 59 bits


def new_secret() -> str:
    """256 random bits, for a cookie, a link or a bearer token."""
    return secrets.token_urlsafe(32)


def new_opaque_id() -> str:
    """A name for something that says nothing about it."""
    return secrets.token_urlsafe(12)


def new_code() -> str:
    """A code that a person can type."""
    return "".join(secrets.choice(CODE_ALPHABET) for _ in range(CODE_LENGTH))


def token_of_key(key: str) -> str:
    """The session's token that follows from a key that the client made; as secret as the key is."""
    return hashlib.sha256(f"session {key}".encode()).hexdigest()


def resume_code(token: str) -> str:
    """The code to go on elsewhere; it follows from the session's token, which only its participant has."""
    number = int.from_bytes(hashlib.sha256(f"resume {token}".encode()).digest())
    return "".join(
        CODE_ALPHABET[number // len(CODE_ALPHABET) ** place % len(CODE_ALPHABET)] for place in range(CODE_LENGTH)
    )


def resumed_token(code: str, key: str) -> str:
    """The token of a session that goes on: it follows from the code and from a key of the browser that used it.

    Whoever lacks one of the two cannot tell it, so that only this browser gets the same answer again; as secret as the
    key, which is random, and never the same for two codes.
    """
    return hmac.new(key.encode(), f"go on {code}".encode(), hashlib.sha256).hexdigest()


def digest(secret: str) -> str:
    """What is kept of a secret; it is random and long, so a plain digest is enough."""
    return hashlib.sha256(secret.encode()).hexdigest()


def utc_now() -> datetime:
    return datetime.now(UTC)
