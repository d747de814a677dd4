"""Scripts that leave a browser one way of showing a pair."""

from __future__ import annotations

from playwright.sync_api import Page

NO_STACKED = r"""{
const canPlay = HTMLMediaElement.prototype.canPlayType;
HTMLMediaElement.prototype.canPlayType = function (type) {
    return /avc1\.640032|vp09|av01/.test(type) ? "" : canPlay.call(this, type);
}; }"""
NO_DECODER = "delete window.VideoDecoder;"
MISSING = {"stacked": "", "webcodecs": NO_STACKED, "two videos": NO_STACKED + NO_DECODER}


def leave_only(page: Page, technique: str) -> None:
    """Take away what the page would rather use."""
    page.add_init_script(MISSING[technique])
