"""Who gets into the dashboard, how, for how long, and what each may do there."""

from __future__ import annotations

import html
import re
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from itertools import count
from pathlib import Path
from urllib.parse import quote

import httpx
import pyotp
import pytest

from app.errors import ConflictError
from app.main import running_server
from app.operations import manage
from app.operations.database import open_store
from app.settings import Settings
from app.store.audit import audit_records
from app.store.engine import Database
from app.store.experimenters import (
    IDLE_LASTS,
    SESSION_LASTS,
    TOKEN_LASTS,
    begin_experimenter_session,
    experimenter_by_link,
    experimenter_named,
    open_session,
    renew_link,
)
from app.store.second_factors import confirm_second_factor, prepare_second_factor, spend_recovery_code
from app.web.admin.access import account_page, sign_in_page
from app.web.admin.access.passwords import check_password, hash_password, is_password
from app.web.admin.access.second_factor import is_let_in
from tests.app.web.admin.dashboard_client import Dashboard, signed_in

pytestmark = pytest.mark.slow

PASSWORD = "correct horse battery"
NOW = datetime(2026, 3, 1, 9, 0, tzinfo=UTC)


@pytest.fixture(scope="module")
def fresh(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    return Settings(data_dir=tmp_path_factory.mktemp("fresh"))


@pytest.fixture(scope="module")
def fresh_server(fresh: Settings) -> Iterator[str]:
    with running_server(fresh) as url:
        yield url


def test_the_first_start_gives_a_link_that_works_once(fresh: Settings, fresh_server: str) -> None:
    path = manage.set_up_path(fresh)
    assert path is not None
    form = {"name": "Olga Owner", "password": PASSWORD, "again": PASSWORD}
    with Dashboard(fresh_server) as stranger, Dashboard(fresh_server) as late:
        assert "Set up this server" in stranger.get(path).text
        assert stranger.enter(path, **{**form, "again": "something else"}).status_code == 422
        assert "Olga Owner" in stranger.enter(path, **form).text
        assert late.get(path).status_code == 401
        assert late.enter(path, **{**form, "name": "Late"}).status_code == 401
    assert manage.set_up_path(fresh) is None


def test_an_older_set_up_link_ends_with_the_next_start(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    older, newer = manage.set_up_path(settings), manage.set_up_path(settings)
    with running_server(settings) as url, Dashboard(url) as stranger:
        assert stranger.get(str(older)).status_code == 401
        assert stranger.get(str(newer)).status_code == 200


def test_a_password_signs_in_and_ends_the_link(small_server: str, small: Settings) -> None:
    link = manage.add_experimenter(small, "Paula")["path"]
    with Dashboard(small_server) as paula:
        paula.enter(link)
        paula.act("/admin/account/password", password=PASSWORD, again=PASSWORD)
        assert "Your role is owner" in paula.get("/admin/account").text
    with Dashboard(small_server) as paula:
        assert paula.enter(link).status_code == 401
        wrong = paula.enter("/admin/sign-in", name="Paula", password="incorrect horse")
        assert wrong.status_code == 401
        assert "do not belong together" in wrong.text
        assert "Studies" in paula.enter("/admin/sign-in", name="Paula", password=PASSWORD).text


def test_who_signs_in_again_comes_to_the_page_they_asked_for(small_server: str, small: Settings) -> None:
    link = manage.add_experimenter(small, "Renate")["path"]
    with Dashboard(small_server) as renate:
        renate.enter(link)
        renate.act("/admin/account/password", password=PASSWORD, again=PASSWORD)
    with Dashboard(small_server) as renate:
        page = renate.get("/admin/audit?page=2").text
        for password in ("incorrect horse", PASSWORD):
            (action,) = re.findall(r'action="(/admin/sign-in[^"]*)"', page)
            answer = renate.enter(html.unescape(action), name="Renate", password=password)
            page = answer.text
        assert str(answer.url) == f"{small_server}/admin/audit?page=2"
    for elsewhere in ("https://example.org/admin/", "//example.org/admin/"):
        with Dashboard(small_server) as renate:
            signed_in = renate.enter(f"/admin/sign-in?to={quote(elsewhere)}", name="Renate", password=PASSWORD)
            assert str(signed_in.url) == f"{small_server}/admin"
    with Dashboard(small_server) as late:
        assert "login" not in "".join(
            re.findall(r'action="(.*)"', late.get(link).text)
        )  # a link's secret is in no address


def test_a_changed_password_ends_the_other_sessions(small_server: str, small: Settings) -> None:
    with signed_in(small_server, small, "Pia") as here, Dashboard(small_server) as there:
        assert here.act("/admin/account/password", password=PASSWORD, again=PASSWORD).status_code == 200
        there.enter("/admin/sign-in", name="Pia", password=PASSWORD)
        assert "Studies" in there.get("/admin").text
        again = {"password": PASSWORD + "!", "again": PASSWORD + "!"}
        assert here.act("/admin/account/password", current="wrong", **again).status_code == 422
        assert here.act("/admin/account/password", current=PASSWORD, **again).status_code == 200
        assert there.get("/admin").status_code == 401


@pytest.fixture
def small(tmp_path: Path) -> Settings:
    return Settings(data_dir=tmp_path)


@pytest.fixture
def small_server(small: Settings) -> Iterator[str]:
    """A server of one test's own: a few wrong passwords there hold up nobody else."""
    with running_server(small) as url:
        yield url


@pytest.fixture
def forgetful(small_server: str, small: Settings) -> Iterator[Dashboard]:
    """Fred, who has a password and is signed in."""
    with signed_in(small_server, small, "Fred", "experimenter") as fred:
        fred.act("/admin/account/password", password=PASSWORD, again=PASSWORD)
        yield fred


def test_an_owners_new_link_replaces_a_forgotten_password(
    small_server: str, small: Settings, forgetful: Dashboard
) -> None:
    with signed_in(small_server, small, "Olaf", "owner") as olaf:
        shown = olaf.act("/admin/users/link", name="Fred").text
        entry = next(line for line in olaf.get("/admin/audit?search=Fred").text.split("<tr") if "link made" in line)
    assert "Olaf" in entry
    assert "password" in entry
    link = shown.split(f"{small_server}/admin/login/")[1].split("<")[0]
    assert forgetful.get("/admin").status_code == 401
    new = "another horse battery"
    with Dashboard(small_server) as fred:
        assert fred.enter("/admin/sign-in", name="Fred", password=PASSWORD).status_code == 401
        fred.enter(f"/admin/login/{link}")
        assert "Current password" not in fred.get("/admin/account").text
        assert "The password is saved" in fred.act("/admin/account/password", password=new, again=new).text
        assert "The password is saved" not in fred.get("/admin/account").text
        assert "Your role is experimenter" in fred.get("/admin/account").text
    with Dashboard(small_server) as fred:
        assert fred.enter(f"/admin/login/{link}").status_code == 401
        assert "Studies" in fred.enter("/admin/sign-in", name="Fred", password=new).text


@pytest.mark.usefixtures("forgetful")
def test_the_command_line_replaces_a_forgotten_password_and_says_so(small_server: str, small: Settings) -> None:
    added = manage.add_experimenter(small, "Fred")
    assert added["password_ended"]
    with Dashboard(small_server) as fred:
        fred.enter(added["path"])
        assert fred.act("/admin/account/password", password=PASSWORD, again=PASSWORD).status_code == 200
    assert not manage.add_experimenter(small, "Somebody new")["password_ended"]


def test_adding_a_name_that_is_there_takes_nobodys_password(
    small_server: str, small: Settings, forgetful: Dashboard
) -> None:
    with signed_in(small_server, small, "Olaf", "owner") as olaf:
        refused = olaf.act("/admin/users", name="Fred", role="viewer")
        assert olaf.act("/admin/users/link", name="Nobody").status_code == 404
        assert olaf.act("/admin/users/link", name="Olaf").status_code == 409
    assert refused.status_code == 409
    assert "New link" in refused.text
    assert "Your role is experimenter" in forgetful.get("/admin/account").text


def test_only_an_owner_makes_links_for_others(small_server: str, small: Settings, forgetful: Dashboard) -> None:
    with signed_in(small_server, small, "Xenia", "experimenter") as xenia:
        assert xenia.act("/admin/users/link", name="Fred").status_code == 403
    assert forgetful.get("/admin").status_code == 200


def test_guessing_passwords_is_slowed_down_for_that_name_and_locks_out_nobody_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings, seen_from = Settings(data_dir=tmp_path), ["192.0.2.2"]
    for module in (sign_in_page, account_page):
        monkeypatch.setattr(module, "address", lambda _request: seen_from[0])
    with running_server(settings) as url, Dashboard(url) as stranger, signed_in(url, settings, "Paula") as paula:
        paula.act("/admin/account/password", password=PASSWORD, again=PASSWORD)
        seen_from[0] = "192.0.2.1"
        statuses = [stranger.enter("/admin/sign-in", name="Paula", password="guess").status_code for _ in range(6)]
        assert statuses == [401] * 5 + [429]
        told = stranger.enter("/admin/sign-in", name="Paula", password="guess")
        assert int(told.headers["retry-after"]) > 0
        seen_from[0] = "192.0.2.2"
        assert "Studies" in paula.enter("/admin/sign-in", name="Paula", password=PASSWORD).text


def test_guessing_invitations_is_slowed_down(tmp_path: Path) -> None:
    with running_server(Settings(data_dir=tmp_path)) as url, httpx.Client(base_url=url) as stranger:
        body = {"invitation": "guess"}
        answers = [stranger.post("/api/v1/studies/any/sessions", json=body) for _ in range(31)]
        assert {answer.status_code for answer in answers[:30]} == {404}
        assert answers[30].status_code == 429
        assert answers[30].json()["status"] == 429


def test_forms_for_strangers_are_taken_from_our_own_pages_only(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    path = str(manage.set_up_path(settings))
    form = {"name": "Olga Owner", "password": PASSWORD, "again": PASSWORD}
    with running_server(settings) as url, Dashboard(url) as page, httpx.Client(base_url=url) as elsewhere:
        for token in ({}, {"form_token": "guess"}, {"form_token": ""}):
            for cookies in ({}, {"entry": "another"}):
                header = {"Cookie": "; ".join(f"{name}={value}" for name, value in cookies.items())}
                assert elsewhere.post(path, data={**form, **token}, headers=header).status_code == 403
                sign_in = elsewhere.post("/admin/sign-in", data={**form, **token}, headers=header)
                assert sign_in.status_code == 403
                resumed = elsewhere.post("/resume", data={"resume_code": "a-b-c", **token}, headers=header)
                assert resumed.status_code == 403
        assert manage.set_up_path(settings) is not None
        path = str(manage.set_up_path(settings))
        assert "Olga Owner" in page.enter(path, **form).text
        assert (
            page.post("/resume", data={"resume_code": "a-b-c", "form_token": page.cookies["entry"]}).status_code == 404
        )


@pytest.mark.parametrize(
    ("password", "complaint"),
    [
        ("short", "5 characters"),
        ("aaaaaaaaaaaaaa", "repeats"),
        ("paulapaula-12", "name"),
        ("password1234", "easy to guess. This is a very common password"),
        ("iloveyou2024!", "easy to guess"),
        ("x" * 129, "129 characters"),
    ],
)
def test_a_poor_password_is_refused_with_its_reason(password: str, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        check_password(password, "Paula")


def test_a_password_is_kept_as_argon2id_and_recognised() -> None:
    kept = hash_password(PASSWORD)
    assert kept.startswith("$argon2id$v=19$m=19456,t=2,p=1$")
    assert is_password(PASSWORD, kept)
    assert not is_password(PASSWORD + "x", kept)
    assert not is_password(PASSWORD, None)


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    database = open_store(Settings(data_dir=tmp_path))
    yield database
    database.dispose()


@pytest.fixture
def session_token(database: Database) -> str:
    secret = renew_link(database, "Rosa", NOW)
    with database.writing() as connection:
        rosa = experimenter_by_link(connection, secret, NOW)
        assert rosa is not None
        return begin_experimenter_session(connection, rosa.id, NOW)


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
    assert open_session(database, session_token, NOW + SESSION_LASTS) is None


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


def test_a_form_without_its_token_changes_nothing_and_is_noted(server: str, settings: Settings) -> None:
    with signed_in(server, settings, "Fay") as fay:
        for fields in ({}, {"form_token": "guess"}, {"form_token": "ünïcode"}):
            assert fay.post("/admin/users", data={"name": "Eve", "role": "owner", **fields}).status_code == 403
        assert "Eve" not in fay.get("/admin/users").text
        assert "form refused" in fay.get("/admin/audit?search=Fay").text


def test_roles_open_only_their_own_pages(server: str, settings: Settings) -> None:
    pages = {"/admin": "viewer", "/admin/account": "viewer", "/admin/audit": "experimenter", "/admin/users": "owner"}
    ranks = ("viewer", "experimenter", "owner")
    for role in ranks:
        with signed_in(server, settings, f"The {role}", role) as person:
            for path, needed in pages.items():
                expected = 200 if ranks.index(role) >= ranks.index(needed) else 403
                assert person.get(path).status_code == expected, (role, path)


def test_an_owner_adds_people_changes_roles_and_ends_access(server: str, settings: Settings) -> None:
    with signed_in(server, settings, "Olaf", "owner") as olaf, Dashboard(server) as nina:
        shown = olaf.act("/admin/users", name="Nina", role="viewer").text
        link = shown.split(f"{server}/admin/login/")[1].split("<")[0]
        assert "Nina" in nina.enter(f"/admin/login/{link}").text
        assert nina.get("/admin/audit").status_code == 403
        olaf.act("/admin/users/role", name="Nina", role="experimenter")
        assert nina.get("/admin/audit").status_code == 200
        olaf.act("/admin/users/disable", name="Nina")
        assert nina.get("/admin").status_code == 401
        assert nina.enter(f"/admin/login/{link}").status_code == 401


def test_the_last_owner_cannot_be_locked_out(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    with running_server(settings) as url, signed_in(url, settings, "Only", "owner") as only:
        assert only.act("/admin/users/role", name="Only", role="viewer").status_code == 409
        assert only.act("/admin/users/disable", name="Only").status_code == 409
        assert only.get("/admin/users").status_code == 200


def test_a_token_reads_what_its_scopes_say_until_it_is_revoked(server: str, settings: Settings) -> None:
    with signed_in(server, settings, "Toni", "owner") as toni, httpx.Client(base_url=server) as program:
        shown = toni.act("/admin/tokens", name="notebook", scope="audit", days="1").text
        secret = shown.split("<p><code>")[1].split("</code>")[0]
        bearer = {"Authorization": f"Bearer {secret}"}
        refused = program.get("/api/v1/studies", headers=bearer)
        assert refused.status_code == 403
        assert "scope read" in refused.json()["detail"]
        assert secret not in toni.get("/admin/tokens").text
        toni.act("/admin/tokens/revoke", name="notebook")
        assert program.get("/api/v1/studies", headers=bearer).status_code == 401


def test_the_audit_log_tells_what_was_done_and_holds_no_secret(server: str, settings: Settings) -> None:
    link = manage.add_experimenter(settings, "Vera")["path"]
    with Dashboard(server) as vera:
        vera.enter(link)
    with Dashboard(server) as stranger:
        stranger.get("/admin/login/guessed-at-random")
        stranger.get("/admin/setup/guessed-at-random")
        stranger.get("/api/v1/studies", headers={"Authorization": "Bearer guessed-at-random"})
    database = open_store(settings)
    with database.reading() as connection:
        entries = audit_records(connection, search="")
    database.dispose()
    told = [(entry["actor"], entry["action"]) for entry in entries]
    assert ("Vera", "signed in") in told
    for refused in ("sign-in refused", "set-up refused", "token refused"):
        assert ("stranger", refused) in told
    assert "guessed-at-random" not in str(entries)
    assert ("command line", "sign-in link made") in told
    assert link.rsplit("/", 1)[1] not in str(entries)


def test_cookies_keep_to_https_where_the_server_says_so(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path, secure_cookies=True, hsts_subdomains=True)
    path = manage.add_experimenter(settings, "Sue")["path"]
    with running_server(settings) as url:
        answer = httpx.get(url + path)
        entry = answer.cookies["__Host-entry"]
        form = {"data": {"form_token": entry}, "headers": {"Cookie": f"__Host-entry={entry}"}}
        signed_in = httpx.post(url + path, **form)
        cookie = f"__Host-experimenter={signed_in.cookies['__Host-experimenter']}"
        from_beside = cookie.removeprefix("__Host-")  # as any host of the domain could set it
        assert [httpx.get(f"{url}/admin", headers={"Cookie": each}).status_code for each in (cookie, from_beside)] == [
            200,
            401,
        ]
    for set_cookie in (answer.headers["set-cookie"], signed_in.headers["set-cookie"]):
        assert {"Secure", "HttpOnly", "Path=/"} <= set(set_cookie.split("; "))
    assert answer.headers["strict-transport-security"] == "max-age=31536000; includeSubDomains"


def test_guessing_tokens_is_slowed_down(tmp_path: Path) -> None:
    with running_server(Settings(data_dir=tmp_path)) as url, httpx.Client(base_url=url) as stranger:
        bearer = {"Authorization": "Bearer guess"}
        statuses = [stranger.get("/api/v1/studies", headers=bearer).status_code for _ in range(31)]
        assert statuses == [401] * 30 + [429]


def test_all_addresses_of_an_ipv6_client_count_as_one(tmp_path: Path) -> None:
    with running_server(Settings(data_dir=tmp_path)) as url, httpx.Client(base_url=url) as stranger:
        statuses = [
            stranger.get(
                "/api/v1/studies", headers={"Authorization": "Bearer guess", "X-Forwarded-For": f"2001:db8::{number:x}"}
            ).status_code
            for number in range(31)
        ]
        assert statuses == [401] * 30 + [429]
        neighbour = {"Authorization": "Bearer guess", "X-Forwarded-For": "2001:db8:0:1::1"}
        assert stranger.get("/api/v1/studies", headers=neighbour).status_code == 401


def test_the_api_limits_how_often_one_asks(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path, api_requests_per_minute=3)
    bearer = {"Authorization": f"Bearer {manage.add_token(settings, 'eager')['token']}"}
    with running_server(settings) as url, httpx.Client(base_url=url, headers=bearer) as eager:
        assert [eager.get("/api/v1/studies").status_code for _ in range(4)] == [200, 200, 200, 429]


def test_a_stranger_at_the_set_up_page_learns_no_names(small_server: str, small: Settings) -> None:
    manage.add_experimenter(small, "Known Name")
    with Dashboard(small_server) as stranger:
        answers = {
            stranger.enter("/admin/setup/guessed", name=name, password=word, again=word).text
            for name, word in (("Known Name", PASSWORD), ("Nobody", PASSWORD), ("Nobody", "short"))
        }
    assert len(answers) == 1
    assert "not valid any more" in answers.pop()


def test_a_new_link_ends_sessions_even_without_a_password(server: str, settings: Settings) -> None:
    with signed_in(server, settings, "Lina") as lina:
        assert lina.get("/admin").status_code == 200
        manage.add_experimenter(settings, "Lina")
        assert lina.get("/admin").status_code == 401


def test_sessions_are_listed_and_end_one_by_one_or_everywhere(small_server: str, small: Settings) -> None:
    with (
        signed_in(small_server, small, "Mo") as here,
        Dashboard(small_server) as there,
        Dashboard(small_server) as other,
    ):
        here.act("/admin/account/password", password=PASSWORD, again=PASSWORD)
        there.headers["User-Agent"] = "Mozilla/5.0 (X11; Linux x86_64; rv:140.0) Gecko/20100101 Firefox/140.0"
        for dashboard in (there, other):
            dashboard.enter("/admin/sign-in", name="Mo", password=PASSWORD)
        page = here.get("/admin/account").text
        assert "Firefox on Linux" in page
        ids = re.findall(r'name="session" value="(\d+)"', page)
        assert len(ids) == 2
        with signed_in(small_server, small, "Foe") as foe:
            assert foe.act("/admin/account/sessions/end", session=ids[0]).status_code == 404
        of_there = re.search(r'Firefox on Linux.*?name="session" value="(\d+)"', page, re.DOTALL)
        assert of_there
        here.act("/admin/account/sessions/end", session=of_there[1])
        assert [each.get("/admin").status_code for each in (here, there, other)] == [200, 401, 200]
        here.act("/admin/account/sessions/end-all")
        assert [each.get("/admin").status_code for each in (here, other)] == [401, 401]


def test_a_second_factor_is_asked_for_until_it_is_turned_off(
    small_server: str, small: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    addresses = count()
    for module in (sign_in_page, account_page):
        monkeypatch.setattr(module, "address", lambda _request: f"client {next(addresses)}")
    with signed_in(small_server, small, "Tess") as tess, Dashboard(small_server) as away:
        assert tess.act("/admin/account/second-factor").status_code == 409  # no password yet
        tess.act("/admin/account/password", password=PASSWORD, again=PASSWORD)
        secret = re.findall(r"<code>([A-Z2-7]{32})</code>", tess.act("/admin/account/second-factor").text)[0]
        away.enter("/admin/sign-in", name="Tess", password=PASSWORD)
        assert away.get("/admin").status_code == 200  # it is not confirmed yet
        totp = pyotp.TOTP(secret)
        assert tess.act("/admin/account/second-factor/confirm", code="000000").status_code == 422
        step = totp.timecode(datetime.now(UTC))
        shown = tess.act("/admin/account/second-factor/confirm", code=totp.generate_otp(step)).text
        codes = re.findall(r"<code>((?:[a-z0-9]{6} ?){4})</code>", shown)
        assert len(set(codes)) == 10
        assert secret not in tess.get("/admin/account").text

    def may_enter(code: str) -> bool:
        with Dashboard(small_server) as tess:
            answer = tess.enter("/admin/sign-in", name="Tess", password=PASSWORD, code=code)
            return answer.status_code == 200

    assert not may_enter("")
    assert not may_enter(totp.generate_otp(step))  # taken when it was confirmed
    assert may_enter(totp.generate_otp(step + 1))
    assert may_enter(codes[0].upper())
    assert not may_enter(codes[0])
    with Dashboard(small_server) as tess:
        tess.enter("/admin/sign-in", name="Tess", password=PASSWORD, code=codes[1])
        assert "8 recovery codes are left" in tess.get("/admin/account").text
        assert tess.act("/admin/account/second-factor/end", current="wrong").status_code == 422
        assert tess.act("/admin/account/second-factor/end", current=PASSWORD).status_code == 200
    assert may_enter("")


def test_where_a_second_factor_is_required_who_has_none_sees_their_account_alone(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path, second_factor="required")
    with running_server(settings) as url, Dashboard(url) as ada:
        entered = ada.enter(manage.add_experimenter(settings, "Ada")["path"])
        assert (entered.url.path, "opens once yours is on" in entered.text) == ("/admin/account", True)
        refused = ada.get("/admin/users")
        assert (refused.status_code, "Click your name above" in refused.text) == (403, True)
        assert ada.get("/api/v1/studies").status_code == 403
        ada.act("/admin/account/password", password=PASSWORD, again=PASSWORD)
        secret = re.findall(r"<code>([A-Z2-7]{32})</code>", ada.act("/admin/account/second-factor").text)[0]
        assert ada.act("/admin/account/second-factor/confirm", code=pyotp.TOTP(secret).now()).status_code == 200
        assert ada.get("/admin/users").status_code == 200


def test_who_lost_the_second_factor_gets_in_by_a_new_link(database: Database) -> None:
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
        assert is_let_in(connection, rosa.id, "", NOW)
        assert not spend_recovery_code(connection, rosa.id, code)


def test_who_signs_out_gets_the_sign_in_which_can_be_loaded_again(small_server: str, small: Settings) -> None:
    with signed_in(small_server, small, "Ruth") as ruth:
        assert str(ruth.get("/admin/sign-in").url) == f"{small_server}/admin"
        left = ruth.act("/admin/logout")
        assert (left.status_code, str(left.url)) == (200, f"{small_server}/admin/sign-in")
        assert ruth.get("/admin/sign-in?to=/admin/audit").status_code == 200
