"""Firefox by its own protocol, Marionette."""

from __future__ import annotations

import base64
import json
import os
import socket
import subprocess
import time
from pathlib import Path
from typing import Any, ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

PATIENCE_S = 300  # with a browser that starts on a busy machine


class Firefox:
    """A browser without a screen; its packets are JSON with their length before them."""

    PREFERENCES: ClassVar[dict[str, Any]] = {
        "marionette.port": 0,
        "media.autoplay.default": 0,
        "dom.send_after_paint_to_content": True,
        "privacy.reduceTimerPrecision": False,
        "browser.shell.checkDefaultBrowser": False,
    }

    def __init__(self, program: str, folder: Path, size: tuple[int, int]) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        preferences = {**self.PREFERENCES, "marionette.port": port}
        lines = [f"user_pref({json.dumps(name)}, {json.dumps(value)});" for name, value in preferences.items()]
        (folder / "user.js").write_text("\n".join(lines))
        command = [program, "--headless", "--marionette", "--profile", str(folder), "--no-remote"]
        environment = {**os.environ, "MOZ_HEADLESS_WIDTH": str(size[0]), "MOZ_HEADLESS_HEIGHT": str(size[1])}
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment)
        self.stream = self._connect(port)
        self.number = 0
        self._receive()  # a greeting
        self.tell("WebDriver:NewSession")
        self.tell("WebDriver:SetWindowRect", width=size[0], height=size[1])

    def _connect(self, port: int) -> Any:
        for _ in range(600):
            try:
                return socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S).makefile("rwb")
            except OSError:
                time.sleep(0.1)
        raise RuntimeError("Firefox does not open its port within a minute")

    def tell(self, command: str, **parameters: Any) -> Any:
        self.number += 1
        message = json.dumps([0, self.number, command, parameters]).encode()
        self.stream.write(str(len(message)).encode() + b":" + message)
        self.stream.flush()
        _, _, error, result = self._receive()
        if error:
            raise RuntimeError(f"{command}: {error['message']}")
        return result.get("value") if isinstance(result, dict) else result

    def _receive(self) -> Any:
        length = b""
        while (digit := self.stream.read(1)) != b":":
            length += digit
        return json.loads(self.stream.read(int(length)))

    def open(self, url: str) -> None:
        self.tell("WebDriver:Navigate", url=url)

    def run(self, script: str) -> Any:
        return self.tell("WebDriver:ExecuteScript", script=f"return {script}", args=[])

    def wait_for(self, condition: str) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            if self.run(condition):
                return
            time.sleep(0.05)
        raise RuntimeError(f"Firefox: {condition} does not come true; it shows {self.run('document.body.innerText')!r}")

    def press_key(self, key: str) -> None:
        actions = [{"type": "keyDown", "value": key}, {"type": "keyUp", "value": key}]
        self.tell("WebDriver:PerformActions", actions=[{"type": "key", "id": "keyboard", "actions": actions}])

    def press_mouse(self, x: int, y: int) -> None:
        actions = [
            {"type": "pointerMove", "x": x, "y": y, "duration": 0},
            {"type": "pointerDown", "button": 0},
            {"type": "pointerUp", "button": 0},
        ]
        self.tell("WebDriver:PerformActions", actions=[{"type": "pointer", "id": "mouse", "actions": actions}])

    def picture(self) -> NDArray[np.uint8]:
        """The window, uint8 (H, W), grey levels."""
        return self._decoded(cv2.IMREAD_GRAYSCALE)

    def colour_picture(self) -> NDArray[np.uint8]:
        """The window, uint8 (H, W, 3), RGB."""
        return self._decoded(cv2.IMREAD_COLOR)[..., ::-1]

    def _decoded(self, flag: int) -> NDArray[np.uint8]:
        png = base64.b64decode(self.tell("WebDriver:TakeScreenshot", full=False))
        return np.asarray(cv2.imdecode(np.frombuffer(png, np.uint8), flag), np.uint8)

    def close(self) -> None:
        self.process.terminate()
        self.process.wait(30)
