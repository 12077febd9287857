"""Virtual bench in the same process, on a virtual clock: `sim:` addresses.

No call waits: `read(10.0)` returns ten seconds of samples at once.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchtool.bench.bench import ContextBench, DeviceInfo, Readings, concatenate_readings
from benchtool.bench.drivers import SimAddress
from benchtool.bench.serial import commands as wire
from benchtool.bench.serial.hello import Hello
from benchtool.core.errors import CommandRefused, DeviceStopped, InputError, LinkLost, StageError
from benchtool.core.rig_file import load_rig_by_name
from benchtool.core.units import Array
from benchtool.simulate.plate_bench import PlateBench
from benchtool.virtual.devices import (
    build_hello,
    load_truth,
    pitch_hello,
    pitch_plant,
    virtual_plant,
)
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.pitch_plant import PitchBenchPlant

MOVE_STEP_S = 0.1  # time step while the plate moves
MOVE_TIMEOUT_S = 600.0  # longest move of the plate


class SimulatedBench(ContextBench):
    """Rotor bench or pitch bench from simulated physics, without waiting."""

    def __init__(self, address: str, plant: PlateBench | PitchBenchPlant, hello: Hello) -> None:
        self._address = address
        self._plant = plant
        self._hello = hello
        self._firmware = Firmware(self._plant, self._hello)
        # Longest time between two limit checks; a beam turns quickly: five ticks; assumed
        self._max_step_s = 0.02 if hello.has_loop else 10.0
        self._rate_Hz = plant.rate_Hz
        self._now_s = 0.0
        self._next_tick_s = 1.0 / plant.rate_Hz
        self._unread: list[Readings] = []
        self._messages: list[str] = []
        self._stopped: wire.DeviceEvent | None = None
        self._reported = False
        self._clamped = False
        self._open = False

    @property
    def identity(self) -> DeviceInfo:
        return self._hello.identity(self._address, self._rate_Hz)

    def now_s(self) -> float:
        return self._now_s

    def open(self) -> None:
        self._open = True
        self._firmware.execute(wire.RequestHello(), self._now_s)
        self.clear()
        self._command("rate", wire.SetRate(self._rate_Hz))

    def close(self) -> None:
        if self._open:
            self.stop()
            self._open = False

    def set_pwm(self, pwm_us: Array) -> None:
        self._raise_if_stopped()
        pulses = np.asarray(pwm_us, float)
        if not np.all(np.isfinite(pulses)):
            raise InputError(f"pulses {pulses.tolist()} are not all finite; give numbers in us")
        self._command("pwm", wire.SetPwm(tuple(pulses.tolist())))

    def stop(self) -> None:
        if self._open:
            self._firmware.execute(wire.StopDevice(), self._now_s)

    def move_plate(self, z_m: float, x_m: float = 0.0, tilt_rad: float = 0.0) -> None:
        self._raise_if_stopped()
        try:
            self._command("plate", wire.SendPlate(z_m, x_m, tilt_rad))
        except CommandRefused as error:
            raise StageError(f"the plate was not moved: {error.reason}") from error
        deadline_s = self._now_s + MOVE_TIMEOUT_S
        while self._plant.plate_moving:
            if self._now_s >= deadline_s:
                raise StageError(
                    f"the plate did not reach {z_m:g} m within {MOVE_TIMEOUT_S:g} s; check the "
                    f"rig's plate.speed_m_s"
                )
            self._advance(MOVE_STEP_S)
            self._note_events()
            self._raise_if_stopped()

    def tare(self) -> None:
        self._command("tare", wire.TareDevice())

    def set_rate(self, rate_Hz: float) -> None:
        if not rate_Hz > 0.0:
            raise InputError(f"stream rate {rate_Hz:g} Hz is out of range; allowed: 1 to 5000 Hz")
        try:
            self._command("rate", wire.SetRate(rate_Hz))
        except CommandRefused as error:
            raise InputError(
                f"stream rate {rate_Hz:g} Hz rejected by the device: {error.reason}"
            ) from error
        self._rate_Hz = rate_Hz
        self._next_tick_s = self._now_s + 1.0 / rate_Hz

    def set_limit(self, name: str, value: float) -> None:
        """Tighten a limit of the device; the device rejects a wider one."""
        self._command("limit", wire.SetLimit(name, value))

    def clear(self) -> None:
        """Clear the latch of a stopped device; its motors stay at zero."""
        self._command("clear", wire.Clear())
        self._note_events()
        self._stopped, self._reported = None, False

    def read(self, timeout_s: float) -> Readings:
        self._check_open("read")
        # Samples before a stop are returned before the stop is raised, so that none is lost.
        if not self._unread and not self._reported:
            self._raise_if_stopped()
        if self._stopped is None or self._reported:
            self._advance(timeout_s)
        self._note_events()
        self._note_clamp()
        unread, self._unread = self._unread, []
        messages, self._messages = tuple(self._messages), []
        values, empty = np.empty((0, len(self._hello.channels))), np.empty(0)
        return concatenate_readings([*unread, Readings(empty, empty, values, messages=messages)])

    def _advance(self, duration_s: float) -> None:
        """Advance the clock and buffer the samples of that time."""
        until_s = self._now_s + duration_s
        while True:
            # A tick at the end of the interval belongs to it, despite rounding.
            remaining = int(np.floor((until_s - self._next_tick_s) * self._rate_Hz + 1e-6)) + 1
            if remaining <= 0:
                break
            n = min(remaining, max(1, round(self._max_step_s * self._rate_Hz)))
            time_s = self._next_tick_s + np.arange(n) / self._rate_Hz
            self._now_s = float(time_s[-1])
            self._firmware.note_host(self._now_s)
            rows = self._firmware.advance(n, self._now_s)
            device_time_us = rows.device_time_us.astype(float)
            self._unread.append(Readings(time_s, device_time_us, rows.values))
            self._next_tick_s = self._now_s + 1.0 / self._rate_Hz
        self._now_s = max(until_s, self._now_s)

    def _command(self, name: str, command: wire.Command) -> None:
        self._check_open(name)
        reply = self._firmware.execute(command, self._now_s)
        if not reply.ok:
            raise CommandRefused(name, reply.reason)

    def _note_events(self) -> None:
        for event in self._firmware.take_events():
            self._messages.append(f"{event.kind}: {event.text}")
            if event.stops_motors:
                self._stopped = event

    def _note_clamp(self) -> None:
        """Report once that the plate is nearer than the range of the model."""
        if self._plant.clamped_readings and not self._clamped:
            self._clamped = True
            limit = f"z/R = {self._plant.nearest_z_over_R:g}"
            self._messages.append(
                f"clamped: the plate is nearer than {limit}, the end of the true law; thrust is "
                f"that at {limit}"
            )

    def _raise_if_stopped(self) -> None:
        if self._stopped is not None:
            self._reported = True
            raise DeviceStopped(
                f"the device stopped its motors ({self._stopped.kind}: "
                f"{self._stopped.text}); remove the cause and start again"
            )

    def _check_open(self, what: str) -> None:
        if not self._open:
            raise LinkLost(f"{what} needs an open bench; call open() first")


def open_simulated(address: SimAddress) -> SimulatedBench:
    """Return the virtual bench of an address, not yet open."""
    rig, seed = load_rig_by_name(address.rig), address.seed
    if address.mode == "pitch":
        # A plus sign in an address reads as a space.
        names = ("truth", "schedule", "controller", "gains", "hidden")
        texts = {name: getattr(address, name).replace(" ", "+") for name in names}
        pitch = pitch_plant(rig, replace(address, **texts))
        return SimulatedBench(address.text, pitch, pitch_hello(pitch, seed))
    truth, imperfections = load_truth(rig, address.truth, address.permit)
    plant = virtual_plant(rig, truth, seed, imperfections, address.rate_Hz or 200.0)
    return SimulatedBench(address.text, plant, build_hello(plant, truth, seed))
