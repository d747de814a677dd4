"""Participants whose tabs, connections and server die at random, in a real browser with the page's own outbox.

Each tab claims its session, puts votes into the outbox as the page does and says so once they are kept. What was kept
must be in the database in the end, once, whatever happened in between.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Sequence, Set
from contextlib import suppress
from dataclasses import dataclass, field
from random import Random
from typing import Any
from urllib.parse import urlsplit

from playwright.async_api import BrowserContext, Error, Page, Route, ViewportSize, async_playwright
from sqlalchemy import select

from app.store.database.engine import open_database
from app.store.database.tables import trial, vote
from tests.conftest import BROWSER_OPTIONS, browser_path
from tests.seeded_studies import Voter
from tests.study_server import ROOT, StudyServer

TAB = """<!doctype html><meta charset="utf-8"><title>A tab</title><script type="module">
import { Outbox, openShelf, newId } from "/static/js/outbox.js";
import { claim, takeOver } from "/static/js/tabs.js";

const owner = "OWNER";
let isMine = true;
const lost = () => (isMine = false);
const outbox = new Outbox(await openShelf(), owner);
if (!(await claim(owner, lost))) await takeOver(owner, lost);
const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

window.voteOn = async (trials) => {
  for (const [trial, first_shown] of trials) {
    if (!isMine) return;
    const choice = ["a", "b", "none"][Math.floor(3 * Math.random())];
    const viewing = { first_shown, shown_ms: 1, response_ms: 1, switches: [] };
    const vote = { id: newId(), choice, viewing };
    await tried(trial, vote.id, choice);
    await outbox.putVote(trial, vote);
    kept(trial);
    if (Math.random() < 0.2) outbox.putVote(trial, vote); // pressed twice
    await Promise.race([outbox.emptied().catch(() => {}), pause(20)]);
  }
};
window.emptied = () => outbox.emptied();
window.isReady = true;
</script>"""
READY_S = 30
PROGRESS_S = 120  # until so many votes were kept as are waited for below
KILL_SERVER_VOTES = (30, 150)  # that all participants' pages keep between kills
DISTURB_VOTES = (5, 40)  # that one participant's pages keep until something happens to them
OFFLINE_VOTES = (1, 10)
SMALL = ViewportSize(width=320, height=200)
OVERLAP = 3  # trials that a new tab votes on although the one before may have


@dataclass
class Seen:
    """What happened, and what the pages said: votes that were tried, and trials whose vote was kept."""

    tried: set[tuple[str, str, str]] = field(default_factory=set)
    kept: set[str] = field(default_factory=set)
    happened: Counter[str] = field(default_factory=Counter)
    changed: asyncio.Condition = field(default_factory=asyncio.Condition)

    async def keep(self, trial: str) -> None:
        async with self.changed:
            self.kept.add(trial)
            self.changed.notify_all()

    async def wait_for_more(self, n_votes: int, trials: Set[str]) -> None:
        """Wait until votes on so many more of these trials were kept, or on all of them."""
        n_wanted = min(len(self.kept & trials) + n_votes, len(trials))
        async with self.changed, asyncio.timeout(PROGRESS_S):
            await self.changed.wait_for(lambda: len(self.kept & trials) >= n_wanted)


async def vote_in_chaos(server: StudyServer, voters: Sequence[Voter], rng: Random, *, at_once: int = 5) -> Seen:
    """Let voters vote on all their trials while tabs, connections and the server die; then let every outbox empty."""
    seen, places = Seen(), asyncio.Semaphore(at_once)
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(executable_path=browser_path(), args=BROWSER_OPTIONS)

        async def sit_down(voter: Voter) -> None:
            async with places:
                context = await browser.new_context(viewport=SMALL)
                await _participate(context, server, voter, seen, Random(rng.random()))
                await context.close()

        killing = asyncio.create_task(_kill_again_and_again(server, voters, seen, rng))
        try:
            await asyncio.gather(*(sit_down(voter) for voter in voters))
        finally:
            killing.cancel()
            await browser.close()
        with suppress(asyncio.CancelledError):
            await killing  # raises what ended it before its time
    return seen


def compare(url: str, seen: Seen) -> dict[str, int]:
    """What is stored beside what pages had kept: lost, stored twice, or stored as nobody voted."""
    database = open_database(url)
    with database.reading() as connection:
        rows = connection.execute(select(trial.c.public_id, vote.c.client_id, vote.c.choice).join(trial)).all()
    database.dispose()
    times = Counter(row.public_id for row in rows)
    return {
        "kept": len(seen.kept),
        "stored": len(rows),
        "lost": sum(times[public_id] == 0 for public_id in seen.kept),
        "doubled": sum(n > 1 for n in times.values()),
        "wrong": sum(tuple(row) not in seen.tried for row in rows),
    }


async def _participate(context: BrowserContext, server: StudyServer, voter: Voter, seen: Seen, rng: Random) -> None:
    await context.add_cookies([{"name": "session", "value": voter.token, "url": server.base_url}])
    await context.expose_function("tried", lambda *vote: seen.tried.add(vote))
    await context.expose_function("kept", seen.keep)
    body = TAB.replace("OWNER", voter.token[:12])

    async def answer(route: Route) -> None:
        await route.fulfill(body=body, content_type="text/html")

    async def answer_script(route: Route) -> None:
        await route.fulfill(path=ROOT / urlsplit(route.request.url).path[1:], content_type="text/javascript")

    await context.route(f"{server.base_url}/tab", answer)  # a tab opens whether or not the server lives
    await context.route(f"{server.base_url}/static/js/*", answer_script)
    await context.new_page()  # its window stays: opening one takes longer than a tab
    tabs: list[Page] = []
    trials = [public_id for public_id, _ in voter.trials]
    while not seen.kept.issuperset(trials):
        n_done = next(number for number, public_id in enumerate(trials) if public_id not in seen.kept)
        tabs.append(await _open_tab(context, server))
        await tabs[-1].evaluate("(trials) => { voteOn(trials); }", voter.trials[max(0, n_done - OVERLAP) :])
        await _disturb(context, tabs, seen, rng, set(trials))
    await context.set_offline(False)
    last = await _open_tab(context, server)
    await last.evaluate("emptied()")


async def _open_tab(context: BrowserContext, server: StudyServer) -> Page:
    """A tab whose scripts are there; another one as long as the server dies on the way."""
    while True:
        tab = await context.new_page()
        try:
            await tab.goto(f"{server.base_url}/tab")
            await tab.wait_for_function("() => window.isReady === true", timeout=1000 * READY_S)
            return tab
        except Error:
            await tab.close()


async def _disturb(context: BrowserContext, tabs: list[Page], seen: Seen, rng: Random, trials: Set[str]) -> None:
    """Let things happen until a tab is gone, a second one is due, or every vote was kept."""
    while not seen.kept >= trials:
        await seen.wait_for_more(rng.randint(*DISTURB_VOTES), trials)
        what = rng.choice(("offline", "crash", "close", "second tab"))
        seen.happened[what] += 1
        if what == "offline":
            await context.set_offline(True)
            await seen.wait_for_more(rng.randint(*OFFLINE_VOTES), trials)
            await context.set_offline(False)
            continue
        if what != "second tab" or len(tabs) > 1:
            for tab in tabs:
                await _end(tab, by_crash=what == "crash")
            tabs.clear()
        return


async def _end(tab: Page, *, by_crash: bool) -> None:
    if by_crash:
        session = await tab.context.new_cdp_session(tab)
        async with tab.expect_event("crash"):
            crash: Any = asyncio.ensure_future(session.send("Page.crash"))  # is never answered
            crash.add_done_callback(lambda done: done.cancelled() or done.exception())
    await tab.close()


async def _kill_again_and_again(server: StudyServer, voters: Sequence[Voter], seen: Seen, rng: Random) -> None:
    trials = {public_id for voter in voters for public_id, _ in voter.trials}
    while not seen.kept >= trials:
        await seen.wait_for_more(rng.randint(*KILL_SERVER_VOTES), trials)
        await asyncio.to_thread(server.kill)
        seen.happened["server killed"] += 1
