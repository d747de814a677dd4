"""Storage of a browser that never answers, as WebKit's sometimes does: the study goes on from memory, and says so."""

from __future__ import annotations

import pytest
from playwright.sync_api import Page, expect

from tests.browser.study_visitor import Study, Visitor

pytestmark = pytest.mark.browser

NO_OPENING = "IDBFactory.prototype.open = () => new EventTarget();"
NO_WRITING = """{
const open = IDBDatabase.prototype.transaction;
IDBDatabase.prototype.transaction = function (store, mode, ...rest) {
  const transaction = open.call(this, store, mode, ...rest);
  if (mode !== "readwrite") return transaction;
  return { objectStore: () => ({ put() {}, delete() {} }) };
}; }"""
NO_LOCKS = "LockManager.prototype.request = () => new Promise(() => {});"
REFUSED = "IDBFactory.prototype.open = () => { throw new DOMException('', 'SecurityError'); };"
LONGEST_STEP_MS = 10_000  # two seconds for each wait, on a busy machine


@pytest.mark.parametrize(
    "broken", [NO_OPENING, NO_WRITING, NO_LOCKS, REFUSED], ids=["open hangs", "put hangs", "locks hang", "refused"]
)
def test_storage_that_never_answers_does_not_stop_the_study(
    broken: str, study: Study, page: Page, visitor: Visitor
) -> None:
    page.add_init_script(broken)
    page.set_default_timeout(LONGEST_STEP_MS)
    visitor.begin(study)
    for key in ("1", "2", "3"):
        visitor.votes(key)
    visitor.sees("thanks")
    assert [vote["choice"] for vote in study.votes(3)] == ["a", "none", "b"]
    expect(page.locator("#not-stored")).to_be_visible(visible=broken != NO_LOCKS)
