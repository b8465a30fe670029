"""A headless Chromium on a pipe: the DevTools protocol needs no package, only the browser."""

from __future__ import annotations

import base64
import contextlib
import json
import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

_NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
_PATIENCE_S = 60.0


def chromium_path() -> str:
    """LEGOWORLD_CHROMIUM or the first Chromium on the PATH; skips where there is none."""
    named = os.environ.get("LEGOWORLD_CHROMIUM")
    found = named or next((path for n in _NAMES if (path := shutil.which(n))), None)
    if found is None:
        pytest.skip(
            "no Chromium here: install one (Debian: chromium), or name it in LEGOWORLD_CHROMIUM"
        )
    return found


class Browser:
    """One page of one browser process. said: what it complained about."""

    def __init__(self, process: subprocess.Popen[bytes], to: int, out: int) -> None:
        self._process, self._to, self._out = process, to, out
        self._buffer, self._count, self._session = b"", 0, None
        self._events: list[dict[str, Any]] = []
        self.said: list[str] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """The result of a DevTools method."""
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._read()
            if answer.get("id") == self._count:
                assert "error" not in answer, f"{method}: {answer['error']}"
                return answer["result"]

    def _read(self) -> dict[str, Any]:
        while b"\0" not in self._buffer:
            piece = os.read(self._out, 1 << 20)
            assert piece, f"the browser has ended: {self._process.poll()}"
            self._buffer += piece
        text, _, self._buffer = self._buffer.partition(b"\0")
        message = json.loads(text)
        self._listen(message)
        return message

    def _listen(self, message: dict[str, Any]) -> None:
        method, parameters = message.get("method"), message.get("params", {})
        if method == "Runtime.exceptionThrown":
            self.said.append(json.dumps(parameters["exceptionDetails"])[:500])
        elif method == "Runtime.consoleAPICalled":
            self.said.append(json.dumps(parameters["args"])[:500])
        elif method == "Log.entryAdded":
            self.said.append(parameters["entry"]["text"])
        elif method == "Page.loadEventFired":
            self._events.append(message)

    def open(self, path: Path, hash_text: str = "") -> float:
        """Load a file as if new; returns seconds until its load event."""
        self._navigate("about:blank")
        return self._navigate(path.resolve().as_uri() + hash_text)

    def _navigate(self, url: str) -> float:
        self._events.clear()
        start = time.perf_counter()
        self.call("Page.navigate", url=url)
        while not self._events:
            self._read()
        return time.perf_counter() - start

    def js(self, expression: str) -> Any:
        """The JSON value of an expression."""
        found = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def until(self, expression: str) -> None:
        """Wait for an expression to be true."""
        end = time.monotonic() + _PATIENCE_S
        while time.monotonic() < end:
            if self.js(f"Boolean({expression})"):
                return
            time.sleep(0.02)
        raise AssertionError(f"never true: {expression}")

    def key(self, name: str) -> None:
        """Press a key such as ArrowRight."""
        code = {"ArrowLeft": 37, "ArrowRight": 39, "Escape": 27}[name]
        for kind in ("keyDown", "keyUp"):
            self.call(
                "Input.dispatchKeyEvent", type=kind, key=name, code=name, windowsVirtualKeyCode=code
            )

    def move_mouse(self, x: float, y: float) -> None:
        """Point at a place of the window, in CSS pixels."""
        self.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)

    def resize(self, width: int, height: int = 900) -> None:
        """The window's size in CSS pixels."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=height, deviceScaleFactor=1, mobile=False,
        )  # fmt: skip

    def prefer(self, scheme: str) -> None:
        """Dark or light."""
        feature = {"name": "prefers-color-scheme", "value": scheme}
        self.call("Emulation.setEmulatedMedia", features=[feature])

    def picture(self, clip: dict[str, float] | None = None) -> bytes:
        """The window, or a part of the page, as PNG."""
        options = {"clip": {**clip, "scale": 1}, "captureBeyondViewport": True} if clip else {}
        return base64.b64decode(
            self.call("Page.captureScreenshot", format="png", **options)["data"]
        )

    def pdf(self) -> bytes:
        """The page as it prints."""
        return base64.b64decode(self.call("Page.printToPDF")["data"])


@contextlib.contextmanager
def browser(profile: Path) -> Iterator[Browser]:
    """A browser with a profile of its own, that ends with the block."""
    down_read, down_write = os.pipe()
    up_read, up_write = os.pipe()

    def place_pipes() -> None:
        """Chromium reads commands from descriptor 3 and writes to 4."""
        os.dup2(down_read, 103)
        os.dup2(up_write, 104)
        os.dup2(103, 3)
        os.dup2(104, 4)

    arguments = ["--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-pipe"]
    arguments += ["--no-first-run", "--disable-background-networking", f"--user-data-dir={profile}"]
    process = subprocess.Popen(
        [chromium_path(), *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        preexec_fn=place_pipes,
        close_fds=False,
    )
    os.close(down_read)
    os.close(up_write)
    try:
        yield Browser(process, down_write, up_read)
    finally:
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        os.close(down_write)
        os.close(up_read)
