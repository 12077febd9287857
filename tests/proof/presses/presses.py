"""STOP pressed again and again, in every way and whatever goes on, with motors that turn.

    python -m tests.proof.presses.presses --presses 1000 --seed 1 --table build/presses.md

Each press is timed from just before it is handed to the browser to the device's own pulse at zero,
and to the order to stop at the device, all by the time of day of this machine. A run that was cut
short goes on where it was. Its last lines are the table of docs/explanation/proof.md.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tests.browser.conftest import (
    CHROMIUM,
    TIMEOUT_MS,
    centre,
    connect,
    go_to,
    serving,
)
from tests.browser.device import Device, served_device
from tests.browser.hands import Hands, click, visible
from tests.long_count import LongCount

if TYPE_CHECKING:
    from playwright.sync_api import Page

WAYS = ("mouse", "second mouse button", "touch", "Escape", " ")

BLOCK = """ms => setTimeout(() => {
  const until = performance.now() + ms;
  while (performance.now() < until);
}, 20)"""

BLOCKED_MS = (300, 1500)  # the page's main thread is busy for so long, drawn anew each time

NOWHERE = (640.0, 890.0)

STAYS_S = 0.15  # the pulse is watched for so long after it came to zero, while the finger stays

RESTARTS = 30
"""A busy machine may not get to open a dialog in time; presses then go on on a new page."""


@dataclass
class Press:
    """What one press brought.

    Attributes:
        turning_us: the device's highest pulse just before it.
        zero_s: after which time its pulses were zero; 0 where they were before.
        ordered_s: after which time the order to stop reached it.
        load: of the machine.
    """

    way: str
    going_on: str
    turning_us: float
    zero_s: float
    ordered_s: float
    load: float


class Scene:
    """The page that is connected to a device, and what can go on there while motors turn."""

    def __init__(self, page: Page, device: Device) -> None:
        connect(page, device.address)
        # What a tab does when it is first shown is no part of a press.
        go_to(page, "Sweep")
        page.locator(".ratio-plot canvas").first.wait_for()
        go_to(page, "Bench")
        page.locator(".hold-button:not([disabled])").wait_for()
        self.page, self.device, self.hands = page, device, Hands(page, device)
        # Each look at the page costs as much as a press; nothing of this moves.
        self.stop = centre(page.locator(".stop-button"))
        self.lists = [each.element_handle() for each in visible(page, ".q-select")]
        self.sliders = [centre(each) for each in visible(page, ".q-slider")]
        self.sliders = [place for place in self.sliders if place[1] < page.viewport_size["height"]]

    @contextmanager
    def streaming(self, rng: random.Random) -> Iterator[None]:
        """Let the charts stream, and nothing else happen."""
        yield

    @contextmanager
    def dragging(self, rng: random.Random) -> Iterator[None]:
        x, y = rng.choice(self.sliders)
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        self.page.mouse.move(x + 8.0, y)
        yield

    @contextmanager
    def list_open(self, rng: random.Random) -> Iterator[None]:
        rng.choice(self.lists).evaluate("element => element.click()")
        self.page.locator(".q-menu").first.wait_for()
        yield
        self.page.mouse.click(*NOWHERE)

    @contextmanager
    def dialog_open(self, rng: random.Random) -> Iterator[None]:
        click(self.page.get_by_role("tab", name="Sweep"))
        click(self.page.get_by_role("button", name="Start the sweep"))
        cancel = self.page.locator(".q-dialog").get_by_role("button", name="Cancel")
        cancel.wait_for()
        yield
        click(cancel)
        click(self.page.get_by_role("tab", name="Bench"))
        self.page.locator(".hold-button:not([disabled])").wait_for()

    @contextmanager
    def blocked(self, rng: random.Random) -> Iterator[None]:
        self.page.evaluate(BLOCK, rng.uniform(*BLOCKED_MS))
        time.sleep(rng.uniform(0.05, 0.25))
        yield


GOING_ON: dict[str, Callable[[Scene, random.Random], AbstractContextManager[None]]] = {
    "charts stream": Scene.streaming,
    "slider dragged": Scene.dragging,
    "list open": Scene.list_open,
    "dialog open": Scene.dialog_open,
    "main thread blocked": Scene.blocked,
}


def press_stop(scene: Scene, way: str, going_on: str, rng: random.Random) -> Press:
    """Turn motors by hand, let something go on, press STOP once, and see what the device does."""
    device, hands = scene.device, scene.hands
    with hands.turning(), GOING_ON[going_on](scene, rng):
        # The button of a mouse that drags is down already.
        if way == "mouse" and going_on == "slider dragged":
            way = "second mouse button"
        at = time.time()
        if "mouse" in way:
            scene.page.mouse.move(*scene.stop)
            # A page whose main thread is blocked keeps the mouse waiting, too.
            at = at if going_on == "main thread blocked" else time.time()
        turning_us = device.pulse_at(at)
        hands.press(way, scene.stop)
        zero_s, ordered_s = device.zero_after(at), device.stopped_after(at, word="stop")
        time.sleep(STAYS_S)
        rises = [since for since, us in device.pulses if since > at + zero_s and us > 1000.0]
        assert not rises, f"motors turned again {rises[0] - at:.3f} s after STOP by {way}"
    return Press(way, going_on, turning_us, zero_s, ordered_s, os.getloadavg()[0])


def order_of(count: int, rng: random.Random) -> list[tuple[str, str]]:
    """Return every way beside everything that goes on, again and again, shuffled each time."""
    pairs = [(way, going_on) for way in WAYS for going_on in GOING_ON]
    order: list[tuple[str, str]] = []
    while len(order) < count:
        order += rng.sample(pairs, len(pairs))
    return order[:count]


def table(presses: list[Press]) -> str:
    """Return the table of presses: of pulses at zero and of orders to stop."""
    rows = [
        "| | presses | with motors turning | pulse zero, ms: median | 99 % | worst "
        "| order to stop, ms: median | worst |",
        "|---|---|---|---|---|---|---|---|",
    ]

    def row(name: str, some: list[Press]) -> None:
        zeros_ms = [1000.0 * one.zero_s for one in some if one.zero_s > 0.0]
        orders_ms = [1000.0 * one.ordered_s for one in some]
        numbers = [f"{np.quantile(zeros_ms, q):.0f}" if zeros_ms else "–" for q in (0.5, 0.99, 1.0)]
        numbers += [f"{np.quantile(orders_ms, q):.0f}" if orders_ms else "–" for q in (0.5, 1.0)]
        rows.append(f"| {name} | {len(some)} | {len(zeros_ms)} | {' | '.join(numbers)} |")

    for names, key in ((WAYS, "way"), (GOING_ON, "going_on")):
        for name in names:
            some = [one for one in presses if getattr(one, key) == name]
            row({" ": "space bar"}.get(name, name), some)
    row("all", presses)
    loads = [one.load for one in presses]
    rows += ["", f"load of the machine {min(loads):.1f} to {max(loads):.1f}, mean "
             f"{np.mean(loads):.1f}, on {os.cpu_count()} cores"]  # fmt: skip
    return "\n".join(rows) + "\n"


def press_all(count: int, seed: int, notes: Path) -> list[Press]:
    """Press so often, less what is noted already; note each press."""
    from playwright.sync_api import sync_playwright

    with (
        LongCount(notes, count, "presses") as counted,
        tempfile.TemporaryDirectory() as folder,
        serving(Path(folder) / "runs", Path(folder) / "state") as web,
        served_device() as device,
        sync_playwright() as tool,
    ):
        presses = [Press(**json.loads(line)) for line in counted.lines]
        browser = tool.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"]
        )
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.set_default_timeout(TIMEOUT_MS)
        page.goto(web.url)
        page.get_by_text("this page controls", exact=True).wait_for()
        scene = Scene(page, device)
        for number, (way, going_on) in enumerate(order_of(count, random.Random(seed))):
            if number < len(presses):
                continue
            rng = random.Random(f"{seed} {number}")
            presses.append(press_stop(scene, way, going_on, rng))
            counted.add(json.dumps(asdict(presses[-1])))
        browser.close()
    return presses


def main() -> None:
    from playwright.sync_api import TimeoutError as PlaywrightTimeoutError

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--presses", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--table", type=Path, default=Path("build/presses.md"))
    given = parser.parse_args()
    given.table.parent.mkdir(parents=True, exist_ok=True)
    notes = given.table.with_suffix(".jsonl")
    for restarts in range(RESTARTS):
        try:
            presses = press_all(given.presses, given.seed, notes)
            break
        except PlaywrightTimeoutError as late:  # before STOP: what was to go on did not begin
            print(f"restart {restarts + 1}, on a new server and page: {late}", flush=True)
    else:
        raise SystemExit(f"given up after {RESTARTS} restarts; run it again to go on")
    text = table(presses)
    given.table.write_text(text)
    print(text)


if __name__ == "__main__":
    main()
