"""Nothing that reaches a participant tells what is compared."""

from __future__ import annotations

import re
from typing import Any
from uuid import uuid4

import clips
import httpx
import pytest

SECRETS = (*clips.APPROACHES, "ball", "box", "depth", "fusion", clips.TITLE)


@pytest.fixture
def overheard(client: httpx.Client) -> list[bytes]:
    """Every byte of every answer, headers too."""
    heard: list[bytes] = []

    def listen(answer: httpx.Response) -> None:
        answer.read()
        heard.append(b"\n".join(name + b": " + value for name, value in answer.headers.raw) + b"\n\n" + answer.content)

    client.event_hooks["response"].append(listen)
    return heard


def test_no_answer_names_a_dataset_or_a_condition(
    client: httpx.Client, overheard: list[bytes], study: dict[str, Any]
) -> None:
    client.get("/")
    page = client.get(f"/s/{study['invitation']}").text
    for linked in sorted(set(re.findall(r'(?:href|src)="(/static/[^"]+)"', page))):
        assert client.get(linked).status_code == 200
    admission = {"invitation": study["invitation"]}
    client.post(f"/api/v1/studies/{study['slug']}/sessions", json=admission)
    client.put("/api/v1/session/stages/introduction", json={"data": {}})
    while (answer := client.get("/api/v1/session/trials/next")).status_code == 200:
        trial = answer.json()
        for url in (trial["media"]["url"], *trial["media"]["singles"]):
            assert client.get(url).status_code == 200
        client.put(f"/api/v1/session/trials/{trial['trial']}/vote", json={"id": "wrong"})
        viewing = {"first_shown": trial["first_shown"], "shown_ms": 1, "response_ms": 1, "switches": []}
        body = {"id": str(uuid4()), "choice": "b", "viewing": viewing}
        client.put(f"/api/v1/session/trials/{trial['trial']}/vote", json=body)
    client.get("/api/v1/session")
    client.get("/api/v1/studies/nothing/votes")
    assert len(overheard) > 30
    for secret in SECRETS:
        told = [
            heard[:300] for heard in overheard if re.search(rb"(?<![\w-])" + secret.encode() + rb"(?![\w-])", heard)
        ]
        assert not told, f"{secret!r} in {told[0]!r}"


def test_participants_cannot_read_results(participant: httpx.Client, study: dict[str, Any]) -> None:
    for name in ("", "/votes", "/trials", "/scores", "/triads", "/analysis"):
        assert participant.get(f"/api/v1/studies/{study['slug']}{name}").status_code == 401
    token = participant.cookies["session"]
    bearer = {"Authorization": f"Bearer {token}"}
    assert participant.get("/api/v1/studies", headers=bearer).status_code == 401
    assert participant.get("/admin").status_code == 401
