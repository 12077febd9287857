"""Motors on a battery: speeds, voltage, current, charge and ESC temperature over stream ticks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt
from typing import NamedTuple

import numpy as np

from benchtool.core.rig import Rig
from benchtool.core.units import Array
from benchtool.physics.rotor import electrical_power_W, speed_near_plate, torque_per_speed
from benchtool.simulate.imperfections import Imperfections

HOLD_S = 0.05  # holding time of the voltage: short against battery dynamics, many ticks
STICTION_RAD_S = 1.0  # an undriven motor is at rest below it; far below idle; assumed
AMBIENT_DEGC = 22.0  # room temperature at the start; assumed

SpeedChange = Callable[[Array, float, float], Array]  # change(speed (n,), voltage, time) -> speed

DragFactor = Callable[[Array, int], Array]  # drag(speed (n,), tick) -> torque ratio (n,)


class MotorTicks(NamedTuple):
    """Motor and battery state at m ticks: speed, shaft angle and drag torque ratio (relative to out
    of ground effect) have shape (n, m), the others (m,).
    """

    speed_rad_s: Array
    angle_rad: Array
    drag: Array
    voltage_V: Array
    current_A: Array
    temperature_degC: Array


class Powertrain:
    """Motors and battery, exact in time: first-order lag, power, charge, temperature.

    Args:
        flaws: resolved, with lag of the motors, battery, and heating of the ESC.
        change: further change of the speed at a pulse width.

    For a rig without motor data speed does not depend on torque, and the electrical power is the
    shaft power over the efficiency.
    """

    def __init__(self, rig: Rig, flaws: Imperfections, change: SpeedChange | None = None) -> None:
        self._propulsion, self._motor, self._flaws = rig.propulsion, rig.motor, flaws
        self._battery = Battery(
            rig.propulsion.voltage_nominal_V + flaws.battery_excess_V,
            flaws.battery_drop_V_per_Ah,
            flaws.battery_resistance_ohm,
        )
        n, propulsion = rig.n_rotors, rig.propulsion
        self.pwm_us: Array = np.full(n, propulsion.pwm_stop_us)
        self._speed: Array = np.zeros(n)
        self._angle: Array = np.zeros(n)
        self._drag: Array = np.ones(n)
        self._drawn_C = self._warmth_K = self._power_W = 0.0
        self._change, self._slope_Nm_s = change, torque_per_speed(rig.motor)
        self._time_s = self._held_since_s = 0.0
        self._ticks_held = 0
        self._voltage_V = self._battery.open_circuit_V(0.0)
        full_pulse = propulsion.pwm_max_us - propulsion.pwm_start_us
        self.top_speed_rad_s = propulsion.speed_per_us_rad_s * full_pulse
        self._full_power_W = self._electrical_W(np.full(n, self.top_speed_rad_s))

    def _electrical_W(self, speed_rad_s: Array) -> float:
        """Return the electrical power of all turning motors."""
        drawn = electrical_power_W(self._propulsion, self._motor, speed_rad_s, self._drag)
        return float(np.sum(drawn[speed_rad_s > 0.0]))

    def _commanded_rad_s(self) -> Array:
        """Return the steady speeds for the pulse widths at the present voltage (n,)."""
        from_start = self.pwm_us - self._propulsion.pwm_start_us
        drive = np.where(self.pwm_us > self._propulsion.pwm_stop_us, from_start, 0.0)
        gain = self._propulsion.speed_per_us_rad_s * (
            self._voltage_V / self._propulsion.voltage_nominal_V
        )
        commanded: Array = gain * np.maximum(drive, 0.0)
        if self._change is not None:
            commanded = self._change(commanded, self._voltage_V, self._held_since_s)
        if self._slope_Nm_s is None:
            return commanded
        c = self._propulsion.drag_coefficient_Nm_s2
        near: Array = speed_near_plate(commanded, c, self._drag, self._slope_Nm_s)
        return near

    def restart_hold(self) -> None:
        """Start a new holding interval at the next tick, after a change of the tick length."""
        self._ticks_held = 0

    def advance(self, ticks: int, tick_s: float, drag: DragFactor | None = None) -> MotorTicks:
        """Return the next `ticks` ticks of `tick_s`; the result does not depend on the split.

        Drag torque and voltage are updated once per holding interval.
        """
        per_hold = max(1, round(HOLD_S / tick_s))
        n = len(self._speed)
        motors = MotorTicks(*np.empty((3, n, ticks)), *np.empty((3, ticks)))
        steps = np.arange(1, per_hold + 1)
        speed_decay, heat_decay = (
            np.exp(-steps * tick_s / constant_s) if constant_s else np.zeros(per_hold)
            for constant_s in (self._flaws.motor_lag_s, self._flaws.esc_time_s)
        )
        done = 0
        while done < ticks:
            if self._ticks_held == 0:
                self._held_since_s = self._time_s
                if drag is not None:
                    self._drag = drag(self._speed, done)
                self._power_W = self._electrical_W(self._speed)
                self._voltage_V = self._battery.loaded_V(self._drawn_C, self._power_W)
            count = min(per_hold - self._ticks_held, ticks - done)
            span = slice(done, done + count)
            target = self._commanded_rad_s()[:, None]
            speed = target + (self._speed[:, None] - target) * speed_decay[:count]
            speed[(target == 0.0) & (speed < STICTION_RAD_S)] = 0.0
            current_A = self._power_W / self._voltage_V
            steady_K = self._power_W / self._full_power_W * self._flaws.esc_heating_K
            warmth_K = steady_K + (self._warmth_K - steady_K) * heat_decay[:count]
            motors.speed_rad_s[:, span] = speed
            motors.drag[:, span] = self._drag[:, None]
            motors.voltage_V[span] = self._voltage_V
            motors.current_A[span] = current_A
            motors.temperature_degC[span] = AMBIENT_DEGC + warmth_K
            self._drawn_C += count * tick_s * current_A
            self._speed = speed[:, -1]
            self._warmth_K = float(warmth_K[-1])
            self._time_s += count * tick_s
            self._ticks_held = (self._ticks_held + count) % per_hold
            done += count
        angle = self._angle[:, None] + np.cumsum(motors.speed_rad_s, axis=1) * tick_s
        motors.angle_rad[:] = angle
        self._angle = np.mod(angle[:, -1], 2.0 * np.pi)
        return motors


COULOMB_PER_AH = 3600.0  # one ampere-hour in coulomb


@dataclass(frozen=True, slots=True)
class Battery:
    """Battery: full voltage, voltage decrease per charge, resistance; zero is exactly absent."""

    full_V: float
    drop_V_per_Ah: float = 0.0
    resistance_ohm: float = 0.0

    def open_circuit_V(self, drawn_C: float) -> float:
        """Return the voltage without load after `drawn_C` coulomb."""
        return max(self.full_V - self.drop_V_per_Ah * drawn_C / COULOMB_PER_AH, 0.1)

    def loaded_V(self, drawn_C: float, power_W: float) -> float:
        """Return the voltage at the terminals while `power_W` is drawn.

        Solves V = V_oc - r P / V. Above the maximum power, V_oc^2 / 4r, the result is half the
        open-circuit voltage, as at the maximum.
        """
        open_V = self.open_circuit_V(drawn_C)
        inside = 0.25 * open_V * open_V - self.resistance_ohm * power_W
        return 0.5 * open_V + sqrt(max(inside, 0.0))
