"""From pulse to thrust: ESC, delay, lag, and the thrust of a rotor far from everything."""

from __future__ import annotations

import math

from tests.proof.blind.pitch.beam import STEP_S
from tests.proof.blind.pitch.plant import Plant
from tests.proof.blind.pitch.sheet import SHEET, Sheet

REFERENCE_RPM = 6000.0  # speed at which every thrust exponent gives the data sheet's thrust


class Rotors:
    """Carry two rotors through one control period after the other.

    A held pulse makes the lag's answer an exponential, which is taken exactly, also where a
    delayed pulse changes in the middle of a step.
    """

    def __init__(self, plant: Plant, sheet: Sheet = SHEET) -> None:
        self._plant = plant
        self._pwm0 = sheet.pwm0
        self._norm = sheet.kT * REFERENCE_RPM ** (2.0 - plant.thrust_exponent)
        self._steps = round(sheet.dt / STEP_S)
        self._late = int(plant.delay_s / sheet.dt)
        start = plant.delay_s - self._late * sheet.dt
        lags = (plant.tau_s, plant.tau_s * plant.tau_rise_ratio)
        # For each step: what is left of the distance to the old and to the new drive.
        self._left = []
        for k in range(self._steps):
            old = min(max(start - k * STEP_S, 0.0), STEP_S)
            new = STEP_S - old
            self._left.append(tuple((math.exp(-old / t), math.exp(-new / t)) for t in lags))
        self._drives: list[list[float]] = [[], []]
        self.speed_rpm = [0.0, 0.0]

    def rest(self, pulse_us: tuple[float, float], time_s: float = 0.0) -> None:
        """Let both rotors turn steadily at these pulses."""
        for i in (0, 1):
            drive = self._drive(i, pulse_us[i], time_s)
            self._drives[i] = [drive] * (self._late + 2)
            self.speed_rpm[i] = drive

    def remember(self, pulses_us: list[tuple[float, float]], dt_s: float, time_s: float) -> None:
        """Take over the pulses sent before a start at time_s, the latest last."""
        kept = pulses_us[-(self._late + 1) :]
        for i in (0, 1):
            drives = [
                self._drive(i, pulse[i], time_s - (len(kept) - k) * dt_s)
                for k, pulse in enumerate(kept)
            ]
            self._drives[i] = [drives[0]] * (self._late + 2 - len(drives)) + drives

    def _drive(self, i: int, pulse_us: float, time_s: float) -> float:
        plant = self._plant
        above = pulse_us - self._pwm0
        if plant.esc_step_us > 0.0:
            above = plant.esc_step_us * math.floor(above / plant.esc_step_us + 0.5)
        return plant.rpm_per_us[i] * (1.0 - plant.sag_per_s * time_s) * max(above, 0.0)

    def _faded(self, time_s: float) -> float:
        """Return what is left of rotor 1's thrust at one speed."""
        plant = self._plant
        return 1.0 - plant.fade * (1.0 - math.exp(-time_s / plant.fade_s))

    def advance(
        self, pulse_us: tuple[float, float], time_s: float
    ) -> tuple[list[float], list[float]]:
        """Send pulses, turn for one period; return each rotor's thrust at the steps' starts: N."""
        out: tuple[list[float], list[float]] = ([], [])
        plant = self._plant
        exponent, lean = plant.thrust_exponent, plant.thrust_lean
        for i in (0, 1):
            drives = self._drives[i]
            drives.append(self._drive(i, pulse_us[i], time_s))
            del drives[0]
            old, new = drives[0], drives[1]
            speed = self.speed_rpm[i]
            scale = self._norm * (plant.thrust_ratio if i else self._faded(time_s))
            thrusts = out[i]
            for fall, rise in self._left:
                thrust = scale * speed**exponent
                if plant.flutter:
                    off = (speed - plant.flutter_rpm) / plant.flutter_width_rpm
                    thrust *= 1.0 + plant.flutter / (1.0 + off * off)
                left_old, left_new = rise if new > speed else fall
                before = speed
                speed = old + (speed - old) * left_old
                speed = new + (speed - new) * left_new
                if lean:
                    swing = (speed - before) / (STEP_S * plant.thrust_lean_rpm_per_s)
                    thrust *= 1.0 + lean * math.tanh(swing)
                thrusts.append(thrust)
            self.speed_rpm[i] = speed
        return out
