"""Check and hash experimenters' passwords; Argon2id makes guessing a stolen hash expensive."""

from __future__ import annotations

from functools import cache

from argon2 import PasswordHasher
from argon2.exceptions import VerificationError

SHORTEST, LONGEST = 12, 128  # characters, OWASP ASVS 2.1.1 and 2.1.2
FEWEST_DIFFERENT = 5  # different characters
_HASHER = PasswordHasher(time_cost=2, memory_cost=19 * 1024, parallelism=1)  # the OWASP cheat sheet's first choice


def check_password(password: str, name: str) -> None:
    """Check that a new password is good enough.

    Raises
    ------
    ValueError
        With a sentence for the person who chose it.
    """
    if not SHORTEST <= len(password) <= LONGEST:
        raise ValueError(
            f"The password has {len(password)} characters; it needs {SHORTEST} to {LONGEST}. A few words do well."
        )
    if len(set(password)) < FEWEST_DIFFERENT:
        raise ValueError("The password repeats a few characters. Please choose another one.")
    if name.lower() in password.lower():
        raise ValueError("The password contains the name. Please choose another one.")


def hash_password(password: str) -> str:
    """Return parameters, salt and digest."""
    return _HASHER.hash(password)


def is_password(password: str, kept: str | None) -> bool:
    """Does a password match its hash? Takes as long without a hash."""
    try:
        _HASHER.verify(kept or _nobodys(), password)
    except VerificationError:
        return False
    return kept is not None


@cache
def _nobodys() -> str:
    return _HASHER.hash("nobody has this password, but checking takes as long as if somebody had")
