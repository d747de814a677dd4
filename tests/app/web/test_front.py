"""The demo's front page: it leads to both sides of the study, and shows only its own pictures."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from app.experiment.demo import ABILITIES, demo_front, demo_study
from app.main import running_server
from app.settings import Settings


@pytest.fixture
def front(tmp_path: Path, stimulus_set: Path) -> Iterator[tuple[httpx.Client, dict[str, str]]]:
    """A demo that has made its study but has no votes: a client of its server, and where its page leads."""
    settings = Settings(data_dir=tmp_path / "study", database_url=None)
    demo_study(settings, stimulus_set, 0.4, lambda _done, _total, _what: None)
    folder = tmp_path / "front"
    folder.mkdir()
    (folder / "recording_S1.webp").write_bytes(b"picture")
    (tmp_path / "secret.webp").write_bytes(b"secret")
    paths = demo_front(settings, tmp_path, folder, n_frames=6)
    with running_server(settings, front=folder) as url, httpx.Client(base_url=url, timeout=60) as client:
        yield client, paths


@pytest.mark.slow
def test_the_front_page_leads_to_participants_and_experimenters(front: tuple[httpx.Client, dict[str, str]]) -> None:
    client, paths = front
    page = client.get("/")
    assert page.status_code == 200
    assert "Nobody has voted yet" in page.text
    assert all(f"/front/model_{approach}.webp" in page.text for approach in ABILITIES)
    for path in paths.values():
        assert f'href="{path}"' in page.text
        assert client.get(path, follow_redirects=True).status_code == 200
    assert client.get("/?code=abc").headers["location"] == "/s/abc"


@pytest.mark.slow
def test_the_front_page_shows_only_its_own_pictures(front: tuple[httpx.Client, dict[str, str]]) -> None:
    client, _ = front
    assert client.get("/front/recording_S1.webp").content == b"picture"
    for name in ("front.json", "..%2Fsecret.webp", "none.webp"):
        assert client.get(f"/front/{name}").status_code == 404
