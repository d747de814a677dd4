"""Browsers besides Chromium, each by the protocol that its own driver speaks."""

from __future__ import annotations

import base64
import json
import os
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar

import cv2
import httpx
import numpy as np
from numpy.typing import NDArray

PATIENCE_S = 300  # with a browser that starts on a busy machine
MINI_BROWSERS = "/usr/lib/*/webkit2gtk-4*/MiniBrowser"  # that WebKitGTK is driven in


class Remote:
    """A browser that does what WebDriver names; `tell` sends a command by the browser's own protocol."""

    process: subprocess.Popen[bytes]

    def tell(self, command: str, **parameters: Any) -> Any:
        raise NotImplementedError

    def open(self, url: str) -> None:
        self.tell("Navigate", url=url)

    def run(self, script: str) -> Any:
        return self.tell("ExecuteScript", script=f"return {script}", args=[])

    def wait_for(self, condition: str) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            if self.run(condition):
                return
            time.sleep(0.05)
        raise RuntimeError(f"{condition} does not come true; it shows {self.run('document.body.innerText')!r}")

    def press_key(self, key: str) -> None:
        actions = [{"type": "keyDown", "value": key}, {"type": "keyUp", "value": key}]
        self.tell("PerformActions", actions=[{"type": "key", "id": "keyboard", "actions": actions}])

    def press_mouse(self, x: int, y: int) -> None:
        self._press(x, y, "mouse")

    def tap(self, selector: str) -> None:
        """Put a finger on the middle of the first of what a selector of CSS names and is shown."""
        box = (
            f"[...document.querySelectorAll({selector!r})].find((one) => one.checkVisibility()).getBoundingClientRect()"
        )
        x, y = self.run(f"(({{ x, y, width, height }}) => [x + width / 2, y + height / 2])({box})")
        self._press(round(x), round(y), "touch")

    def _press(self, x: int, y: int, kind: str) -> None:
        actions = [
            {"type": "pointerMove", "x": x, "y": y, "duration": 0},
            {"type": "pointerDown", "button": 0},
            {"type": "pointerUp", "button": 0},
        ]
        pointer = {"type": "pointer", "id": kind, "parameters": {"pointerType": kind}, "actions": actions}
        self.tell("PerformActions", actions=[pointer])

    def picture(self) -> NDArray[np.uint8]:
        """The window, uint8 (H, W), grey levels."""
        return self._decoded(cv2.IMREAD_GRAYSCALE)

    def colour_picture(self) -> NDArray[np.uint8]:
        """The window, uint8 (H, W, 3), RGB."""
        return self._decoded(cv2.IMREAD_COLOR)[..., ::-1]

    def _decoded(self, flag: int) -> NDArray[np.uint8]:
        png = base64.b64decode(self.tell("TakeScreenshot"))
        return np.asarray(cv2.imdecode(np.frombuffer(png, np.uint8), flag), np.uint8)

    def close(self) -> None:
        self.process.terminate()
        self.process.wait(30)


class Firefox(Remote):
    """Firefox without a screen, by Marionette, whose packets are JSON with their length before them."""

    PREFERENCES: ClassVar[dict[str, Any]] = {
        "marionette.port": 0,
        "media.autoplay.default": 0,
        "dom.send_after_paint_to_content": True,
        "privacy.reduceTimerPrecision": False,
        "browser.shell.checkDefaultBrowser": False,
    }

    def __init__(self, program: str, folder: Path, size: tuple[int, int], **preferences: int) -> None:
        port = free_port()
        preferences = {**self.PREFERENCES, **preferences, "marionette.port": port}
        lines = [f"user_pref({json.dumps(name)}, {json.dumps(value)});" for name, value in preferences.items()]
        (folder / "user.js").write_text("\n".join(lines))
        command = [program, "--headless", "--marionette", "--profile", str(folder), "--no-remote"]
        environment = {**os.environ, "MOZ_HEADLESS_WIDTH": str(size[0]), "MOZ_HEADLESS_HEIGHT": str(size[1])}
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment)
        with connected(port) as connection:
            self.stream = connection.makefile("rwb")
        self.number = 0
        self._receive()  # a greeting
        self.tell("NewSession")
        self.tell("SetWindowRect", width=size[0], height=size[1])

    def tell(self, command: str, **parameters: Any) -> Any:
        self.number += 1
        message = json.dumps([0, self.number, f"WebDriver:{command}", parameters]).encode()
        self.stream.write(str(len(message)).encode() + b":" + message)
        self.stream.flush()
        _, _, error, result = self._receive()
        if error:
            raise RuntimeError(f"{command}: {error['message']}")
        return result.get("value") if isinstance(result, dict) else result

    def close(self) -> None:
        self.stream.close()
        super().close()

    def _receive(self) -> Any:
        length = b""
        while (digit := self.stream.read(1)) != b":":
            length += digit
        return json.loads(self.stream.read(int(length)))


class WebKit(Remote):
    """WebKitGTK by its WebDriver, on a display that has no screen (`virtual_display`)."""

    ROUTES: ClassVar[dict[str, tuple[str, str]]] = {
        "Navigate": ("POST", "url"),
        "ExecuteScript": ("POST", "execute/sync"),
        "PerformActions": ("POST", "actions"),
        "TakeScreenshot": ("GET", "screenshot"),
        "SetWindowRect": ("POST", "window/rect"),
    }

    def __init__(self, driver: str, display: str, size: tuple[int, int]) -> None:
        port = free_port()
        environment = {**os.environ, "DISPLAY": display, "GDK_BACKEND": "x11", "WEBKIT_DISABLE_COMPOSITING_MODE": "1"}
        command = [driver, f"--port={port}"]
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment)
        connected(port).close()
        self.client = httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=PATIENCE_S)
        (browser,) = Path("/").glob(MINI_BROWSERS[1:])
        options = {"binary": str(browser), "args": ["--automation"]}
        wanted = {"capabilities": {"alwaysMatch": {"webkitgtk:browserOptions": options}}}
        self.path = f"/session/{self._value('POST', '/session', wanted)['sessionId']}"
        self.tell("SetWindowRect", width=size[0], height=size[1])

    def tell(self, command: str, **parameters: Any) -> Any:
        method, name = self.ROUTES[command]
        return self._value(method, f"{self.path}/{name}", parameters)

    def _value(self, method: str, path: str, parameters: dict[str, Any]) -> Any:
        answer = self.client.request(method, path, json=parameters if method == "POST" else None)
        value = answer.json()["value"]
        if answer.is_error:
            raise RuntimeError(f"{path}: {value['error']}: {value['message']}")
        return value

    def close(self) -> None:
        self.client.delete(self.path)
        self.client.close()
        super().close()


@contextmanager
def virtual_display() -> Iterator[str]:
    """The name of a display without a screen."""
    program = shutil.which("Xvfb")
    assert program is not None
    receiving, sending = os.pipe()
    command = [program, "-displayfd", str(sending), "-screen", "0", "1280x800x24", "-nolisten", "tcp"]
    process = subprocess.Popen(command, pass_fds=[sending], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    os.close(sending)
    try:
        with os.fdopen(receiving) as told:
            yield f":{told.readline().strip()}"
    finally:
        process.terminate()
        process.wait(30)


def free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port: int = free.getsockname()[1]
        return port


def connected(port: int) -> socket.socket:
    """A connection to a browser that has just been started."""
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        try:
            return socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
        except OSError:
            time.sleep(0.1)
    raise RuntimeError("the browser does not open its port within a minute")
