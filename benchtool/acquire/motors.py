"""Bring rotors to a pulse, to a standstill, and down at a normal end."""

from __future__ import annotations

import numpy as np

from benchtool.acquire.record import Recorder
from benchtool.core.array import Array
from benchtool.core.errors import BenchError, CommandRefused
from benchtool.core.rig import Rig

RAMP_STEP_S = 0.05
"""Time between two pulses of a ramp; a choice, well inside the device's watchdog of 0.25 s."""

RAMP_DOWN_S = 0.8
"""A normal end ramps down in so long; at most 1 s is allowed."""

STANDSTILL_RPM = 30.0
"""Below this a rotor stands still: tachometers flicker by a revolution or two; a choice."""


class Motors:
    """Command pulses through a recorder, remembering the last ones.

    Args:
        recorder: reads and writes while time passes.
        rig: pulses at which motors stand.
    """

    def __init__(self, recorder: Recorder, rig: Rig) -> None:
        self._recorder = recorder
        self._rig = rig
        self.stop_us: Array = np.full(rig.n_rotors, rig.propulsion.pwm_stop_us)
        self.pulses_us: Array = self.stop_us

    @property
    def stopped(self) -> bool:
        """Whether zero is commanded."""
        return bool(np.all(self.pulses_us == self.stop_us))

    def ramp_to(self, pulses_us: Array, seconds: float, phase: str, point: int = 0) -> None:
        """Go to pulses (n_rotors,) in equal steps, recording samples on the way."""
        start_us = np.maximum(self.pulses_us, self._idle_us(pulses_us))
        steps = max(1, round(seconds / RAMP_STEP_S))
        for step in range(1, steps + 1):
            now_us = start_us + (pulses_us - start_us) * (step / steps)
            now_us = np.where(pulses_us == self.stop_us, np.maximum(now_us, self.stop_us), now_us)
            self._set(pulses_us if step == steps else now_us)
            if steps > 1:
                self._recorder.collect(phase, RAMP_STEP_S, point)

    def zero(self) -> None:
        """Command zero at once."""
        self._set(self.stop_us)

    def stand_still(self, timeout_s: float, phase: str) -> None:
        """Command zero and wait until no rotor turns.

        Raises:
            BenchError: a rotor still turns after the time-out.
        """
        self.zero()
        end_s = self._recorder.bench.now_s() + timeout_s
        names = [f"rpm{rotor + 1}" for rotor in range(self._rig.n_rotors)]
        while True:
            seen = self._recorder.collect(phase, 0.2)
            last = {name: _last(seen.column(name)) for name in names if name in seen}
            if all(abs(rpm) < STANDSTILL_RPM for rpm in last.values()):
                return
            if self._recorder.bench.now_s() >= end_s:
                name, rpm = max(last.items(), key=lambda item: np.nan_to_num(abs(item[1]), nan=1e9))
                told = f"still reads {rpm:.0f} rpm" if rpm == rpm else "brings no value"
                raise BenchError(
                    f"{name} {told} {timeout_s:g} s after zero was commanded, limit "
                    f"{STANDSTILL_RPM:g} rpm; check the ESC's arming and the tachometer"
                )

    def _idle_us(self, pulses_us: Array) -> Array:
        """Begin a ramp from standstill at the pulse where rotors start to turn."""
        return np.where(pulses_us > self.stop_us, self._rig.propulsion.pwm_start_us, self.stop_us)

    def _set(self, pulses_us: Array) -> None:
        try:
            self._recorder.bench.set_pwm(pulses_us)
        except CommandRefused:
            # A device that has stopped by itself says why in its stream; that is the better error.
            for _ in range(2):
                self._recorder.read("end", timeout_s=RAMP_STEP_S)
            raise
        self.pulses_us = pulses_us


def _last(values: Array) -> float:
    present = values[~np.isnan(values)]
    return float(present[-1]) if len(present) else float("nan")
