"""A researcher starts a reconstruction in the browser, watches it, and has its result, without a terminal."""

from __future__ import annotations

from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from app.main import running_server
from app.operations.jobs.command import LOG, job_folder
from app.settings import Settings
from app.store.database.engine import open_database
from app.store.database.keys import utc_now
from app.store.queue import JobProgress, NewJob, end_job, enqueue, take_job, tell_progress
from tests.app.web.admin.dashboard_client import sign_in

pytestmark = [pytest.mark.browser, pytest.mark.slow]

WORKER = "laboratory 4711"
IS_AT_END = "(log) => log.scrollTop + log.clientHeight >= log.scrollHeight - 1"


def test_a_live_log_stays_where_it_is_read_and_follows_at_its_end(browser: Browser, tmp_path: Path) -> None:
    here = Settings(data_dir=tmp_path)
    with running_server(here) as url:
        database = open_database(here.url)
        with database.writing() as connection:
            job = enqueue(connection, NewJob("segment", {}, "captures/ball"), "Olga", utc_now())
        take_job(database, WORKER, ("segment",), utc_now())
        job_folder(here, job).mkdir(parents=True)

        def add_lines(step: str, first: int, last: int) -> None:
            with (job_folder(here, job) / LOG).open("a") as log:
                log.writelines(f"line {number}\n" for number in range(first, last))
            tell_progress(database, WORKER, job, JobProgress(step, 1, 2, None))

        add_lines("masks", 0, 300)
        page = browser.new_page(base_url=url)
        sign_in(page, here)
        page.goto(f"/admin/work/{job}")
        log = page.locator(".log")
        add_lines("more masks", 300, 400)
        expect(log).to_contain_text("line 399")
        assert log.evaluate(IS_AT_END)
        log.focus()
        log.evaluate("(log) => log.scrollTo(0, 500)")
        add_lines("still more masks", 400, 450)
        expect(page.get_by_text("still more masks")).to_be_visible()
        assert log.evaluate("(log) => log.scrollTop") == 500
        expect(log).to_contain_text("line 399\n", use_inner_text=True)
        expect(log).to_be_focused()
        end_job(database, WORKER, job, "failed", "out of memory", utc_now())
        expect(page.get_by_role("button", name="Try again")).to_be_visible()
        expect(log).to_have_js_property("scrollTop", 500)  # the page's script comes after what it shows
        page.close()
        database.dispose()
