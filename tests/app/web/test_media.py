"""Pair videos over HTTP."""

from __future__ import annotations

import errno
import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import httpx
import pytest

from app.files import file_digest
from app.settings import Settings
from app.web.media import Film
from tests.app.web.http_checks import ask, is_problem


@pytest.fixture
def url(participant: httpx.Client) -> str:
    return str(participant.get("/api/v1/session/trials/next").json()["media"]["url"])


def test_a_video_is_served_whole(client: httpx.Client, url: str) -> None:
    answer = client.get(url)
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "video/mp4"
    assert answer.headers["accept-ranges"] == "bytes"
    assert answer.headers["cache-control"] == "private, max-age=31536000, immutable"
    assert answer.headers["etag"] != f'"{hashlib.sha256(answer.content).hexdigest()}"', "it would link trials"
    assert int(answer.headers["content-length"]) == len(answer.content)


@pytest.mark.parametrize(
    ("asked", "part"), [("bytes=0-9", slice(0, 10)), ("bytes=100-", slice(100, None)), ("bytes=-7", slice(-7, None))]
)
def test_a_range_is_served(client: httpx.Client, url: str, asked: str, part: slice) -> None:
    whole = client.get(url).content
    answer = client.get(url, headers={"Range": asked})
    assert answer.status_code == 206
    assert answer.content == whole[part]
    start = range(len(whole))[part][0]
    assert answer.headers["content-range"] == f"bytes {start}-{start + len(answer.content) - 1}/{len(whole)}"


def test_a_range_beyond_the_end_is_refused(client: httpx.Client, url: str) -> None:
    assert client.get(url, headers={"Range": "bytes=99999999-"}).status_code == 416


def test_a_range_of_older_content_is_answered_with_all_of_the_new(client: httpx.Client, url: str) -> None:
    headers = {"Range": "bytes=0-9", "If-Range": '"older"'}
    assert client.get(url, headers=headers).status_code == 200


def test_head_tells_the_length_without_the_content(client: httpx.Client, url: str) -> None:
    answer, whole = client.head(url), client.get(url)
    assert answer.status_code == 200
    assert answer.content == b""
    for name in ("content-length", "etag", "content-type", "accept-ranges"):
        assert answer.headers[name] == whole.headers[name]


@pytest.mark.parametrize("form", ["{}", "W/{}", '"other", {}', "*"])
def test_who_has_it_is_told_so(client: httpx.Client, url: str, form: str) -> None:
    etag = client.head(url).headers["etag"]
    answer = client.get(url, headers={"If-None-Match": form.format(etag)})
    assert answer.status_code == 304
    assert answer.content == b""
    assert answer.headers["etag"] == etag
    assert "immutable" in answer.headers["cache-control"]


def test_who_has_something_else_gets_it(client: httpx.Client, url: str) -> None:
    assert client.get(url, headers={"If-None-Match": '"other"'}).status_code == 200


def test_a_film_that_is_missing_on_the_server_is_said_and_logged(
    client: httpx.Client, url: str, settings: Settings, caplog: pytest.LogCaptureFixture
) -> None:
    sha256 = hashlib.sha256(client.get(url).content).hexdigest()
    (film,) = (path for path in settings.media_dir.iterdir() if file_digest(path) == sha256)
    film.rename(film.with_suffix(".away"))
    try:
        answer = client.get(url)
    finally:
        film.with_suffix(".away").rename(film)
    assert is_problem(answer, 404)  # which a page takes for a film that fails: an alarm, and no endless waiting
    assert "missing" in answer.json()["detail"]
    assert film.name not in answer.text  # which would tell two trials' films from each other
    assert str(film) in caplog.text
    assert client.get(url).status_code == 200


def test_films_whose_folder_is_away_may_be_asked_for_again(client: httpx.Client, url: str, settings: Settings) -> None:
    away = settings.media_dir.with_suffix(".away")
    settings.media_dir.rename(away)
    try:
        assert is_problem(client.get(url), 503)
    finally:
        away.rename(settings.media_dir)


@pytest.mark.parametrize("path", ["/media/invented", "/media/..%2fstudy.sqlite", "/media/%00"])
def test_there_is_nothing_else_in_there(client: httpx.Client, path: str) -> None:
    assert is_problem(client.get(path), 404)


def test_names_of_media_say_nothing_about_content(client: httpx.Client, url: str, study: dict[str, Any]) -> None:
    name = url.removeprefix("/media/")
    assert len(name) == 16
    assert name not in client.get(url).headers["etag"]
    assert study["slug"] not in url


preadv = os.preadv


def in_memory(file: int, buffers: list[bytearray], at: int, _flags: int) -> int:
    return preadv(file, buffers, at)


def half_in_memory(file: int, buffers: list[bytearray], at: int, _flags: int) -> int:
    return preadv(file, [memoryview(buffers[0])[: len(buffers[0]) // 2]], at)


def on_disk(*_: Any) -> int:
    raise BlockingIOError(errno.EAGAIN, "it must be waited for")


def where_nobody_can_tell(*_: Any) -> int:
    raise OSError(errno.EOPNOTSUPP, "this file system does not tell")


@pytest.mark.parametrize("where", [in_memory, half_in_memory, on_disk, where_nobody_can_tell])
def test_a_film_is_the_same_wherever_its_pieces_are(
    where: Callable[..., int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = Random(1).randbytes(2 * Film.chunk_size + 7)
    (tmp_path / "film.mp4").write_bytes(content)
    n_waited = 0

    async def in_another_thread(read: Callable[..., bytes], *arguments: int) -> bytes:
        nonlocal n_waited
        n_waited += 1
        return read(*arguments)

    monkeypatch.setattr(os, "preadv", where)
    monkeypatch.setattr("app.web.media.run_in_threadpool", in_another_thread)
    film = Film(tmp_path / "film.mp4", media_type="video/mp4")
    assert ask(film).content == content
    assert n_waited == (1 if where is in_memory else 3)  # the last piece is not whole
    start, end = 5, Film.chunk_size + 9
    assert ask(film, headers={"Range": f"bytes={start}-{end - 1}"}).content == content[start:end]
    several = ask(film, headers={"Range": f"bytes=0-2,{start}-{end - 1}"}).content
    assert content[0:3] in several
    assert content[start:end] in several
