"""Who may administer, also when owners change each other's access at once."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest
from sqlalchemy import Connection

from app.errors import ConflictError
from app.store.engine import Database
from app.store.experimenters import all_experimenters, disable, renew_link, set_role
from tests.seeded_studies import NOW

Act = Callable[[Connection, str], None]


def take_role(connection: Connection, name: str) -> None:
    set_role(connection, name, "viewer")


def end_access(connection: Connection, name: str) -> None:
    disable(connection, name, NOW)


@pytest.mark.parametrize(
    ("first", "second"), [(take_role, take_role), (end_access, end_access), (take_role, end_access)]
)
def test_owners_who_lock_each_other_out_at_once_leave_one_of_them(database: Database, first: Act, second: Act) -> None:
    for _ in range(5):
        for name in ("Ada", "Eva"):
            renew_link(database, name, NOW, "owner")
        together = threading.Barrier(2)

        def has_done(act: Act, name: str, together: threading.Barrier = together) -> bool:
            together.wait()
            try:
                with database.writing() as connection:
                    act(connection, name)
            except ConflictError:
                return False
            return True

        with ThreadPoolExecutor(2) as pool:
            assert sorted(pool.map(has_done, (first, second), ("Ada", "Eva"))) == [False, True]
        with database.reading() as connection:
            people = all_experimenters(connection)
        assert [one.role == "owner" and not one.is_disabled for one in people].count(True) == 1


def test_a_link_with_a_lower_role_leaves_an_owner(database: Database) -> None:
    renew_link(database, "Ada", NOW, "viewer")  # before there is an owner, anybody may come
    renew_link(database, "Eva", NOW, "owner")
    with pytest.raises(ConflictError, match="Nobody would be left who is an owner"):
        renew_link(database, "Eva", NOW, "viewer")
    with database.reading() as connection:
        assert {one.name: one.role for one in all_experimenters(connection)} == {"Ada": "viewer", "Eva": "owner"}
    renew_link(database, "Ada", NOW, "owner")
    renew_link(database, "Eva", NOW, "viewer")
