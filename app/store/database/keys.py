"""Make secrets; the database stores only their digests."""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
from datetime import UTC, datetime

CODE_ALPHABET = "23456789abcdefghjkmnpqrstuvwxyz"  # without characters that are misread: 0 o, 1 l i
CODE_LENGTH = 12  # 59 bits


def new_secret() -> str:
    """Return 256 random bits, for a cookie, a link or a bearer token."""
    return secrets.token_urlsafe(32)


def new_opaque_id() -> str:
    """Return a random name, which says nothing about what it names; no spreadsheet takes it for a formula."""
    while (name := secrets.token_urlsafe(12)).startswith("-"):
        pass
    return name


def new_code(length: int = CODE_LENGTH) -> str:
    """Return a code that a person can type."""
    return "".join(secrets.choice(CODE_ALPHABET) for _ in range(length))


def typed_code(text: str) -> str:
    """Return a code as it was made from what a person typed: in capitals, or in groups."""
    return re.sub(r"[\s-]", "", text).lower()


def token_of_key(key: str) -> str:
    """Derive a session's token from the client's random key; as secret as the key."""
    return hashlib.sha256(f"session {key}".encode()).hexdigest()


def resume_code(token: str) -> str:
    """Derive the code to resume a session in another browser from its token, which only the participant has."""
    number = int.from_bytes(hashlib.sha256(f"resume {token}".encode()).digest())
    return "".join(
        CODE_ALPHABET[number // len(CODE_ALPHABET) ** place % len(CODE_ALPHABET)] for place in range(CODE_LENGTH)
    )


def resumed_token(code: str, key: str) -> str:
    """Derive the token of a resumed session from the code and the browser's random key.

    It takes both to derive it again, so only this browser gets the same answer twice. It is as secret as the key, and
    differs between codes.
    """
    return hmac.new(key.encode(), f"go on {code}".encode(), hashlib.sha256).hexdigest()


def digest(secret: str) -> str:
    """Return the SHA-256 of a secret, to store; plain, because secrets are random and long."""
    return hashlib.sha256(secret.encode()).hexdigest()


def utc_now() -> datetime:
    return datetime.now(UTC)
