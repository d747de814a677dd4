"""Owners add people, give them roles and links, and end their access; tokens, and what the audit log tells."""

from __future__ import annotations

import re
from datetime import timedelta
from pathlib import Path

import httpx
import pyotp
import pytest

from app.main import running_server
from app.operations.database import open_store
from app.operations.studies import manage
from app.settings import Settings
from app.store.database.keys import utc_now
from app.store.studies.audit import audit_records
from tests.app.web.admin.dashboard_client import PASSWORD, Dashboard, signed_in

pytestmark = pytest.mark.slow

ELSEWHERE = {"X-Forwarded-For": "192.0.2.11"}  # other tests sign in from this address, too


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


def test_a_new_link_asks_for_the_second_factor_until_an_owner_ends_it(
    small_server: str, small: Settings, forgetful: Dashboard
) -> None:
    forgetful.act("/admin/account/second-factor")
    secret = re.findall(r"<code>([A-Z2-7]{32})</code>", forgetful.get("/admin/account").text)[0]
    confirm = {"code": pyotp.TOTP(secret).now(), "current": PASSWORD}
    codes = re.findall(
        r"<code>((?:[a-z0-9]{6} ?){4})</code>", forgetful.act("/admin/account/second-factor/confirm", **confirm).text
    )

    def link() -> str:
        shown = olaf.act("/admin/users/link", name="Fred").text
        return "/admin/login/" + shown.split(f"{small_server}/admin/login/")[1].split("<")[0]

    with signed_in(small_server, small, "Olaf", "owner") as olaf, Dashboard(small_server) as fred:
        first = link()
        assert fred.enter(first).status_code == 401
        assert fred.enter(first, code="000000").status_code == 401
        assert "Studies" in fred.enter(first, code=codes[0]).text  # a wrong code has not used it up
        second = link()
        assert [fred.enter(second, code="000000").status_code for _ in range(11)] == [401] * 10 + [429]
        olaf.act("/admin/users/second-factor", name="Fred")
        assert fred.get("/admin").status_code == 401
        assert "Studies" in fred.enter(link()).text
        assert "second factor ended" in olaf.get("/admin/audit?search=Fred").text


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
        row = olaf.get("/admin/users").text.partition('<th scope="row">Nina</th>')[2].partition("</tr>")[0]
        assert "no access" in row
        assert "all studies" not in row


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
    began = utc_now()
    link = manage.add_experimenter(settings, "Vera")["path"]
    account, people = "/admin/account", "/admin/users"
    with Dashboard(server) as vera, signed_in(server, settings, "Olaf", "owner") as olaf:
        vera.headers.update(ELSEWHERE)
        vera.enter(link)
        vera.act(f"{account}/password", password=PASSWORD, again=PASSWORD)
        secret = re.findall(r"<code>([A-Z2-7]{32})</code>", vera.act(f"{account}/second-factor").text)[0]
        code = pyotp.TOTP(secret).now()
        vera.act(f"{account}/second-factor/confirm", code=code, current=PASSWORD).raise_for_status()
        vera.act(f"{account}/second-factor/end", current=PASSWORD).raise_for_status()
        vera.act("/admin/logout")
        vera.enter("/admin/sign-in", name="Vera", password=PASSWORD).raise_for_status()
        with Dashboard(server) as there:
            there.headers.update(ELSEWHERE)
            there.enter("/admin/sign-in", name="Vera", password=PASSWORD).raise_for_status()
        session = re.findall(r'name="session" value="(\d+)"', vera.get(account).text)[0]
        vera.act(f"{account}/sessions/end", session=session, current=PASSWORD).raise_for_status()
        vera.act(f"{account}/sessions/end-all", current=PASSWORD).raise_for_status()
        olaf.act(f"{people}/role", name="Vera", role="viewer").raise_for_status()
        olaf.act(f"{people}/studies", name="Vera", study="*").raise_for_status()
        olaf.act(f"{people}/second-factor", name="Vera").raise_for_status()
        olaf.act(f"{people}/link", name="Vera").raise_for_status()
        olaf.act(f"{people}/disable", name="Vera").raise_for_status()
        olaf.act("/admin/tokens", name="of Olaf", scope="read").raise_for_status()
        olaf.act("/admin/tokens/revoke", name="of Olaf").raise_for_status()
    with Dashboard(server) as stranger:
        stranger.headers.update(ELSEWHERE)
        stranger.get("/admin/login/guessed-at-random")
        stranger.get("/admin/setup/guessed-at-random")
        stranger.enter("/admin/sign-in", name="guessed-at-random", password="in the wrong field")
        stranger.get("/api/v1/studies", headers={"Authorization": "Bearer guessed-at-random"})
    database = open_store(settings)
    with database.reading() as connection:
        entries = [entry for entry in audit_records(connection, search="") if entry["at"] >= began]
    database.dispose()
    told = {(entry["actor"], entry["action"], entry["subject"], entry["detail"].get("by")) for entry in entries}
    by_vera = ("password changed", "second factor turned on", "second factor turned off", "signed out", "session ended")
    by_olaf = ("role changed", "studies changed", "second factor ended", "sign-in link made", "access ended")
    assert {("Vera", action, "", None) for action in (*by_vera, "signed out everywhere")} <= told
    assert {("Vera", "signed in", "", by) for by in ("link", "password")} <= told
    assert {("Olaf", action, "Vera", None) for action in by_olaf} <= told
    assert {("Olaf", action, "of Olaf", None) for action in ("token made", "token revoked")} <= told
    assert {("stranger", "sign-in refused", "", by) for by in ("link", "password")} <= told
    assert ("stranger", "set-up refused", "", "link") in told
    assert ("stranger", "token refused", "/api/v1/studies", None) in told
    assert ("command line", "sign-in link made", "Vera", None) in told
    assert {entry["at"].utcoffset() for entry in entries} == {timedelta(0)}
    for hidden in ("guessed-at-random", PASSWORD, secret, code, link.rsplit("/", 1)[1]):
        assert hidden not in str(entries)


def test_a_new_link_ends_sessions_even_without_a_password(server: str, settings: Settings) -> None:
    with signed_in(server, settings, "Lina") as lina:
        assert lina.get("/admin").status_code == 200
        manage.add_experimenter(settings, "Lina")
        assert lina.get("/admin").status_code == 401
