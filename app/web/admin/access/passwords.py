"""Check and hash experimenters' passwords; Argon2id makes guessing a stolen hash expensive."""

from __future__ import annotations

from functools import cache

from argon2 import PasswordHasher
from argon2.exceptions import VerificationError

from app.errors import InvalidError

SHORTEST, LONGEST = 12, 128  # characters, OWASP ASVS 2.1.1 and 2.1.2
FEWEST_DIFFERENT = 5  # different characters
LEAST_SCORE = 3  # of 4 by zxcvbn: 100 million guesses and more (Wheeler 2016)
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
    if (reason := _why_easy_to_guess(password, name)) is not None:
        raise ValueError(f"The password is easy to guess. {reason}".strip())


def new_password_hash(name: str, password: str, again: str) -> str:
    """Check a new password and return its hash.

    Raises
    ------
    InvalidError
        If the two differ, or the password is not good enough.
    """
    if password != again:
        raise InvalidError("The two passwords differ. Please type the same one twice.")
    try:
        check_password(password, name)
    except ValueError as error:
        raise InvalidError(str(error)) from error
    return hash_password(password)


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


def _why_easy_to_guess(password: str, name: str) -> str | None:
    """Say why a password is among the common ones or made of such; None: it is not, as far as zxcvbn can tell."""
    from zxcvbn import zxcvbn  # its lists take a while to read

    estimate = zxcvbn(password, user_inputs=[name, "reconstudy"], max_length=LONGEST)
    if estimate["score"] >= LEAST_SCORE:
        return None
    feedback = estimate["feedback"]
    return " ".join(filter(None, (feedback["warning"], *feedback["suggestions"])))


@cache
def _nobodys() -> str:
    return _HASHER.hash("nobody has this password, but checking takes as long as if somebody had")
