"""What the RCbenchmark GUI would give for rows of simulated readings, pure."""

from __future__ import annotations

import json
import re
from math import isfinite
from typing import Any

from benchtool.bench.rcbenchmark.lines import (
    BRIDGE_VERSION,
    RAMP_MS,
    SILENCE_MS,
    SPEEDS,
    VIRTUAL_BOARD,
)
from benchtool.bench.serial import commands as wire
from benchtool.core.counted import counted
from benchtool.core.errors import InputError
from benchtool.core.units import from_si
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.server import ServedDevice

VIRTUAL_1580 = f"{VIRTUAL_BOARD}, as Series 1580"

READINGS: dict[str, tuple[str, str]] = {
    "thrust_N": ("thrust", "gf"),
    "rpm1": ("motorOpticalSpeed", "RPM"),
    "voltage_V": ("voltage", "V"),
    "current_A": ("current", "A"),
    "plate_z_m": ("plateDistance", "m"),
}
"""Name and unit in the GUI of each channel; a plate is the virtual stand's own."""


class StandReadings:
    """Turn rows of a plant into the GUI's results; every channel holds its last value.

    Args:
        speed: stand seconds per wall second.
    """

    def __init__(self, names: tuple[str, ...], speed: float) -> None:
        self._names = names
        self._speed = speed
        self._held: dict[str, float] = {}

    def result(self, time_us: int, row: list[float], plate_moves: bool) -> dict[str, Any]:
        """Return the result of one reading, with working values and units only."""
        self._held |= {
            name: value for name, value in zip(self._names, row, strict=True) if isfinite(value)
        }
        result = {"time": _entry(1e-6 * time_us, "s")}
        for channel, (name, unit) in READINGS.items():
            if channel in self._held:
                value = self._held[channel]
                result[name] = _entry(from_si(value, unit) if unit == "gf" else value, unit)
        result["plateMoving"] = _entry(float(plate_moves), "")
        result["simulationSpeed"] = _entry(self._speed, "")
        return result


def _entry(value: float, unit: str) -> dict[str, Any]:
    return {"workingValue": value, "workingUnit": unit}


_WORDS = re.compile(rb"hello|stop|clear|tare|average \d+|virtual plate [^\n]*?(?=\n|$)|[\d.]+")

LIMITS = ("thrust_N", "rpm", "current_A", "voltage_min_V")


class VirtualBridge(ServedDevice):
    """Speak the bridge script's words for a virtual bench with one rotor.

    Lost readings show in their numbers: no event reports them.
    """

    def __init__(self, firmware: Firmware) -> None:
        hello = firmware.hello
        if hello.n_rotors != 1:
            raise InputError(
                f"the bridge drives one ESC, and this rig has "
                f"{counted(hello.n_rotors, 'rotor')}; take a rig with one rotor, for example "
                f"pquad_single"
            )
        super().__init__(firmware)
        self._readings = StandReadings(tuple(item.name for item in hello.channels), hello.speed)
        self._count = 0
        self._now_s = 0.0
        self._moving = False
        # The GUI reads its stand whether or not anybody listens.
        firmware.execute(wire.SetRate(hello.rate_Hz), 0.0)

    def receive(self, data: bytes, now_s: float) -> bytes:
        self._now_s = now_s
        return b"".join(self._answer(word.decode()) for word in _WORDS.findall(data))

    def tick(self, n: int, now_s: float) -> tuple[bytes, list[bytes]]:
        self._now_s = now_s
        rows = self.firmware.advance(n, now_s)
        for event in self.firmware.take_events():
            self._moving = self._moving and event.kind != "arrived" and not event.stops_motors
        made = []
        for time_us, row in zip(rows.device_time_us.tolist(), rows.values.tolist(), strict=True):
            self._count += 1
            result = self._readings.result(time_us, row, self._moving)
            made.append(self._line({"n": self._count}, result))
        return b"", made

    def _answer(self, word: str) -> bytes:
        if word != "hello":
            return self._line({"to": word, "refused": self._obey(word)})
        hello, limits = self.firmware.hello, self.firmware.limits
        self.host_since_s = self._now_s
        self.firmware.note_host(self._now_s)
        return self._line(
            {
                "to": "hello",
                "refused": "",
                "board": hello.device_id,
                "version": VIRTUAL_1580,
                "firmware": hello.firmware,
                "output": "esc",
                "speed": SPEEDS["optical"],
                "low_us": hello.pwm_stop_us,
                "high_us": limits["pwm_us"],
                "silence_ms": SILENCE_MS,
                "ramp_ms": RAMP_MS,
                "limits": {name: limits[name] for name in LIMITS},
            }
        )

    def _obey(self, word: str) -> str:
        """Carry out a word; return why it is refused, nothing when it is done."""
        hello = self.firmware.hello
        if word.startswith("virtual plate"):
            try:
                z_m, x_m, tilt_rad = map(float, word.split()[2:])
            except ValueError:
                return "three numbers are needed: z m, x m, tilt rad"
            reply = self.firmware.execute(wire.SendPlate(z_m, x_m, tilt_rad), self._now_s)
            self._moving = self._moving or reply.ok
        elif word.startswith("average"):
            count = max(1, int(word.split()[1]))
            reply = self.firmware.execute(wire.SetRate(hello.rate_Hz / count), self._now_s)
        elif word == "stop":
            self._moving = False
            reply = self.firmware.execute(wire.StopDevice(), self._now_s)
        elif word == "clear":
            reply = self.firmware.execute(wire.Clear(), self._now_s)
        elif word == "tare":
            if self.firmware.pwm_us[0] > hello.pwm_stop_us:
                return "the motor turns; stop it first"
            reply = self.firmware.execute(wire.TareDevice(), self._now_s)
        else:
            try:
                pulse_us = float(word)
            except ValueError:
                return "unknown word"
            if pulse_us > hello.pwm_stop_us or self.firmware.pwm_us[0] > hello.pwm_stop_us:
                reply = self.firmware.execute(wire.SetPwm((pulse_us,)), self._now_s)
            else:
                # A heartbeat at standstill; the plate moves on.
                self.firmware.note_host(self._now_s)
                return ""
        return reply.reason

    def _line(self, entry: dict[str, Any], result: dict[str, Any] | None = None) -> bytes:
        latched = self.firmware.latched
        entry |= {
            "bridge": BRIDGE_VERSION,
            "t_ms": round(1e3 * self._now_s, 3),
            "us": float(self.firmware.pwm_us[0]),
            "why": f"{latched.kind}: {latched.text}" if latched else "",
        }
        text = json.dumps({"benchtool": entry, **(result or {})}, separators=(",", ":"))
        return text.encode("latin-1", "replace") + b"\n"
