"""Which passwords are taken, and how they are kept."""

from __future__ import annotations

import pytest

from app.errors import InvalidError
from app.web.admin.access.passwords import hash_password, is_password, new_password_hash
from tests.app.web.admin.dashboard_client import PASSWORD


@pytest.mark.parametrize(
    ("password", "complaint"),
    [
        ("short", "5 characters"),
        ("aaaaaaaaaaaaaa", "repeats"),
        ("paulapaula-12", "name"),
        ("password1234", "easy to guess. This is a very common password"),
        ("iloveyou2024!", "easy to guess"),
        ("reconstudy-2", "easy to guess"),
        ("x" * 129, "129 characters"),
    ],
)
def test_a_poor_password_is_refused_with_its_reason(password: str, complaint: str) -> None:
    with pytest.raises(InvalidError, match=complaint):
        new_password_hash("Paula", password, password)


def test_a_password_is_kept_as_argon2id_and_recognised() -> None:
    kept = hash_password(PASSWORD)
    assert kept.startswith("$argon2id$v=19$m=19456,t=2,p=1$")
    assert is_password(PASSWORD, kept)
    assert not is_password(PASSWORD + "x", kept)
    assert not is_password(PASSWORD, None)
