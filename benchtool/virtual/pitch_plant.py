"""The pitch bench as a device's plant: the closed loop runs on the device, the host only arms it.

Pulses above idle arm the loop, others go to the motors while a catch brings the beam to level.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array_type import Array
from benchtool.core.channel import Channel
from benchtool.core.errors import InputError, StageError
from benchtool.core.rig import Rig
from benchtool.core.schedule import PARKED_M, Schedule
from benchtool.simulate.controllers.controller import PitchMeasurement, PitchReference
from benchtool.simulate.kernel import BUILT_IN, CALLER, PULSES
from benchtool.simulate.noise import lane_states
from benchtool.simulate.pitch import records as r
from benchtool.simulate.pitch.run import PitchJob, PitchLoop
from benchtool.simulate.pitch.simulate import PitchController, user_controller_ticks
from benchtool.simulate.user_controller import make_controllers

HOLD_S = 2.0  # last values of a schedule, in blocks of this length; assumed
MAX_CATCH_RATE_RAD_S = 0.5  # rate at which the catch levels the beam; assumed
IDLE_SHARE = 0.05  # share of the pulse range; motors turn slowly or not at all; assumed
SLOWEST_RPM = 60.0  # a tachometer shows 0 below; five times the noise; assumed
IDLE_RUN = 2**31  # number of the noise before the first arming
_CONTROLLER = ("law_state", "command.torque_Nm", "command.difference_us")  # new per arming
_VISIT = ("setpoint.plate_z_m", "setpoint.plate_share")
_NOMINAL_VISIT = ("nominal_plate_z_m", "nominal_share")  # in a schedule


def idle_us(rig: Rig) -> float:
    """Return the pulse up to which motors of a virtual bench of this rig idle: us."""
    pulse = rig.propulsion
    start_us = max(pulse.pwm_stop_us, pulse.pwm_start_us)
    return start_us + IDLE_SHARE * (pulse.pwm_max_us - start_us)


class PitchBenchPlant:
    """Be a pitch bench with its controller, advanced tick by tick."""

    def __init__(
        self,
        job: PitchJob,
        schedule: Schedule,  # from arming on
        seed: int,  # of the noise; the n-th arming has the noise of run n of `simulate_pitch`
        rate_Hz: float | None = None,  # stream rate, control rate over a whole number
        own: type[PitchController] | None = None,  # user's controller, made anew for every arming
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
        for track in (
            sampled.reference_rad,
            sampled.collective,
            sampled.dither_us,
            sampled.plate_z_m,
            sampled.plate_share,
            sampled.observer,
            sampled.feedforward,
        ):
            track[end:] = track[end - 1]
        self._loop = PitchLoop([job], sampled, seed, [IDLE_RUN])
        self._loop.drive(np.zeros((self._loop.n_discs, len(sampled))))
        self._own = own
        self._controller: PitchController = (
            _Still() if own is None else make_controllers(own, job.control.name)
        )
        self._own_ticks = None if own is None else user_controller_ticks(self._loop)
        self._ticks_armed = 0
        self._visits, self._nominal_visits = (
            [self._loop.planned(field)[0].copy() for field in fields]
            for fields in (_VISIT, _NOMINAL_VISIT)
        )
        self._tick = 0
        self._plate_m = self._target_m = PARKED_M
        self.idle_us = idle_us(self.rig)
        self._armed = False
        # Begin with rotors that stand still.
        self._loop.set_speeds(0.0)
        self._loop.view("readings.speed_rad_s")[:] = 0.0
        self.command_pwm(np.full(self.rig.n_rotors, self.rig.propulsion.pwm_stop_us))
        # Compiles, where it must, before anybody waits for an answer.
        self._run(1)
        if self._own_ticks is not None:
            self._own_ticks(_Still(), self._tick, self._tick + 1, 0)
        if rate_Hz is not None:
            self.set_rate(rate_Hz)

    @property
    def channels(self) -> tuple[Channel, ...]:
        n = self.rig.n_rotors
        return (
            Channel("theta_ref_rad", "rad", "wanted pitch, positive nose down"),
            Channel("theta_rad", "rad", "encoder"),
            Channel("gyro_rad_s", "rad/s", "gyro"),
            *(Channel(f"pwm{k + 1}_us", "pwm_us", "pulse") for k in range(n)),
            *(Channel(f"rpm{k + 1}", "rpm", "rotor speed") for k in range(n)),
            Channel("plate_z_m", "m", "distance with the beam level; 1 or more is parked"),
            Channel("torque_Nm", "N m", "torque that the controller commands"),
            Channel("disturbance_Nm", "N m", "torque that the observer sees"),
        )

    @property
    def channel_rates_Hz(self) -> tuple[float, ...]:
        """How often each channel of the stream has a new value."""
        families = (channel.name.rstrip("0123456789") for channel in self.channels)
        sensors = (self.job.bench.sensors.get(family) for family in families)
        rates_Hz = (one.rate_Hz if one else 0.0 for one in sensors)
        return tuple(min(rate or self.control_rate_Hz, self.rate_Hz) for rate in rates_Hz)

    @property
    def plate_moving(self) -> bool:
        return self._plate_m != self._target_m

    @property
    def clamped_readings(self) -> int:
        """Plant steps with a disc nearer than the formulae hold."""
        return int(self._loop.view("hinge.clamped_steps")[0, 0])

    @property
    def armed(self) -> bool:
        """Whether the loop is closed."""
        return self._armed

    def set_rate(self, rate_Hz: float) -> None:
        every = round(self.control_rate_Hz / rate_Hz)
        if every < 1 or abs(every * rate_Hz - self.control_rate_Hz) > 1e-6 * rate_Hz:
            control_Hz = self.control_rate_Hz
            rates = ", ".join(f"{control_Hz / k:g}" for k in (1, 2, 5))
            raise InputError(
                f"a stream of {rate_Hz:g} Hz does not fit a controller at {control_Hz:g} Hz; ask "
                f"for that over a whole number, as {rates}"
            )
        self._every, self.rate_Hz = every, self.control_rate_Hz / every

    def command_pwm(self, pwm_us: Array) -> None:
        """Take pulses (n_rotors,): above idle their mean is the collective, and the loop closes."""
        mean_us = float(np.mean(pwm_us))
        loop, pulse = self._loop, self.rig.propulsion
        if mean_us > self.idle_us:
            if not self._armed:
                self._arm()
            nominal = self.job.nominal_model
            speed_rad_s = pulse.speed_per_us_rad_s * (mean_us - pulse.pwm_start_us)
            thrust_N = nominal.parameters["k"].value * speed_rad_s**2
            loop.planned("setpoint.collective_N")[0] = loop.schedule.collective * thrust_N
            return
        if self._armed:
            self._armed = False
            loop.set_driver(PULSES)
            self._restart_controller()
            self._jump(0)
        for rotor, disc in enumerate(self.rig.disc_of_rotor):
            loop.planned("pwm_us")[disc] = pwm_us[rotor]

    def command_plate(self, z_m: float, x_m: float, tilt_rad: float) -> None:
        """Start moving the plate under the first disc to a distance; `PARKED_M` or more is away."""
        if x_m or tilt_rad:
            raise StageError(
                f"the plate of a pitch bench moves in distance alone, not to x {x_m:g} m, tilt "
                f"{tilt_rad:g} rad; leave both 0"
            )
        self._target_m = z_m

    def halt_plate(self) -> None:
        self._target_m = self._plate_m

    def tare(self) -> None:
        raise InputError("a pitch bench has no load cell to tare; leave the tare out")

    def advance(self, n: int) -> Array:
        """Return the next n ticks (n, c), nan where a channel has no new value."""
        every = self._every
        parts, fresh = self._run(n * every)
        last = np.arange(every - 1, n * every, every)
        seen = fresh.reshape(n, every, -1).any(axis=1)
        rows: Array = parts[last]
        rows[~seen] = np.nan
        return rows

    def _run(self, ticks: int) -> tuple[Array, NDArray[np.bool_]]:
        """Run control ticks; return held values (ticks, c) and which of them are new."""
        blocks = []
        loop, end = self._loop, len(self._loop.schedule)
        while ticks > 0:
            first = self._tick
            if first >= end or not self._armed:
                first = end - self._hold if self._armed else 0
                self._jump(first)
            # A plate that moves or a catch that holds acts once for each short block.
            most = ticks if self._armed and not self.plate_moving else 10
            count = min(ticks, end - first, most)
            self._place_plate(first, count)
            if self._armed and self._own_ticks is not None:
                self._own_ticks(self._controller, first, first + count, self._ticks_armed)
                self._ticks_armed += count
            else:
                loop.run(first, first + count)
            self._tick = first + count
            blocks.append(self._taken(first, count))
            if not self._armed:
                self._catch(count)
            ticks -= count
        return (
            np.concatenate([values for values, _ in blocks]),
            np.concatenate([fresh for _, fresh in blocks]),
        )

    def _taken(self, first: int, count: int) -> tuple[Array, NDArray[np.bool_]]:
        loop, n = self._loop, self._loop.n_discs
        log = loop.log[first : first + count, :, 0]
        discs = self.rig.disc_of_rotor
        rpm = log[:, 10 + n + discs] * 30.0 / np.pi
        values = np.column_stack(
            [
                log[:, [0, 1, 2]],
                log[:, 10 + discs],
                np.where(rpm < SLOWEST_RPM, 0.0, rpm),
                log[:, 4],
                log[:, [6, 7]],
            ]
        )
        flags = r.Fresh(*loop.fresh[:, first : first + count].astype(bool))
        closed = np.full(count, self._armed)
        rotors = np.ones((1, self.rig.n_rotors), bool)
        fresh = np.column_stack(
            [
                closed,
                flags.theta,
                flags.gyro,
                np.ones(count, bool)[:, None] & rotors,
                flags.speed[:, None] & rotors,
                flags.plate,
                closed,
                closed,
            ]
        )
        return values, fresh

    def _place_plate(self, first: int, count: int) -> None:
        """Write where the plate is over the next ticks: on a visit, else where it was sent."""
        step_m = self.rig.plate.speed_m_s / self.control_rate_Hz
        way_m = self._target_m - self._plate_m
        steps_m = np.sign(way_m) * np.minimum(step_m * np.arange(1, count + 1), abs(way_m))
        stands_m = self._plate_m + steps_m
        self._plate_m = float(stands_m[-1])
        if abs(self._target_m - self._plate_m) < 1e-9:
            self._plate_m = self._target_m
        under = (stands_m < PARKED_M).astype(float)
        block = slice(first, first + count)
        away_m = self.job.control.feedforward.height_error_m
        for (z_field, share_field), (visit_m, visit), error_m in (
            (_VISIT, self._visits, 0.0),
            (_NOMINAL_VISIT, self._nominal_visits, away_m),
        ):
            visiting = (visit[block] > 0.0) & self._armed
            placed_m = np.where(visiting, visit_m[block], stands_m + error_m)
            self._loop.planned(z_field)[0, block] = placed_m
            self._loop.planned(share_field)[0, block] = np.where(visiting, visit[block], under)

    def _arm(self) -> None:
        """Close the loop at the schedule's beginning, with noise of its own for every arming."""
        loop = self._loop
        loop.states[:] = lane_states(self._seed, [self._armings])
        self._armings += 1
        self._restart_controller()
        loop.set_driver(BUILT_IN)
        if self._own is not None:
            loop.set_driver(CALLER)
            self._controller = make_controllers(self._own, self.job.control.name)
            self._ticks_armed = 0
        self._jump(0)
        self._armed = True

    def _restart_controller(self) -> None:
        for record in _CONTROLLER:
            self._loop.view(record)[:] = 0.0

    def _catch(self, ticks: int) -> None:
        """Hold the beam and bring it towards level, as long as the loop is open."""
        back_rad = MAX_CATCH_RATE_RAD_S * ticks / self.control_rate_Hz
        theta = self._loop.view("hinge.theta_rad")
        theta -= np.clip(theta, -back_rad, back_rad)
        self._loop.view("hinge.rate_rad_s")[:] = 0.0

    def _jump(self, tick: int) -> None:
        """Go on at another tick of the schedule; what is late or delayed stays in order."""
        loop, shift = self._loop, tick - self._tick
        if shift:
            loop.sent[:] = np.roll(loop.sent, shift, axis=1)
            loop.past[:] = np.roll(loop.past, shift, axis=1)
        self._tick = tick


class _Still:
    """Ask for nothing; pulses drive the motors while it stands in for a controller."""

    def step(self, measurement: PitchMeasurement, reference: PitchReference, dt_s: float) -> float:
        return 0.0
