"""No client begins sessions, or sends data for one, without limit; and what a server writes is for its user alone."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from limits import RateLimitItemPerHour

from app.errors import TooManyError
from app.main import running_server
from app.operations.studies import manage
from app.operations.studies.create import create_study
from app.settings import Settings
from app.web import gates
from app.web.limits.throttle import PIECE, REMARKS, SIGN_INS_AS, Throttle

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    return Settings(data_dir=tmp_path_factory.mktemp("limited"), sessions_per_minute=3)


@pytest.fixture(scope="module")
def study(own: Settings, stimulus_set: Path) -> dict[str, Any]:
    return create_study(own, stimulus_set, "Limited", exposure_s=0.4, seed=1)


@pytest.fixture
def client(own: Settings, study: dict[str, Any]) -> Iterator[httpx.Client]:  # noqa: ARG001 (it is on the server)
    with running_server(own) as url, httpx.Client(base_url=url, timeout=30) as client:
        yield client


def begin(client: httpx.Client, study: dict[str, Any]) -> httpx.Response:
    return client.post(f"/api/v1/studies/{study['slug']}/sessions", json={"invitation": study["invitation"]})


def test_one_address_begins_so_many_sessions_a_minute(client: httpx.Client, study: dict[str, Any]) -> None:
    assert [begin(client, study).status_code for _ in range(4)] == [201, 201, 201, 429]
    assert int(begin(client, study).headers["retry-after"]) > 0


def test_a_session_sends_so_much_data_an_hour(
    client: httpx.Client, study: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gates, "SENT_PIECES", RateLimitItemPerHour(4))
    begin(client, study).raise_for_status()
    large = {"data": {"x": "y" * 2 * PIECE}}
    sent = [client.put("/api/v1/session/stages/interview", json=large).status_code for _ in range(3)]
    assert sent == [404, 404, 429]  # this study has no interview
    assert client.put("/api/v1/session/stages/introduction", json={}).status_code == 200


def test_a_page_tells_the_log_so_many_things_a_minute(client: httpx.Client, study: dict[str, Any]) -> None:
    remark = {"invitation": study["invitation"], "why": "films"}
    path = f"/api/v1/studies/{study['slug']}/turned-away"
    told = [client.post(path, json=remark).status_code for _ in range(REMARKS.amount + 1)]
    assert (set(told[:-1]), told[-1]) == ({204}, 429)


def test_what_people_brought_lies_in_folders_of_the_servers_user(own: Settings, client: httpx.Client) -> None:
    assert client.get("/healthz").status_code == 200
    modes = {path.name: path.stat().st_mode & 0o777 for path in own.private_dirs}
    assert modes == dict.fromkeys(("intake", "models", "reports", "stills", "uploads", "work"), 0o700)
    assert Path(own.data_dir / "study.sqlite").stat().st_mode & 0o777 == 0o600


def test_a_clock_that_is_set_makes_nobody_wait_for_hours(monkeypatch: pytest.MonkeyPatch) -> None:
    throttle, now = Throttle(), time.time()
    for _ in range(SIGN_INS_AS.amount):
        throttle.count(SIGN_INS_AS, "address")
    with pytest.raises(TooManyError):
        throttle.count(SIGN_INS_AS, "address")
    monkeypatch.setattr(time, "time", lambda: now - 3600)
    for _ in range(SIGN_INS_AS.amount):
        throttle.count(SIGN_INS_AS, "address")
    with pytest.raises(TooManyError) as refused:
        throttle.count(SIGN_INS_AS, "address")
    assert refused.value.retry_after_s <= 60


def test_guessing_invitations_is_slowed_down(tmp_path: Path) -> None:
    with running_server(Settings(data_dir=tmp_path)) as url, httpx.Client(base_url=url, timeout=60) as stranger:
        body = {"invitation": "guess"}
        answers = [stranger.post("/api/v1/studies/any/sessions", json=body) for _ in range(31)]
        assert {answer.status_code for answer in answers[:30]} == {404}
        assert answers[30].status_code == 429
        assert answers[30].json()["status"] == 429


def test_guessing_tokens_is_slowed_down(tmp_path: Path) -> None:
    with running_server(Settings(data_dir=tmp_path)) as url, httpx.Client(base_url=url, timeout=60) as stranger:
        bearer = {"Authorization": "Bearer guess"}
        statuses = [stranger.get("/api/v1/studies", headers=bearer).status_code for _ in range(31)]
        assert statuses == [401] * 30 + [429]


def test_all_addresses_of_an_ipv6_client_count_as_one(tmp_path: Path) -> None:
    with running_server(Settings(data_dir=tmp_path)) as url, httpx.Client(base_url=url, timeout=60) as stranger:
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
