"""Pair videos that others send: nginx as deploy/ describes it, or an object store."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import fsspec
import httpx
import pytest
from playwright.sync_api import Browser

from app.films.object_store import MediaStore
from app.main import running_server
from app.operations.studies import create
from app.settings import Settings
from app.simulation.participants import begin
from tests.app.web.admin.dashboard_client import sign_in
from tests.object_store import BUCKET, object_store
from tests.study_server import free_port

KEYS = {"AWS_ACCESS_KEY_ID": "key", "AWS_SECRET_ACCESS_KEY": "secret"}
DEPLOY = Path(__file__).parents[3] / "deploy"
START_TIMEOUT_S = 60
CONNECT_RETRIES = 7  # with growing pauses of 0.5 s, 1 s, ..., so about half a minute in all
ALL_FILMS_ARE_THERE = "() => [...document.querySelectorAll('video')].every((film) => film.readyState === 4)"


def media_of_first_trial(client: httpx.Client, study: dict[str, Any]) -> str:
    begin(client, study["slug"], study["invitation"])
    return str(client.get("/api/v1/session/trials/next").json()["media"]["url"])


AS_NAMED = {"Host": "study.example.org"}  # the server_name of deploy/nginx.conf


@contextmanager
def nginx(folder: Path, settings: Settings, server: str) -> Iterator[str]:
    """nginx with the configuration of deploy/, on a free port and without TLS."""
    program = shutil.which("nginx")
    if program is None:
        pytest.skip("nginx is not installed here")
    port = free_port()
    text = (DEPLOY / "nginx.conf").read_text(encoding="utf-8")
    changes = {
        "listen 80;": f"listen 127.0.0.1:{free_port()};",
        "listen 443 ssl http2;": f"listen 127.0.0.1:{port};",
        "listen 80 default_server;": f"listen 127.0.0.1:{free_port()} default_server;",
        "listen 443 ssl default_server;": f"listen 127.0.0.1:{port} default_server;",
        "listen [::]:": "# an IPv6 address that this machine may not have: ",
        "    ssl_certificate ": "    # ",
        "    ssl_certificate_key ": "    # ",
        "/var/www/html": str(folder / "acme"),
        "server 127.0.0.1:8000;": f"server {server.removeprefix('http://')};",
        "/var/lib/reconstudy/pairs/": f"{settings.media_dir.absolute()}/",
    }
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    user = "user root;" if os.geteuid() == 0 else ""
    outer = (
        f"{user} daemon off; pid {folder}/pid; error_log stderr; events {{}} http {{ default_type video/mp4; {text} }}"
    )
    (folder / "nginx.conf").write_text(outer, encoding="utf-8")
    command = [program, "-p", str(folder), "-c", str(folder / "nginx.conf"), "-e", "stderr"]
    subprocess.run([*command, "-t"], check=True)
    process = subprocess.Popen(command)
    try:
        with httpx.Client(transport=httpx.HTTPTransport(retries=CONNECT_RETRIES)) as client:
            client.get(f"http://127.0.0.1:{port}/healthz", headers=AS_NAMED)
        yield f"http://127.0.0.1:{port}"
    finally:
        process.terminate()
        process.wait(START_TIMEOUT_S)


@pytest.mark.slow
def test_nginx_sends_the_videos_and_keeps_the_inner_addresses_inside(stimulus_set: Path, tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path / "data", media_accel="/pairs/", public_url="http://study.example.org")
    study = create.create_study(settings, stimulus_set, "Proxied")
    with (
        running_server(settings) as server,
        nginx(tmp_path, settings, server) as proxy,
        httpx.Client(base_url=proxy, timeout=30, headers=AS_NAMED) as client,
    ):
        with pytest.raises(httpx.RemoteProtocolError):
            httpx.get(f"{proxy}/healthz", headers={"Host": "evil.example"})
        url = media_of_first_trial(client, study)
        bare = httpx.get(server + url)
        assert bare.content == b""
        whole = client.get(url)
        assert whole.headers["etag"] == bare.headers["etag"]
        assert whole.headers["cache-control"] == "private, max-age=31536000, immutable"
        assert whole.headers["content-type"] == "video/mp4"
        assert "x-accel-redirect" not in whole.headers
        for name in ("x-content-type-options", "cross-origin-resource-policy", "content-security-policy"):
            assert whole.headers.get_list(name) == [bare.headers[name]]
        part = client.get(url, headers={"Range": "bytes=5-14"})
        assert (part.status_code, part.content) == (206, whole.content[5:15])
        assert client.get(url, headers={"Range": "bytes=99999999-"}).status_code == 416
        head = client.head(url)
        assert (head.content, head.headers["content-length"]) == (b"", str(len(whole.content)))
        assert client.get(url, headers={"If-None-Match": whole.headers["etag"]}).status_code == 304
        file = bare.headers["x-accel-redirect"]
        assert [client.get(path).status_code for path in (file, "/readyz", "/pairs/")] == [404] * 3
        assert "reconstudy_requests_total" in client.get("/metrics").text
        elsewhere = httpx.HTTPTransport(local_address="127.0.0.2")
        with httpx.Client(base_url=proxy, headers=AS_NAMED, transport=elsewhere) as stranger:
            assert [stranger.get(path).status_code for path in ("/metrics", "/healthz")] == [403, 200]
        assert client.get("/healthz").json() == {"status": "ok"}
        plain = re.search(r"listen (127\.0\.0\.1:\d+);", (tmp_path / "nginx.conf").read_text())
        assert plain
        in_the_clear = [
            httpx.get(f"http://{plain[1]}{path}", headers=AS_NAMED) for path in ("/admin", "/api/v1/studies")
        ]
        assert [answer.status_code for answer in in_the_clear] == [301, 403]
        challenge = ".well-known/acme-challenge/token"
        (tmp_path / "acme" / challenge).parent.mkdir(parents=True)
        (tmp_path / "acme" / challenge).write_text("proof", encoding="utf-8")
        assert httpx.get(f"http://{plain[1]}/{challenge}", headers=AS_NAMED).text == "proof"


@pytest.fixture
def bucket() -> Iterator[str]:
    with object_store() as endpoint:
        yield endpoint


@pytest.mark.slow
def test_browsers_are_sent_to_a_signed_address_of_the_object_store(
    bucket: str, stimulus_set: Path, tmp_path: Path
) -> None:
    settings = Settings(data_dir=tmp_path, media_url=f"s3://{BUCKET}/pairs")
    study = create.create_study(settings, stimulus_set, "Stored")
    assert MediaStore(f"s3://{BUCKET}/pairs").upload(settings.media_dir.glob("*.mp4")) == 0
    with running_server(settings) as server, httpx.Client(base_url=server, timeout=30) as client:
        url = media_of_first_trial(client, study)
        answer = client.get(url)
        assert answer.status_code == 307
        assert answer.headers["location"].startswith(f"{bucket}/{BUCKET}/pairs/")
        assert "Signature" in answer.headers["location"]
        assert answer.headers["cache-control"] == "private, max-age=1800"
        part = client.get(url, headers={"Range": "bytes=0-3"}, follow_redirects=True)
        assert (part.status_code, len(part.content)) == (206, 4)
        policy = client.get(f"/s/{study['invitation']}").headers["content-security-policy"].split("; ")
        assert f"connect-src 'self' {bucket}" in policy
        assert f"media-src 'self' blob: {bucket}" in policy


@pytest.mark.browser
@pytest.mark.slow
@pytest.mark.usefixtures("bucket")
def test_the_dashboard_plays_films_from_the_object_store(browser: Browser, stimulus_set: Path, tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path, media_url=f"s3://{BUCKET}/pairs")
    study = create.create_study(settings, stimulus_set, "Stored")
    base = f"/admin/studies/{study['slug']}"
    with running_server(settings) as server, httpx.Client(base_url=server, timeout=30) as client:
        begin(client, study["slug"], study["invitation"])
        trial = client.get("/api/v1/session/trials/next").json()["trial"]
        page = browser.new_page(base_url=server)
        page.set_default_timeout(20_000)
        sign_in(page, settings)
        page.goto(f"{base}/votes/{trial}")
        page.wait_for_function(ALL_FILMS_ARE_THERE)
        page.goto(f"{base}/stimuli")
        page.get_by_role("button", name="Play").first.click()
        page.wait_for_function("() => document.querySelector('video').currentTime > 0")
        page.close()


def test_a_public_host_serves_under_the_same_names() -> None:
    store = MediaStore("https://cdn.example.org/pairs/")
    assert store.address("x.mp4") == "https://cdn.example.org/pairs/x.mp4"
    assert store.origin == "https://cdn.example.org"
    assert store.upload([Path("/nowhere.mp4")]) == 0


@pytest.mark.parametrize(
    ("url", "complaint"), [("memory://pairs", "gives no addresses"), ("xyz://a", "Protocol not known")]
)
def test_a_store_that_browsers_cannot_reach_is_refused(url: str, complaint: str) -> None:
    with pytest.raises(ValueError, match=f"RECONSTUDY_MEDIA_URL.*{complaint}"):
        MediaStore(url)


@pytest.mark.slow
@pytest.mark.parametrize(("keys", "complaint"), [({}, "Unable to locate credentials"), (KEYS, "Could not connect to")])
def test_a_store_without_its_keys_or_its_host_is_named_in_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, keys: dict[str, str], complaint: str
) -> None:
    """Its package's errors are of no kind that a command expects."""
    for name in KEYS:
        monkeypatch.delenv(name, raising=False)
    for name, value in {**keys, "AWS_EC2_METADATA_DISABLED": "true", "AWS_MAX_ATTEMPTS": "1"}.items():
        monkeypatch.setenv(name, value)
    nowhere = f"http://127.0.0.1:{free_port()}"
    monkeypatch.setitem(fsspec.config.conf, "s3", {"endpoint_url": nowhere})
    (tmp_path / "film.mp4").touch()
    with pytest.raises(ValueError, match=f"RECONSTUDY_MEDIA_URL=s3://bucket/pairs: {complaint}"):
        MediaStore("s3://bucket/pairs").upload([tmp_path / "film.mp4"])
