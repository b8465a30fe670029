"""A headless Chromium by Playwright: the distribution's own browser, one page of it."""

from __future__ import annotations

import contextlib
import inspect
import os
import shutil
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from waiting import until

_NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
#: WebGL by software, so that the scene in 3D is drawn on a machine without a GPU, too.
_ARGUMENTS = [
    "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--disable-dev-shm-usage",  # a container's may be too small
    # Without a GPU frames are painted by SwiftShader, slower than Skia on the CPU. WebGL needs it.
    "--disable-gpu-compositing", "--disable-gpu-rasterization",
]  # fmt: skip
_PATIENCE_MS = 300_000


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
    """One page. said: what it complained about; asked: every address it loaded or wanted to."""

    def __init__(self, context: Any) -> None:
        self.context = context
        self.page = context.new_page()
        self.page.set_default_timeout(_PATIENCE_MS)
        self.said: list[str] = []
        self.asked: list[str] = []
        self.page.on("console", lambda message: self._keep(message.text))
        self.page.on("pageerror", lambda error: self.said.append(str(error)))
        self.page.on("request", lambda request: self.asked.append(request.url))

    def _keep(self, text: str) -> None:
        if "GPU stall" not in text:  # SwiftShader's driver about a frame that is read back
            self.said.append(text)

    def open(self, path: Path, hash_text: str = "") -> float:
        """Load a file as if new; returns seconds until its load event."""
        self.page.goto("about:blank")
        self.asked.clear()
        start = time.perf_counter()
        self.page.goto(path.resolve().as_uri() + hash_text)
        return time.perf_counter() - start

    def js(self, expression: str) -> Any:
        """The JSON value of an expression."""
        return self.page.evaluate(expression)

    def until(self, expression: str) -> None:
        """Wait for an expression to be true.

        Asked again and again from here: Playwright's own wait evaluates text inside the page, which
        the page's policy forbids.
        """
        until(lambda: self.js(expression), expression)

    def key(self, name: str) -> None:
        """Press a key such as ArrowRight."""
        self.page.keyboard.press(name)

    def move_mouse(self, x: float, y: float) -> None:
        """Point at a place of the window, in CSS pixels."""
        self.page.mouse.move(x, y)

    def resize(self, width: int, height: int = 900) -> None:
        """The window's size in CSS pixels."""
        self.page.set_viewport_size({"width": width, "height": height})

    def prefer(self, scheme: str) -> None:
        """Dark or light."""
        self.page.emulate_media(color_scheme=scheme)

    def picture(self, selector: str | None = None) -> bytes:
        """The window, or the first element that a selector finds, as PNG."""
        if selector:
            return self.page.locator(selector).first.screenshot()
        return self.page.screenshot()

    def pdf(self) -> bytes:
        """The page as it prints."""
        return self.page.pdf(prefer_css_page_size=True, print_background=True)


def _innermost_frames(_context: int = 1) -> list[inspect.FrameInfo]:
    """As inspect.stack, of the last eight calls and without source lines."""
    found: list[inspect.FrameInfo] = []
    frame = sys._getframe(1)
    while frame is not None and len(found) < 8:
        code = frame.f_code
        found.append(
            inspect.FrameInfo(frame, code.co_filename, frame.f_lineno, code.co_name, None, None)
        )
        frame = frame.f_back
    return found


@contextlib.contextmanager
def _short_stacks() -> Iterator[None]:
    """Playwright reads the whole stack and its source at each call, to name the call in errors.

    Below pytest that took three times the CPU of the call itself.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(inspect, "stack", _innermost_frames)
        yield


@contextlib.contextmanager
def browser(**options: Any) -> Iterator[Browser]:
    """A browser that ends with the block; options: of the context, such as has_touch."""
    sync_api = pytest.importorskip(
        "playwright.sync_api", reason="Playwright is not installed: pip install playwright"
    )
    with _short_stacks(), sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=chromium_path(), args=_ARGUMENTS, timeout=_PATIENCE_MS
        )
        try:
            yield Browser(chromium.new_context(**options))
        finally:
            chromium.close()
