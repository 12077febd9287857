"""The world of the fault matrix with faults at random times, watched for motors that turn without a
live host. A bench on a terminal or a TCP port lives in a thread, in real time.
"""

from __future__ import annotations

import random
import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from tests.faults.cell import WATCHDOG_S
from tests.faults.dialects import TURNING_US
from tests.faults.loop import Hangs, World
from tests.faults.proxy import Fault
from tests.system.served import DeviceTime

OLDEST_S = 0.5  # an order of the bench protocol that is older turns nothing
ALLOWED_S = 0.03  # what the steps of host, links and device add to those times

NAP_S = 0.001

REAL = ("pty", "tcp")

FAULTS = {
    "drop": 4, "corrupt": 4, "duplicate": 3, "reorder": 3, "truncate": 3, "stall": 4, "hush": 1,
    "cut": 1,
}  # fmt: skip
"""What can go wrong, with weights: the last three hold lines back for a while and deliver them at
once, lose all of both directions for good, and pull the cable."""

MOST = {"host": 100, "device": 20}
"""Most lines on their way there that one fault takes; a choice, as are the weights and the longest
stall."""

LONGEST_STALL_S = 1.5


class SoakWorld(World):
    """One device behind proxies whose faults come at random times.

    Args:
        kind: one of `LINKS`; those in `REAL` are on the wall's clock.
        every_s: mean time between two faults; inf for none.

    Attributes:
        unsafe: moments at which motors turned without a live host, with why.
        turned_s: how long motors turned.
        struck: how many faults of each kind began.
    """

    def __init__(self, kind: str, seed: int, every_s: float) -> None:
        self.kind, self.is_real, self._every_s = kind, kind in REAL, every_s
        self._rng, self._device_time = random.Random(seed), DeviceTime()
        self.unsafe: list[str] = []
        self.turned_s, self.struck = 0.0, Counter(dict.fromkeys(FAULTS, 0))
        super().__init__([], link=kind, seed=seed, now_s=self._device_time())
        self._deadline_s = self.now_s + (60.0 if self.is_real else 900.0)
        self._strike_s = self.now_s + self._wait()

    def _wait(self) -> float:
        return self._every_s * self._rng.expovariate(1.0)

    def step(self, step_s: float = 0.005) -> None:
        if self.now_s >= self._strike_s and self.left_s is None:
            self._strike_s += self._wait()
            self._rng.choice(self.proxies).faults.append(self._fault())
        super().step(step_s)
        if self.pulses[-1][1] >= TURNING_US:
            self.turned_s += step_s
            self._judge()

    def _fault(self) -> Fault:
        """Return a fault that begins now."""
        kind = self._rng.choices(list(FAULTS), list(FAULTS.values()))[0]
        self.struck[kind] += 1
        if kind in ("hush", "cut"):
            return Fault("cut" if kind == "cut" else "drop", phase="connect")
        way = self._rng.choice(("host", "device"))
        if kind == "stall":
            return Fault(kind, "connect", way=way, for_s=self._rng.uniform(0.05, LONGEST_STALL_S))
        times, seed = self._rng.randint(1, MOST[way]), self._rng.getrandbits(30)
        return Fault(kind, "connect", way=way, times=times, seed=seed)

    def _judge(self) -> None:
        """Note motors that turn although no live host wants it."""
        unheard_s, age_s = self.now_s - self.proxy.heard_s, self.now_s - self.proxy.written_s
        oldest_s = WATCHDOG_S + (LONGEST_STALL_S if self.kind == "mavlink" else OLDEST_S)
        if unheard_s > WATCHDOG_S + ALLOWED_S:
            self.unsafe.append(f"{self.now_s:.3f}: turning, nothing heard for {unheard_s:.3f} s")
        elif age_s > oldest_s + ALLOWED_S:
            self.unsafe.append(f"{self.now_s:.3f}: turning on what is {age_s:.3f} s old")
        elif self.left_s is not None and self.now_s > self.left_s + oldest_s + ALLOWED_S:
            self.unsafe.append(f"{self.now_s:.3f}: turning after the host left")

    def wait(self, seconds: float, step_s: float = 0.005) -> None:
        super().wait(seconds, 0.005)

    @contextmanager
    def hosting(self) -> Iterator[None]:
        if not self.is_real:
            with super().hosting():
                yield
            return
        ended = threading.Event()

        def live() -> None:
            try:
                while not ended.wait(NAP_S):
                    self.step(self._device_time() - self.now_s)
            except Hangs:
                self.unsafe.append("the run hangs")
                self.close()

        thread = threading.Thread(target=live)
        self.proxy.connect()
        thread.start()
        try:
            yield
        finally:
            self.left_s = self.now_s
            ended.set()
            thread.join()
