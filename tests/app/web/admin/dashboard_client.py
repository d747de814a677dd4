"""An experimenter at the dashboard, who sends forms as a browser would."""

from __future__ import annotations

import html
import io
import re
import threading
import time
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
from playwright.sync_api import Page

from app.operations.studies import manage
from app.settings import Settings
from app.store.access.rights import Role

LONGEST_WORK_S = 120
PASSWORD = "correct horse battery"


class Dashboard(httpx.Client):
    """A browser in which somebody may be signed in; `act` sends a form with the token that its page carries."""

    def __init__(self, server: str) -> None:
        super().__init__(base_url=server, timeout=60, follow_redirects=True, headers={"Accept": "text/html"})

    @property
    def form_token(self) -> str:
        field = re.search(r'name="form_token" value="([^"]+)"', self.get("/admin/account").text)
        assert field, "nobody is signed in"
        return field[1]

    def act(self, path: str, **fields: Any) -> httpx.Response:
        return self.post(path, data={"form_token": self.form_token, **fields})

    def results(self, path: str, **params: str) -> str:
        """The results page once the newest votes are analysed: it waits a moment for them, then shows older results."""
        return self._without("being analysed;", path, params)

    def design(self, path: str, **params: Any) -> str:
        """The design page once the orders are checked: it waits a moment for that, too."""
        return self._without("being checked", path, params)

    def _without(self, words: str, path: str, params: dict[str, Any]) -> str:
        until = time.monotonic() + LONGEST_WORK_S
        while words in (page := self.get(path, params=params).text) and time.monotonic() < until:
            time.sleep(0.1)
        return page

    def enter(self, path: str, **fields: Any) -> httpx.Response:
        """Send a form for who has no session: sign-in or set-up."""
        if "entry" not in self.cookies:
            self.get("/admin")
        return self.post(path, data={"form_token": self.cookies["entry"], **fields})


@contextmanager
def signed_in(server: str, settings: Settings, name: str, role: Role | None = None) -> Iterator[Dashboard]:
    with Dashboard(server) as dashboard:
        dashboard.enter(manage.add_experimenter(settings, name, role)["path"])
        yield dashboard


def sign_in(page: Page, settings: Settings, name: str = "Dora Example") -> None:
    """Sign an owner in by a new link, in a real browser."""
    page.goto(manage.add_experimenter(settings, name)["path"])
    page.get_by_role("button", name="Sign in").click()
    page.wait_for_url("**/admin")


def ends(dashboard: Dashboard, path: str) -> httpx.Response:
    """Wait for the end of some work, which a thread of this process does; the page that comes then."""
    for thread in threading.enumerate():
        if thread.name == f"task-{path.rpartition('/')[2]}":
            thread.join(LONGEST_WORK_S)
    answer = dashboard.get(path)
    assert 'http-equiv="refresh"' not in answer.text, f"{path}: the work does not end"
    return answer


def link_of(page: httpx.Response, text: str) -> str:
    """Where a link or button of a page leads."""
    link = re.search(rf'href="([^"]+)">{re.escape(text)}</a>', page.text)
    assert link, f"{page.url} has no link {text!r}"
    return html.unescape(link[1])


def until(lines: Iterator[str], text: str) -> None:
    """Read a stream as far as a text."""
    assert any(text in line for line in lines), f"{text!r} never came"


def zipped(files: dict[str, bytes]) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return content.getvalue()


def files_of(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
