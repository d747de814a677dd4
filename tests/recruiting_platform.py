"""A small recruiting platform: it sends people in by a link with their id, and pays who comes back right."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any
from urllib.parse import parse_qs, urlencode

import httpx

HOST = "https://platform.test"
OPTIONS = {
    "id": "PERSON",
    "keep": ["TASK"],
    "random_codes": True,
    "complete_url": f"{HOST}/complete?person={{id}}&task={{TASK}}&code={{code}}",
    "screened_out_url": f"{HOST}/screened-out?person={{id}}",
    "no_consent_url": f"{HOST}/no-consent?person={{id}}",
    "full_url": f"{HOST}/full?person={{id}}",
    "redirect_after_s": 1,
}


class Platform:
    """A WSGI app on `HOST`; `states` says how each person came back, and `codes` by which code."""

    def __init__(self) -> None:
        self.states: dict[str, str] = {}
        self.codes: dict[str, str] = {}

    def link(self, study: str, person: str) -> str:
        """The address by which a person is sent in."""
        self.states.setdefault(person, "sent in")
        return f"{study}?{urlencode({'PERSON': person, 'TASK': 'task-7', 'UNASKED': 'x y'})}"

    def __call__(self, environ: dict[str, Any], start: Callable[..., Any]) -> Iterable[bytes]:
        given = {name: values[0] for name, values in parse_qs(environ["QUERY_STRING"]).items()}
        person, way = given.get("person", ""), environ["PATH_INFO"].strip("/")
        is_right = person in self.states and (way != "complete" or ("code" in given and given.get("task") == "task-7"))
        if is_right:
            self.states[person] = way
            self.codes |= {person: given["code"]} if way == "complete" else {}
        start("200 OK" if is_right else "400 Bad Request", [("Content-Type", "text/html")])
        return [b"<!doctype html><title>Platform</title><h1>Welcome back</h1>"]

    def receive(self, url: str) -> httpx.Response:
        """What a browser gets that was sent back to the platform."""
        assert url.startswith(f"{HOST}/")
        with httpx.Client(transport=httpx.WSGITransport(app=self)) as browser:
            return browser.get(url)
