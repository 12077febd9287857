"""Touch, mouse and keyboard input to hold the throttle and press STOP."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from tests.browser.conftest import centre
from tests.browser.device import Device

if TYPE_CHECKING:
    from playwright.sync_api import CDPSession, Locator, Page

STOPPED_S = 1.0  # generous, as the test tool shares the processor; latency: test_bench_page.py

HOLDING, STOPPING = 0, 1  # fingers


class Hands:
    """Multi-touch, mouse and keyboard input on a page."""

    def __init__(self, page: Page, device: Device) -> None:
        self._page, self._device = page, device
        self._line: CDPSession = page.context.new_cdp_session(page)
        self._fingers: dict[int, tuple[float, float]] = {}

    def touch(self, finger: int, position: tuple[float, float]) -> None:
        self._fingers[finger] = position
        self._send("touchStart")

    def lift(self, finger: int) -> None:
        self._fingers.pop(finger, None)
        self._send("touchEnd")

    def _send(self, kind: str) -> None:
        points = [{"id": finger, "x": x, "y": y} for finger, (x, y) in self._fingers.items()]
        self._line.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    def stop_by(self, way: str) -> float:
        """Press STOP without release; return the wall time just before."""
        position = centre(self._page.locator(".stop-button"))
        if "mouse" in way:
            self._page.mouse.move(*position)
        return self.press(way, position)

    def press(self, way: str, position: tuple[float, float]) -> float:
        """Press at a position, where the mouse is already; return the wall time just before."""
        pressed = time.time()
        if way == "mouse":
            self._page.mouse.down()
        elif way == "second mouse button":
            self._page.mouse.down(button="right")
        elif way == "touch":
            self.touch(STOPPING, position)
        else:
            self._page.keyboard.down(way)
        return pressed

    def let_go(self) -> None:
        """Release all fingers, buttons and keys."""
        self._page.mouse.up()
        self._page.mouse.up(button="right")
        for finger in list(self._fingers):
            self.lift(finger)
        for key in ("Escape", " "):
            self._page.keyboard.up(key)

    @contextmanager
    def turning(self) -> Iterator[None]:
        """Press the throttle button with a finger until motors turn; release it at the end."""
        button = self._page.locator(".hold-button:not([disabled])")
        button.wait_for()
        for _ in range(6):
            self.touch(HOLDING, centre(button))
            deadline = time.monotonic() + 2.0
            while time.monotonic() < deadline and self._device.turning_us() < 1100.0:
                self._page.wait_for_timeout(10)
            if self._device.turning_us() >= 1100.0:
                break
            self.lift(HOLDING)
        assert self._device.turning_us() >= 1100.0, self._device.orders[-5:]
        try:
            yield
        finally:
            self.let_go()

    def stops(self, way: str) -> None:
        """Press STOP and check for zero throttle at the device while the fingers stay."""
        pressed = self.stop_by(way)
        assert self._device.stopped_after(pressed) < STOPPED_S, way
        self._page.wait_for_timeout(100)
        assert self._device.turning_us() <= 1000.0, way


def drag(page: Page, slider: Locator) -> None:
    """Start to drag a slider."""
    slider.scroll_into_view_if_needed()
    x, y = centre(slider)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 8.0, y)


def visible(page: Page, selector: str) -> list[Locator]:
    return [element for element in page.locator(selector).all() if element.is_visible()]


def click(element: Locator) -> None:
    """Click by script, as a finger holds the throttle."""
    element.evaluate("element => element.click()")
