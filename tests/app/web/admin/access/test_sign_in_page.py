"""Who gets into the dashboard: by a set-up link, by a sign-in link, by a password; and how one leaves it."""

from __future__ import annotations

import html
import re
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

import httpx
import pytest

from app.main import running_server
from app.operations.studies import manage
from app.settings import Settings
from app.web.admin.access import account_page, sign_in_page
from tests.app.web.admin.dashboard_client import PASSWORD, Dashboard, signed_in

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def fresh(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    return Settings(data_dir=tmp_path_factory.mktemp("fresh"))


@pytest.fixture(scope="module")
def fresh_server(fresh: Settings) -> Iterator[str]:
    with running_server(fresh) as url:
        yield url


def test_a_name_of_blanks_is_none(fresh: Settings, fresh_server: str) -> None:
    path = manage.set_up_path(fresh)
    assert path is not None
    with Dashboard(fresh_server) as stranger:
        said = stranger.enter(path, name="  ", password=PASSWORD, again=PASSWORD)
        assert said.status_code == 422
        assert "password contains" not in said.text


def test_the_first_start_gives_a_link_that_works_once(fresh: Settings, fresh_server: str) -> None:
    path = manage.set_up_path(fresh)
    assert path is not None
    form = {"name": "Olga Owner", "password": PASSWORD, "again": PASSWORD}
    with Dashboard(fresh_server) as stranger, Dashboard(fresh_server) as late:
        assert all("Nobody can sign in yet" in stranger.get(page).text for page in ("/admin", "/admin/sign-in"))
        assert "Set up this server" in stranger.get(path).text
        assert stranger.enter(path, **{**form, "again": "something else"}).status_code == 422
        assert stranger.enter(path, **{**form, "password": "short", "again": "short"}).status_code == 422
        assert "Olga Owner" in stranger.enter(path, **form).text
        assert late.get(path).status_code == 401
        assert "Nobody can sign in yet" not in late.get("/admin").text
        assert late.enter(path, **{**form, "name": "Late"}).status_code == 401
    assert manage.set_up_path(fresh) is None


def test_an_older_set_up_link_ends_with_the_next_start(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    older, newer = manage.set_up_path(settings), manage.set_up_path(settings)
    with running_server(settings) as url, Dashboard(url) as stranger:
        assert stranger.get(str(older)).status_code == 401
        assert stranger.get(str(newer)).status_code == 200


def test_the_set_up_link_ends_when_somebody_has_been_added(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    path = manage.set_up_path(settings)
    assert path is not None
    with running_server(settings) as url, Dashboard(url) as late:
        assert late.get(path).status_code == 200
        manage.add_experimenter(settings, "Olga")
        form = {"name": "Late", "password": PASSWORD, "again": PASSWORD}
        assert (late.get(path).status_code, late.enter(path, **form).status_code) == (401, 401)
    assert [person["name"] for person in manage.list_experimenters(settings)] == ["Olga"]


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
        assert "was not saved" not in wrong.text  # nobody had a text to lose
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
        assert paula.enter("/admin/sign-in", name="Paula", password=PASSWORD).status_code == 200
        seen_from[0] = "192.0.2.3"  # the same for a few guesses of each of many names
        statuses = [stranger.enter("/admin/sign-in", name=f"P{n}", password="guess").status_code for n in range(11)]
        assert statuses == [401] * 10 + [429]
        seen_from[0] = "192.0.2.4"
        assert [stranger.get(f"/admin/login/{n}").status_code for n in range(11)] == [401] * 10 + [429]
        seen_from[0] = "192.0.2.5"  # and for who found a browser in which somebody is signed in
        ends = [paula.act("/admin/account/sessions/end-all", current="guess").status_code for _ in range(6)]
        assert ends == [422] * 5 + [429]


def test_forms_for_strangers_are_taken_from_our_own_pages_only(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    path = str(manage.set_up_path(settings))
    form = {"name": "Olga Owner", "password": PASSWORD, "again": PASSWORD}
    with running_server(settings) as url, Dashboard(url) as page, httpx.Client(base_url=url) as elsewhere:
        for token in ({}, {"form_token": "guess"}, {"form_token": ""}):
            for cookies in ({}, {"entry": "another"}):
                header = {"Cookie": "; ".join(f"{name}={value}" for name, value in cookies.items())}
                assert elsewhere.post(path, data={**form, **token}, headers=header).status_code == 403
                signing_in = {key: value for key, value in form.items() if key != "again"}
                sign_in = elsewhere.post("/admin/sign-in", data={**signing_in, **token}, headers=header)
                assert sign_in.status_code == 403
                resumed = elsewhere.post("/resume", data={"resume_code": "a-b-c", **token}, headers=header)
                assert resumed.status_code == 403
        assert manage.set_up_path(settings) is not None
        path = str(manage.set_up_path(settings))
        assert "Olga Owner" in page.enter(path, **form).text
        assert (
            page.post("/resume", data={"resume_code": "a-b-c", "form_token": page.cookies["entry"]}).status_code == 404
        )


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


def test_a_stranger_at_the_set_up_page_learns_no_names(small_server: str, small: Settings) -> None:
    manage.add_experimenter(small, "Known Name")
    with Dashboard(small_server) as stranger:
        answers = {
            stranger.enter("/admin/setup/guessed", name=name, password=word, again=word).text.replace(name, "NAME")
            for name, word in (("Known Name", PASSWORD), ("Nobody", PASSWORD), ("Nobody", "short"))
        }
    assert len(answers) == 1
    assert "not valid any more" in answers.pop()


def test_who_signs_out_gets_the_sign_in_which_can_be_loaded_again(small_server: str, small: Settings) -> None:
    with signed_in(small_server, small, "Ruth") as ruth:
        assert str(ruth.get("/admin/sign-in").url) == f"{small_server}/admin"
        left = ruth.act("/admin/logout")
        assert (left.status_code, str(left.url)) == (200, f"{small_server}/admin/sign-in")
        assert ruth.get("/admin/sign-in?to=/admin/audit").status_code == 200


def test_an_address_with_fields_that_is_refused_is_not_taken_for_a_text_that_was_lost(small_server: str) -> None:
    with Dashboard(small_server) as stranger:
        page = stranger.get("/admin?sort=name")
        assert (page.status_code, "not saved" in page.text) == (401, False)


def test_who_has_signed_in_in_another_window_comes_to_the_page_that_was_asked_for(
    server: str, settings: Settings
) -> None:
    with signed_in(server, settings, "Eva Windows", "experimenter") as eva:
        for to, leads_to in (("/admin/files", "/admin/files"), ("//example.org/", "/admin")):
            assert eva.get("/admin/sign-in", params={"to": to}).url.path == leads_to
