"""What axe says of a page."""

from __future__ import annotations

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page

SERIOUS = ("serious", "critical")

# What fades in is pale until then; what is to appear after seconds is not waited for.
ARRIVED = """Promise.all(document.getAnimations()
    .filter(one => one.effect.getComputedTiming().endTime < 1500).map(one => one.finished))"""


def check_accessibility(page: Page) -> None:
    page.evaluate(ARRIVED)
    results = Axe().run(page).response
    serious = [violation for violation in results["violations"] if violation["impact"] in SERIOUS]
    assert serious == []
