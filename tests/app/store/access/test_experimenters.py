"""Who may administer, also when owners change each other's access at once, and how long sessions and links last."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta

import pytest
from sqlalchemy import Connection, select

from app.errors import ConflictError
from app.store.access.experimenters import (
    IDLE_LASTS,
    SESSION_LASTS,
    TOKEN_LASTS,
    all_experimenters,
    begin_experimenter_session,
    disable,
    experimenter_by_link,
    experimenter_named,
    open_session,
    renew_link,
    set_role,
)
from app.store.access.second_factors import (
    confirm_second_factor,
    end_second_factor,
    prepare_second_factor,
    spend_recovery_code,
)
from app.store.access.tokens import insert_token
from app.store.database.engine import Database
from app.store.database.tables import api_token, experimenter, experimenter_session, recovery_code
from app.web.admin.access.second_factor import is_let_in
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


def test_access_ends_where_nobody_is_an_owner_yet(database: Database) -> None:
    renew_link(database, "Ada", NOW, "viewer")
    with database.writing() as connection:
        disable(connection, "Ada", NOW)
        assert [one.is_disabled for one in all_experimenters(connection)] == [True]


def test_a_link_with_a_lower_role_leaves_an_owner(database: Database) -> None:
    renew_link(database, "Ada", NOW, "viewer")  # before there is an owner, anybody may come
    renew_link(database, "Eva", NOW, "owner")
    with pytest.raises(ConflictError, match="Nobody would be left who is an owner"):
        renew_link(database, "Eva", NOW, "viewer")
    with database.reading() as connection:
        assert {one.name: one.role for one in all_experimenters(connection)} == {"Ada": "viewer", "Eva": "owner"}
    renew_link(database, "Ada", NOW, "owner")
    renew_link(database, "Eva", NOW, "viewer")


@pytest.fixture
def session_token(database: Database) -> str:
    secret = renew_link(database, "Rosa", NOW)
    with database.writing() as connection:
        rosa = experimenter_by_link(connection, secret, NOW)
        assert rosa is not None
        return begin_experimenter_session(connection, rosa.id, NOW)


def test_no_secret_that_lets_in_is_kept(database: Database, session_token: str) -> None:
    link = renew_link(database, "Ada", NOW)
    renewed = open_session(database, session_token, NOW + TOKEN_LASTS + timedelta(seconds=1))
    assert renewed is not None
    assert renewed.renewed is not None
    with database.writing() as connection:
        codes = confirm_second_factor(connection, renewed.experimenter.id, NOW)
        token = insert_token(connection, "notebook", ["read"], "Ada", NOW)
        tables = (experimenter, experimenter_session, recovery_code, api_token)
        kept = str([connection.execute(select(table)).all() for table in tables])
    secrets = (link, session_token, renewed.renewed, token)
    assert [secret for secret in (*secrets, *codes) if secret in kept] == []
    assert len(set(secrets)) == 4
    assert {len(secret) for secret in secrets} == {43}  # 256 bits, six a letter


def test_a_recovery_code_lets_in_its_own_person_alone(database: Database) -> None:
    for name in ("Rosa", "Otto"):
        renew_link(database, name, NOW)
    with database.writing() as connection:
        rosa, otto = experimenter_named(connection, "Rosa"), experimenter_named(connection, "Otto")
        assert rosa is not None
        assert otto is not None
        code = confirm_second_factor(connection, rosa.id, NOW)[0]
        assert not spend_recovery_code(connection, otto.id, code)
        assert spend_recovery_code(connection, rosa.id, code)


def test_a_link_expires(database: Database) -> None:
    secret = renew_link(database, "Rosa", NOW)
    with database.reading() as connection:
        assert experimenter_by_link(connection, secret, NOW + timedelta(hours=23)) is not None
        assert experimenter_by_link(connection, secret, NOW + timedelta(hours=25)) is None


def test_a_session_ends_when_nobody_uses_it(database: Database, session_token: str) -> None:
    assert open_session(database, session_token, NOW + timedelta(minutes=10)) is not None
    assert open_session(database, session_token, NOW + timedelta(minutes=11) + IDLE_LASTS) is None


def test_a_session_in_use_ends_after_a_working_day_and_changes_its_token_meanwhile(
    database: Database, session_token: str
) -> None:
    at, tokens = NOW, {session_token}
    while at < NOW + SESSION_LASTS - IDLE_LASTS / 2:
        at += IDLE_LASTS / 2
        found = open_session(database, session_token, at)
        assert found is not None
        session_token = found.renewed or session_token
        tokens.add(session_token)
    assert len(tokens) == SESSION_LASTS / (IDLE_LASTS / 2)
    after = NOW + SESSION_LASTS
    assert open_session(database, session_token, after) is None
    assert open_session(database, session_token, after + timedelta(minutes=1)) is None


def test_the_old_token_serves_requests_under_way_and_no_others(database: Database, session_token: str) -> None:
    at = NOW + TOKEN_LASTS + timedelta(seconds=1)
    found = open_session(database, session_token, at)
    assert found is not None
    assert found.renewed
    again = open_session(database, session_token, at + timedelta(seconds=5))
    assert again is not None
    assert again.renewed is None
    assert open_session(database, session_token, at + timedelta(minutes=2)) is None
    assert open_session(database, found.renewed, at + timedelta(minutes=2)) is not None


def test_a_second_factor_stays_with_a_new_link_until_it_is_ended(database: Database) -> None:
    renew_link(database, "Rosa", NOW)
    with database.writing() as connection:
        rosa = experimenter_named(connection, "Rosa")
        assert rosa is not None
        prepare_second_factor(connection, rosa.id, "S" * 32)
        code, *_ = confirm_second_factor(connection, rosa.id, NOW)
        with pytest.raises(ConflictError, match="on already"):
            prepare_second_factor(connection, rosa.id, "T" * 32)
        assert not is_let_in(connection, rosa.id, "", NOW)
    renew_link(database, "Rosa", NOW)
    with database.writing() as connection:
        assert not is_let_in(connection, rosa.id, "", NOW)
        end_second_factor(connection, rosa.id)
        assert is_let_in(connection, rosa.id, "", NOW)
        assert not spend_recovery_code(connection, rosa.id, code)
