"""Chromium with the few commands that `Firefox` has, for scripts that drive either."""

from __future__ import annotations

import shutil
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from playwright.sync_api import sync_playwright

ENTER = "\ue007"  # WebDriver's name of the key


class Chromium:
    """A browser without a screen."""

    def __init__(self, size: tuple[int, int]) -> None:
        program = shutil.which("chromium") or shutil.which("chromium-browser")
        if program is None:
            raise RuntimeError("no Chromium is installed")
        self._playwright = sync_playwright().start()
        self._browser = self._playwright.chromium.launch(
            executable_path=program, args=["--no-sandbox", "--disable-gpu"]
        )
        self._page = self._browser.new_page(viewport={"width": size[0], "height": size[1]})

    def open(self, url: str) -> None:
        self._page.goto(url)

    def run(self, script: str) -> Any:
        return self._page.evaluate(script)

    def press_key(self, key: str) -> None:
        self._page.keyboard.press({ENTER: "Enter", " ": "Space"}.get(key, key))

    def colour_picture(self) -> NDArray[np.uint8]:
        """The window, uint8 (H, W, 3), RGB."""
        picture = np.asarray(cv2.imdecode(np.frombuffer(self._page.screenshot(), np.uint8), cv2.IMREAD_COLOR))
        return np.asarray(picture[..., ::-1], np.uint8)

    def close(self) -> None:
        self._browser.close()
        self._playwright.stop()
