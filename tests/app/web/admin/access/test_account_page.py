"""What experimenters change about themselves: the password, the second factor, where they are signed in."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from itertools import count
from pathlib import Path

import pyotp
import pytest

from app.main import running_server
from app.operations.studies import manage
from app.settings import Settings
from app.web.admin.access import account_page, sign_in_page
from tests.app.web.admin.dashboard_client import PASSWORD, Dashboard, signed_in

pytestmark = pytest.mark.slow


def test_a_changed_password_ends_the_other_sessions(small_server: str, small: Settings) -> None:
    with signed_in(small_server, small, "Pia") as here, Dashboard(small_server) as there:
        assert here.act("/admin/account/password", password=PASSWORD, again=PASSWORD).status_code == 200
        there.enter("/admin/sign-in", name="Pia", password=PASSWORD)
        assert "Studies" in there.get("/admin").text
        again = {"password": PASSWORD + "!", "again": PASSWORD + "!"}
        assert here.act("/admin/account/password", current="wrong", **again).status_code == 422
        assert here.act("/admin/account/password", current=PASSWORD, password="short", again="short").status_code == 422
        assert here.act("/admin/account/password", current=PASSWORD, **again).status_code == 200
        assert there.get("/admin").status_code == 401


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
        assert here.act("/admin/account/sessions/end", session=of_there[1], current="wrong").status_code == 422
        assert here.act("/admin/account/sessions/end-all").status_code == 422
        here.act("/admin/account/sessions/end", session=of_there[1], current=PASSWORD)
        assert [each.get("/admin").status_code for each in (here, there, other)] == [200, 401, 200]
        here.act("/admin/account/sessions/end-all", current=PASSWORD)
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
        confirm = "/admin/account/second-factor/confirm"
        assert tess.act(confirm, code="000000", current=PASSWORD).status_code == 422
        step = totp.timecode(datetime.now(UTC))
        assert tess.act(confirm, code=totp.generate_otp(step), current="wrong").status_code == 422
        shown = tess.act(confirm, code=totp.generate_otp(step), current=PASSWORD).text
        assert away.get("/admin").status_code == 401  # other sessions have ended
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
    with Dashboard(small_server) as tess, Dashboard(small_server) as away:
        tess.enter("/admin/sign-in", name="Tess", password=PASSWORD, code=codes[1])
        away.enter("/admin/sign-in", name="Tess", password=PASSWORD, code=codes[2])
        assert "7 recovery codes are left" in tess.get("/admin/account").text
        assert tess.act("/admin/account/second-factor/end", current="wrong").status_code == 422
        assert tess.act("/admin/account/second-factor/end", current=PASSWORD).status_code == 200
        assert [each.get("/admin").status_code for each in (tess, away)] == [200, 401]
    assert may_enter("")


def test_codes_after_a_right_password_are_tried_a_few_times_only_from_all_addresses_together(
    small_server: str, small: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    addresses = count()
    for module in (sign_in_page, account_page):
        monkeypatch.setattr(module, "address", lambda _request: f"guesser {next(addresses)}")
    with signed_in(small_server, small, "Uma") as uma:
        uma.act("/admin/account/password", password=PASSWORD, again=PASSWORD)
        secret = re.findall(r"<code>([A-Z2-7]{32})</code>", uma.act("/admin/account/second-factor").text)[0]
        totp = pyotp.TOTP(secret)
        step = totp.timecode(datetime.now(UTC))
        uma.act("/admin/account/second-factor/confirm", code=totp.generate_otp(step), current=PASSWORD)
    with Dashboard(small_server) as guesser:
        entry = {"name": "Uma", "password": PASSWORD}
        assert guesser.enter("/admin/sign-in", **entry, code=totp.generate_otp(step + 1)).status_code == 200
    with Dashboard(small_server) as guesser:
        wrong = [guesser.enter("/admin/sign-in", **entry, code="000000").status_code for _ in range(11)]
        assert wrong == [*[401] * 10, 429]
        assert guesser.enter("/admin/sign-in", name="Uma", password="wrong").status_code == 401
    with signed_in(small_server, small, "Olaf Owner", "owner") as owner:
        assert owner.get("/admin/audit").text.count("second factor refused") == 10


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
        assert (
            ada.act("/admin/account/second-factor/confirm", code=pyotp.TOTP(secret).now(), current=PASSWORD).status_code
            == 200
        )
        assert ada.get("/admin/users").status_code == 200
