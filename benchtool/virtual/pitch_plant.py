"""Pitch bench as a plant: the control loop runs on the device, the host only arms it.

Pulses above idle arm the loop; lower pulses drive the motors, and a catch levels the beam.
"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from benchtool.core.channel import Channel
from benchtool.core.errors import InputError, StageError
from benchtool.core.rig import Rig
from benchtool.core.schedule import PARKED_M, Schedule
from benchtool.core.units import Array
from benchtool.simulate.controllers.controller import (
    PitchMeasurement,
    PitchReference,
    make_controller,
)
from benchtool.simulate.loop import BUILT_IN, CALLER, PULSES
from benchtool.simulate.noise import lane_states
from benchtool.simulate.pitch.loops import Fresh
from benchtool.simulate.pitch.run import PitchJob, PitchLoop
from benchtool.simulate.pitch.simulate import PitchController

HOLD_S = 2.0  # block length of the last values of a schedule; assumed
MAX_CATCH_RATE_RAD_S = 0.5  # levelling rate of the catch; assumed
IDLE_FRACTION = 0.05  # of the pulse range; motors turn slowly or not at all; assumed
MIN_RPM = 60.0  # tachometer reads 0 below; five times the noise; assumed
IDLE_RUN = 2**31  # run number of the noise before the first arming
_CONTROLLER = ("law_state", "command")  # new per arming
_VISIT = ("setpoint.plate_z_m", "setpoint.plate_share")
_NOMINAL_VISIT = ("nominal_plate_z_m", "nominal_share")  # in a schedule


def idle_us(rig: Rig) -> float:
    """Return the highest idle pulse of a virtual bench of this rig: us."""
    pulse = rig.propulsion
    start_us = max(pulse.pwm_stop_us, pulse.pwm_start_us)
    return start_us + IDLE_FRACTION * (pulse.pwm_max_us - start_us)


class PitchBenchPlant:
    """Pitch bench with its controller, advanced tick by tick."""

    def __init__(
        self,
        job: PitchJob,
        schedule: Schedule,  # from arming on
        seed: int,  # of the noise; the n-th arming has the noise of run n of `simulate_pitch`
        rate_Hz: float | None = None,  # stream rate: control rate over an integer
        user_controller: type[PitchController] | None = None,  # rebuilt at every arming
    ) -> None:
        self.job, self.schedule, self.rig = job, schedule, job.bench.model.rig
        self.nearest_z_over_R = job.bench.model.nearest_z_over_R
        self.control_rate_Hz = job.control.control_rate_Hz
        self.rate_Hz = self.control_rate_Hz
        self._every = 1
        self._seed, self._armings = seed, 0
        held = replace(schedule, duration_s=schedule.duration_s + HOLD_S)
        sampled = held.sampled(self.control_rate_Hz, self.rig.propulsion.radius_m)
        self._hold = round(HOLD_S * self.control_rate_Hz)
        end = len(sampled) - self._hold
        for track in fields(sampled)[2:]:  # all after rate and time
            values = getattr(sampled, track.name)
            values[end:] = values[end - 1]
        self._loop = PitchLoop([job], sampled, seed, [IDLE_RUN])
        self._loop.drive(np.zeros((self._loop.n_discs, len(sampled))))
        self._user_controller = user_controller
        self._controller: PitchController = (
            _NoController()
            if user_controller is None
            else make_controller(user_controller, job.control.name)
        )
        self._ticks_armed = 0
        self._visits, self._nominal_visits = (
            [self._loop.schedule_view(field)[0].copy() for field in fields]
            for fields in (_VISIT, _NOMINAL_VISIT)
        )
        self._tick = 0
        self._plate_m = self._target_m = PARKED_M
        self.idle_us = idle_us(self.rig)
        self._armed = False
        # Rotors start at standstill.
        self._loop.set_speeds(0.0)
        self._loop.view("readings.speed_rad_s")[:] = 0.0
        self.command_pwm(np.full(self.rig.n_rotors, self.rig.propulsion.pwm_stop_us))
        # Compile before the host waits for a reply.
        self._run(1)
        if user_controller is not None:
            self._loop.run_controller(_NoController(), self._tick, self._tick + 1)
        if rate_Hz is not None:
            self.set_rate(rate_Hz)

    @property
    def channels(self) -> tuple[Channel, ...]:
        n = self.rig.n_rotors
        return (
            Channel("theta_ref_rad", "rad", "target pitch, positive nose down"),
            Channel("theta_rad", "rad", "encoder"),
            Channel("gyro_rad_s", "rad/s", "gyro"),
            *(Channel(f"pwm{k + 1}_us", "pwm_us", "pulse") for k in range(n)),
            *(Channel(f"rpm{k + 1}", "rpm", "rotor speed") for k in range(n)),
            Channel("plate_z_m", "m", "plate distance at level beam; 1 or more: parked"),
            Channel("torque_Nm", "N m", "commanded torque"),
            Channel("disturbance_Nm", "N m", "disturbance torque estimate"),
        )

    @property
    def channel_rates_Hz(self) -> tuple[float, ...]:
        """Rate of new values of each channel: Hz."""
        families = (channel.name.rstrip("0123456789") for channel in self.channels)
        sensors = (self.job.bench.sensors.get(family) for family in families)
        rates_Hz = (sensor.rate_Hz if sensor else 0.0 for sensor in sensors)
        return tuple(min(rate or self.control_rate_Hz, self.rate_Hz) for rate in rates_Hz)

    @property
    def plate_moving(self) -> bool:
        return self._plate_m != self._target_m

    @property
    def clamped_readings(self) -> int:
        """Number of plant steps with a disc below the range of the law."""
        return int(self._loop.view("hinge.clamped_steps")[0, 0])

    @property
    def armed(self) -> bool:
        """True while the loop is closed."""
        return self._armed

    def set_rate(self, rate_Hz: float) -> None:
        every = round(self.control_rate_Hz / rate_Hz)
        if every < 1 or abs(every * rate_Hz - self.control_rate_Hz) > 1e-6 * rate_Hz:
            control_Hz = self.control_rate_Hz
            rates = ", ".join(f"{control_Hz / k:g}" for k in (1, 2, 5))
            raise InputError(
                f"stream rate {rate_Hz:g} Hz does not divide the control rate {control_Hz:g} Hz; "
                f"allowed: the control rate over an integer, for example {rates} Hz"
            )
        self._every, self.rate_Hz = every, self.control_rate_Hz / every

    def command_pwm(self, pwm_us: Array) -> None:
        """Apply pulses (n_rotors,): above idle, their mean is the collective in closed loop."""
        mean_us = float(np.mean(pwm_us))
        loop, pulse = self._loop, self.rig.propulsion
        if mean_us > self.idle_us:
            if not self._armed:
                self._arm()
            speed_rad_s = pulse.speed_per_us_rad_s * (mean_us - pulse.pwm_start_us)
            thrust_N = self.job.bench.model.parameters["k"].value * speed_rad_s**2
            loop.schedule_view("setpoint.collective_N")[0] = loop.schedule.collective * thrust_N
            return
        if self._armed:
            self._armed = False
            loop.set_driver(PULSES)
            self._restart_controller()
            self._jump(0)
        for rotor, disc in enumerate(self.rig.disc_of_rotor):
            loop.schedule_view("pwm_us")[disc] = pwm_us[rotor]

    def command_plate(self, z_m: float, x_m: float, tilt_rad: float) -> None:
        """Start moving the plate under the first disc; `PARKED_M` or more is parked."""
        if x_m or tilt_rad:
            raise StageError(
                f"plate position x {x_m:g} m, tilt {tilt_rad:g} rad is not possible: the plate of "
                f"a pitch bench moves in distance only; leave both 0"
            )
        self._target_m = z_m

    def halt_plate(self) -> None:
        self._target_m = self._plate_m

    def tare(self) -> None:
        raise InputError("a pitch bench has no load cell to tare; omit the tare")

    def advance(self, n: int) -> Array:
        """Return the next n ticks (n, c), nan where a channel has no new value."""
        every = self._every
        parts, fresh = self._run(n * every)
        last = np.arange(every - 1, n * every, every)
        is_new = fresh.reshape(n, every, -1).any(axis=1)
        rows: Array = parts[last]
        rows[~is_new] = np.nan
        return rows

    def _run(self, ticks: int) -> tuple[Array, NDArray[np.bool_]]:
        """Run control ticks; return the values (ticks, c) and a mask of new ones."""
        blocks = []
        loop, end = self._loop, len(self._loop.schedule)
        while ticks > 0:
            first = self._tick
            if first >= end or not self._armed:
                first = end - self._hold if self._armed else 0
                self._jump(first)
            # A moving plate or an active catch is updated once per short block.
            max_count = ticks if self._armed and not self.plate_moving else 10
            count = min(ticks, end - first, max_count)
            self._place_plate(first, count)
            if self._armed and self._user_controller is not None:
                loop.run_controller(self._controller, first, first + count, self._ticks_armed)
                self._ticks_armed += count
            else:
                loop.advance(first, first + count)
            self._tick = first + count
            blocks.append(self._sample(first, count))
            if not self._armed:
                self._catch(count)
            ticks -= count
        return (
            np.concatenate([values for values, _ in blocks]),
            np.concatenate([fresh for _, fresh in blocks]),
        )

    def _sample(self, first: int, count: int) -> tuple[Array, NDArray[np.bool_]]:
        """Return the values of control ticks in the order of `channels`, and a mask of new ones."""
        loop, n, discs = self._loop, self._loop.n_discs, self.rig.disc_of_rotor
        log = loop.log[first : first + count, :, 0]
        rpm = log[:, 10 + n + discs] * 30.0 / np.pi
        flags = Fresh(*loop.arrays.fresh[:, first : first + count].astype(bool))
        closed, rotors = np.full(count, self._armed), np.ones((count, len(discs)), bool)
        columns = (
            (log[:, 0], closed),
            (log[:, 1], flags.theta),
            (log[:, 2], flags.gyro),
            (log[:, 10 + discs], rotors),
            (np.where(rpm < MIN_RPM, 0.0, rpm), flags.speed[:, None] & rotors),
            (log[:, 4], flags.plate),
            (log[:, 6], closed),
            (log[:, 7], closed),
        )
        values, fresh = zip(*columns, strict=True)
        return np.column_stack(values), np.column_stack(fresh)

    def _place_plate(self, first: int, count: int) -> None:
        """Write the plate distance over the next ticks: of the visit, else of the last command."""
        step_m = self.rig.plate.speed_m_s / self.control_rate_Hz
        remaining_m = self._target_m - self._plate_m
        steps_m = np.sign(remaining_m) * np.minimum(
            step_m * np.arange(1, count + 1), abs(remaining_m)
        )
        position_m = self._plate_m + steps_m
        self._plate_m = float(position_m[-1])
        if abs(self._target_m - self._plate_m) < 1e-9:
            self._plate_m = self._target_m
        under = (position_m < PARKED_M).astype(float)
        block = slice(first, first + count)
        map_error_m = self.job.control.feedforward.height_error_m
        for (z_field, share_field), (visit_m, visit), error_m in (
            (_VISIT, self._visits, 0.0),
            (_NOMINAL_VISIT, self._nominal_visits, map_error_m),
        ):
            visiting = (visit[block] > 0.0) & self._armed
            placed_m = np.where(visiting, visit_m[block], position_m + error_m)
            self._loop.schedule_view(z_field)[0, block] = placed_m
            self._loop.schedule_view(share_field)[0, block] = np.where(
                visiting, visit[block], under
            )

    def _arm(self) -> None:
        """Close the loop at the start of the schedule, with new noise at every arming."""
        loop = self._loop
        loop.arrays.states[:] = lane_states(self._seed, [self._armings])
        self._armings += 1
        self._restart_controller()
        loop.set_driver(BUILT_IN)
        if self._user_controller is not None:
            loop.set_driver(CALLER)
            self._controller = make_controller(self._user_controller, self.job.control.name)
            self._ticks_armed = 0
        self._jump(0)
        self._armed = True

    def _restart_controller(self) -> None:
        for record in _CONTROLLER:
            self._loop.view(record)[:] = 0.0

    def _catch(self, ticks: int) -> None:
        """Bring the beam towards level while the loop is open."""
        back_rad = MAX_CATCH_RATE_RAD_S * ticks / self.control_rate_Hz
        theta = self._loop.view("hinge.theta_rad")
        theta -= np.clip(theta, -back_rad, back_rad)
        self._loop.view("hinge.rate_rad_s")[:] = 0.0

    def _jump(self, tick: int) -> None:
        """Continue at another tick of the schedule; delayed values keep their order."""
        loop, shift = self._loop, tick - self._tick
        if shift:
            for ring in (loop.arrays.sent, loop.arrays.past):
                ring[:] = np.roll(ring, shift, axis=1)
        self._tick = tick


class _NoController:
    """Controller without output, while pulses drive the motors."""

    def step(self, measurement: PitchMeasurement, reference: PitchReference, dt_s: float) -> float:
        return 0.0
