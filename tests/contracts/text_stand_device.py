"""Virtual device for docs/examples/text_stand.py: text protocol over simulated physics."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from benchtool.bench.serial import commands as wire
from benchtool.virtual.firmware import Firmware

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "text_stand.py"


def driver_of_the_page() -> ModuleType:
    """Return the example driver as a module."""
    module = ModuleType("text_stand")
    exec(compile(EXAMPLE.read_text("utf-8"), str(EXAMPLE), "exec"), module.__dict__)
    return module


class TextStandDevice:
    """Speak the page's lines for a virtual bench with one rotor; its watchdog is the firmware's."""

    host_since_s: float | None = None

    def __init__(self, firmware: Firmware) -> None:
        self.firmware, self.speed = firmware, firmware.hello.speed
        self._names = [channel.name for channel in firmware.hello.channels]

    def receive(self, data: bytes, now_s: float) -> bytes:
        self.firmware.note_host(now_s)
        answers = [self._answer(line, now_s) for line in data.decode().splitlines()]
        return "".join(f"{answer}\n" for answer in answers if answer).encode()

    def tick(self, n: int, now_s: float) -> tuple[bytes, list[bytes]]:
        rows = self.firmware.advance(n, now_s)
        events = [e.text for e in self.firmware.take_events() if e.stops_motors]
        if self.firmware.rate_Hz <= 0.0:
            return b"", []
        columns = [self._names.index(name) for name in ("pwm1_us", "rpm1", "thrust_N")]
        lines = [
            "r {:d} {:.1f} {:.1f} {:.4f}\n".format(time_us, *np.nan_to_num(row[columns]))
            for time_us, row in zip(rows.device_time_us.tolist(), rows.values, strict=True)
        ]
        return "".join(f"stopped {text}\n" for text in events).encode(), [s.encode() for s in lines]

    def _answer(self, line: str, now_s: float) -> str:
        word, _, rest = line.partition(" ")
        hello = self.firmware.hello
        if word == "id?":
            self.firmware.execute(wire.Clear(), now_s)
            limit_us = hello.limits["pwm_us"]
            return f"ok id? virtual-stand 2.1 {hello.pwm_stop_us:g} {limit_us:g}"
        commands: dict[str, Any] = {
            "stop": wire.StopDevice,
            "tare": wire.TareDevice,
            "alive": wire.ArmDevice,
        }
        if word == "pwm":
            command = wire.SetPwm((float(rest),))
        elif word == "rate":
            command = wire.SetRate(float(rest))
        else:
            command = commands[word]()
        reply = self.firmware.execute(command, now_s)
        if word == "alive":
            return ""
        return f"ok {word}" if reply.ok else f"no {word} {reply.reason}"
