"""An experimenter in real Chromium, from the set-up link to the downloads, while two participants vote."""

from __future__ import annotations

import re
import shutil
import threading
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from app.main import running_server
from app.operations.studies import manage
from app.settings import Settings
from app.simulation.participants import begin, next_trial, pass_stages, vote

expect.set_options(timeout=60_000)  # the first votes load the analysis
pytestmark = [pytest.mark.browser, pytest.mark.slow]

VENDOR = Path(__file__).parents[4] / "static" / "vendor"
PASSWORD = "correct horse battery"


@pytest.fixture
def own(tmp_path: Path, stimulus_set: Path) -> Settings:
    settings = Settings(data_dir=tmp_path / "server")
    shutil.copytree(stimulus_set.parent, settings.sets_dir / "tiny")
    return settings


@pytest.fixture
def own_server(own: Settings) -> Iterator[str]:
    with running_server(own) as url:
        yield url


LONG_CONSENT = """field => {
  field.value = "您可以随时退出研究。".repeat(1000);
  field.dispatchEvent(new Event("input", { bubbles: true }));
}"""  # 90 kB in a form


@pytest.fixture
def page(browser: Browser, own_server: str) -> Iterator[Page]:
    """A page on which nothing may fail and no policy may be violated."""
    complaints: list[str] = []
    context = browser.new_context(base_url=own_server, viewport={"width": 1366, "height": 768})
    context.set_default_timeout(60_000)
    page = context.new_page()
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    yield page
    context.close()
    assert complaints == []


def test_an_experimenter_runs_a_study_from_the_set_up_link_to_the_figures(
    page: Page, own: Settings, own_server: str
) -> None:
    if not VENDOR.is_dir():
        pytest.skip("the browser packages are not installed; `make setup` does it where npm's registry is reachable")
    set_up(page, str(manage.set_up_path(own)))
    create(page)
    link = invite(page)
    watch(page, own_server, link)
    exclude(page)
    download(page)


def set_up(page: Page, path: str) -> None:
    page.goto(path)
    page.get_by_label("Your name").fill("Olga Owner")
    page.get_by_label("A password").fill(PASSWORD)
    page.get_by_label("The password again").fill(PASSWORD)
    page.get_by_role("button", name="Begin").click()
    expect(page.get_by_role("heading", name="Studies")).to_be_visible()


def create(page: Page) -> None:
    page.get_by_role("link", name="New study").click()
    page.get_by_role("link", name="tiny").click()
    page.get_by_label("Name shown to participants").fill("Spring")
    page.get_by_label("Seconds a pair or film is shown").fill("0.4")
    with page.expect_response(lambda answer: len(answer.request.post_data or "") > 90_000):
        page.locator("[name=consent]").evaluate(LONG_CONSENT)
    expect(page.get_by_text("Kept as you type.")).to_be_visible()
    page.get_by_role("button", name="Create").click()
    page.wait_for_url("**/admin/studies/spring", timeout=60_000)
    page.get_by_role("button", name="Open to participants").click()
    expect(page.get_by_role("button", name="Pause")).to_be_visible()


def invite(page: Page) -> str:
    page.get_by_role("link", name="Invitations").click()
    page.get_by_label("Participants each").fill("2")
    page.get_by_role("button", name="Make invitations").click()
    link = page.locator(".invitations .code").first.text_content()
    assert link
    return link.rsplit("/", 1)[1]


def watch(page: Page, server: str, code: str) -> None:
    """Two participants vote in other threads; the page follows without being loaded again."""
    page.get_by_role("link", name="Overview").click()
    expect(page.get_by_text("Nobody has begun yet")).to_be_visible()
    page.evaluate("window.isTheSamePage = true")
    first, second = (Participant(server, code, seed) for seed in (1, 2))
    first.vote(2)
    expect(page.get_by_text("2 of 6", exact=True)).to_be_visible()
    second.vote(6)
    expect(page.get_by_text("6 of 6", exact=True)).to_be_visible()
    first.vote(4)
    expect(page.get_by_text("6 of 6", exact=True)).to_have_count(2)
    assert page.evaluate("window.isTheSamePage")


class Participant:
    """Somebody who votes as told, in a thread of their own: this one drives the browser."""

    def __init__(self, server: str, code: str, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._client = httpx.Client(base_url=server)
        self._session: dict[str, Any] = {}
        self._run(lambda: self._session.update(begin(self._client, "spring", code)))

    def vote(self, times: int) -> None:
        def work() -> None:
            for _ in range(times):
                trial = next_trial(self._client, self._session["token"])
                assert trial is not None
                vote(self._client, self._session["token"], trial, "a", self._rng)
            if next_trial(self._client, self._session["token"]) is None:
                pass_stages(self._client, self._session | {"stage": "finished"})
                self._client.close()

        self._run(work)

    def _run(self, work: Any) -> None:
        thread = threading.Thread(target=work)
        thread.start()
        thread.join()


def exclude(page: Page) -> None:
    page.get_by_role("link", name="P002").click()
    page.get_by_label("Reason").fill("looked at a telephone")
    page.get_by_role("button", name="Exclude").click()
    expect(page.get_by_role("button", name="Count again")).to_be_visible()


def download(page: Page) -> None:
    page.get_by_role("link", name="Results").click()
    expect(page.get_by_text("6 votes are left out")).to_be_visible()
    page.locator(".plot").first.scroll_into_view_if_needed()
    expect(page.locator(".plot svg").first).to_be_visible()  # drawn by the browser, under the strict policy
    for kind, head in (("SVG", b"<svg"), ("PNG", b"\x89PNG"), ("PDF", b"%PDF"), ("CSV", b"comparison,")):
        with page.expect_download() as downloading:
            page.get_by_role("link", name=re.compile(f"Scores of all conditions .* as {kind}")).click()
        assert downloading.value.path().read_bytes().startswith(head)
    page.get_by_role("link", name="Overview").click()
    with page.expect_download() as downloading:
        page.get_by_role("link", name="Download everything").click()
    with zipfile.ZipFile(downloading.value.path()) as archive:
        assert "spring/SHA256SUMS" in archive.namelist()
