"""Pitch experiment with the control loop on the device: limits, arming text and recording."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from math import degrees, nan, pi
from typing import Any

import numpy as np

from benchtool.acquire.check_plan import PlanExtremes
from benchtool.acquire.experiment import Experiment
from benchtool.acquire.inputs import RecordInputs
from benchtool.acquire.operator import Operator
from benchtool.acquire.record import Recorder, RunProgress
from benchtool.bench.bench import DeviceInfo, Readings
from benchtool.bench.guard import GuardedBench
from benchtool.core.errors import InputError, LimitExceeded, PlanError
from benchtool.core.rig import Rig
from benchtool.core.text import pluralize
from benchtool.data.run.run import Run

RATE_LIMIT_RAD_S = 10.0  # host limit, equal to the device's; assumed
REQUIRED_CHANNELS = ("theta_rad", "gyro_rad_s")  # of every pitch bench
RAMP_UP_S = 0.5  # ramp from idle to the collective; ten times the motor lag; assumed
CHUNK_S = 1.0  # interval of statistics and of syncing to disk; assumed


def check_experiment(
    inputs: RecordInputs, rig: Rig, device: DeviceInfo | None = None
) -> PlanExtremes:
    """Return the maxima at the collective, with the limits of an open bench if given.

    Raises:
        InputError: not a pitch bench.
        PlanError: limits of bench or rig are exceeded.
    """
    device_limits: Mapping[str, float] = {}
    idle_us = 0.0
    if device is not None:
        names = {channel.name for channel in device.channels}
        if missing := [name for name in REQUIRED_CHANNELS if name not in names]:
            raise InputError(
                f"{device.address} is not a pitch bench: channel {missing[0]} is missing; use a "
                f"pitch bench (virtual: sim:RIG?mode=pitch, or benchtool bench serve --mode pitch)"
            )
        device_limits, idle_us = device.limits, device.pwm_idle_us or 0.0
    pulse_us = inputs.collective_us(rig)
    p, limits = rig.propulsion, rig.limits
    min_us = max(p.pwm_start_us, idle_us)
    max_us = min(limits.pwm_us, p.pwm_max_us, device_limits.get("pwm_us", p.pwm_max_us))
    if not min_us < pulse_us <= max_us:
        raise PlanError(
            f"collective {pulse_us:g} us is out of range; allowed: above {min_us:g} us, at most "
            f"{max_us:g} us"
        )
    speed_rad_s = p.speed_per_us_rad_s * (pulse_us - p.pwm_start_us)
    rpm = speed_rad_s * 30.0 / pi
    max_rpm = min(limits.rpm, device_limits.get("rpm", limits.rpm))
    if rpm > max_rpm:
        raise PlanError(
            f"collective {pulse_us:g} us gives about {rpm:.0f} rpm, limit {max_rpm:.0f} rpm; "
            f"lower --collective"
        )
    thrust_N = rig.n_rotors * p.thrust_coefficient_N_s2 * speed_rad_s**2
    if thrust_N > limits.thrust_N:
        raise PlanError(
            f"collective {pulse_us:g} us gives about {thrust_N:.1f} N, limit "
            f"{limits.thrust_N:g} N; lower --collective"
        )
    low_m, high_m = rig.plate.z_min_m, rig.plate.z_max_m
    if inputs.plate_z_m is not None and not low_m <= inputs.plate_z_m <= high_m:
        raise PlanError(
            f"--plate-z-m is {inputs.plate_z_m:g}; allowed: {low_m:g} to {high_m:g} m of rig "
            f"{rig.name!r}"
        )
    return PlanExtremes(pulse_us, rpm, thrust_N, thrust_N)


def arming_text(inputs: RecordInputs, rig: Rig, expected: PlanExtremes) -> str:
    """Return the prompt shown before arming."""
    names = [f"{number + 1} ({rotor.name})" for number, rotor in enumerate(rig.rotors)]
    return (
        f"rotors that will turn: {', '.join(names)}; the beam is free to turn\n"
        f"collective: {inputs.collective_us(rig):g} us of {rig.limits.pwm_us:g} us, about "
        f"{expected.rpm:.0f} rpm and {expected.thrust_N:.1f} N in total; the control loop adds "
        f"to it\n"
        f"stops beyond {inputs.limit_deg:g} deg; records "
        f"{inputs.seconds:g} s"
    )


class PitchRecorder(Recorder):
    """Recorder that stops at excessive pitch angle or rate."""

    def __init__(
        self, bench: GuardedBench, run: Run, progress: RunProgress, pitch_limit_rad: float
    ) -> None:
        super().__init__(bench, run, progress)
        self._limits = {"theta_rad": pitch_limit_rad, "gyro_rad_s": RATE_LIMIT_RAD_S}
        self._watched = [
            (index, channel.name)
            for index, channel in enumerate(bench.identity.channels)
            if channel.name in self._limits
        ]

    def stop_watching(self) -> None:
        """Stop checking limits; only record from now on."""
        self._watched = []

    def store(self, readings: Readings, phase: str, point: int = 0) -> Readings:
        """Write readings; if they exceed a limit, command zero first (once).

        Raises:
            LimitExceeded: after the samples were stored on disk or for `rescue`.
        """
        for index, name in self._watched:
            limit, column = self._limits[name], readings.values[:, index]
            beyond = column[np.abs(column) > limit]
            if len(beyond):
                self.stop_watching()
                with suppress(Exception):
                    self.bench.stop()
                with suppress(Exception):
                    super().store(readings, phase, point)
                remedy = "check gains and mechanics, or raise --limit-deg"
                raise LimitExceeded(name, float(beyond[0]), limit, remedy)
        return super().store(readings, phase, point)


class PitchRecording(Experiment):
    """Recording of a pitch experiment.

    Attributes:
        max_angle_rad, rms_error_rad: of the recording; nan without reference.
    """

    kind = "pitch"
    inputs: RecordInputs
    recorder: PitchRecorder

    def prepare(self) -> Iterator[str]:
        expected = check_experiment(self.inputs, self.rig)
        if self.inputs.dry_run:
            yield arming_text(self.inputs, self.rig, expected)
            yield "dry run: nothing was opened, nothing spins"

    def check(self, bench: GuardedBench, operator: Operator) -> str:
        expected = check_experiment(self.inputs, self.rig, bench.identity)
        return arming_text(self.inputs, self.rig, expected)

    def describe_run(self, identity: DeviceInfo) -> tuple[str, str, dict[str, Any]]:
        inputs, rig = self.inputs, self.rig
        facts = {
            "experiment": "pitch",
            "schedule": inputs.schedule or identity.facts.get("schedule", ""),
            "collective_us": inputs.collective_us(rig),
            "seconds": inputs.seconds,
        }
        return inputs.name, inputs.plan_text(rig), facts

    def build_recorder(self, bench: GuardedBench, run: Run) -> PitchRecorder:
        bench.expect_loop()
        return PitchRecorder(bench, run, self.progress, self.inputs.pitch_limit_rad)

    def measure(self) -> None:
        inputs, recorder = self.inputs, self.recorder
        if inputs.plate_z_m is not None:
            recorder.bench.move_plate(inputs.plate_z_m)
        collective_us = inputs.collective_us(self.rig)
        recorder.record_event("armed", f"collective {collective_us:g} us")
        self.motors.ramp_to(np.full(self.rig.n_rotors, collective_us), RAMP_UP_S, "ramp")
        self.max_angle_rad, squares, count = 0.0, 0.0, 0
        end_s = recorder.bench.now_s() + inputs.seconds
        while (remaining_s := end_s - recorder.bench.now_s()) > 1e-9:
            self.progress.remaining(remaining_s)
            part = recorder.collect("sample", min(CHUNK_S, remaining_s))
            recorder.sync()
            theta = part.column("theta_rad")
            angle_rad = float(np.nanmax(np.abs(theta), initial=0.0))
            self.max_angle_rad = max(self.max_angle_rad, angle_rad)
            if "theta_ref_rad" in part:
                error = theta - part.column("theta_ref_rad")
                squares += float(np.nansum(error**2))
                count += int(np.isfinite(error).sum())
        self.rms_error_rad = float(np.sqrt(squares / count)) if count else nan

    def summarise(self) -> str:
        return f"{self.inputs.seconds:g} s recorded"

    def hold(self) -> None:
        self.recorder.stop_watching()

    def summary(self, simulated: str = "") -> str:
        quality, rms_deg = self.recorder.quality, degrees(self.rms_error_rad)
        tracking = "" if np.isnan(rms_deg) else f", RMS error {rms_deg:.2f} deg"
        return (
            f"{self.inputs.seconds:g} s, {pluralize(quality.samples, 'sample')}, "
            f"{quality.lost} lost; largest angle {degrees(self.max_angle_rad):.2f} deg"
            f"{tracking}{simulated}"
        )
