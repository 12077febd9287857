"""Telemetry of the bench: chart frames at 20 Hz and the live status at 4 Hz."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from benchtool.bench.bench import DeviceInfo, Readings
from benchtool.bench.guard import GuardedBench
from benchtool.core.channel import Channel, channel_family, unit_from_name
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig
from benchtool.core.units import Array
from benchtool.data.derived import MeasurementContext, evaluate_quantities, measurement_context
from benchtool.data.quantities import QUANTITIES
from benchtool.web.bench_process import messages
from benchtool.web.bench_process.publisher import Decimator, EventPublisher


def limit_shares(
    channels: Sequence[Channel],
    readings: Array,
    command_pwm_us: Sequence[float],
    rig: Rig,
    idle: dict[str, float],
) -> tuple[messages.LimitShare, ...]:
    """Return the mean of the channel that is closest to each limit, and how close it came.

    `readings` are minimum, mean and maximum (3, c), nan without samples. Voltage and temperature
    are not 0 at idle: their share is 0 at the session's extreme in `idle`, which is updated.
    """
    limits = messages.limits_by_family(rig.limits)
    families = np.array([channel_family(channel.name) for channel in channels])
    shares = []
    for name, family, unit in messages.LIMITED:
        is_minimum, zero = family == "voltage_V", 0.0
        columns = readings[:, families == family]
        if family == "pwm_us":
            columns, zero = np.tile(command_pwm_us, (3, 1)), rig.propulsion.pwm_stop_us
        low, mean, high = columns[:, np.isfinite(columns[1])]
        if not len(mean) or (is_minimum and low.min() <= 0.0):
            continue
        limit = limits[family]
        extreme = low if is_minimum else np.maximum(high, -low) if family == "thrust_N" else high
        if is_minimum:
            zero = idle[family] = max(idle.get(family, 0.0), float(high.max()))
        elif family == "temperature_degC":
            zero = idle[family] = min(idle.get(family, limit), float(low.min()))
        has_margin = zero > limit if is_minimum else zero < limit
        share = (extreme - zero) / (limit - zero) if has_margin else np.ones(len(mean))
        i = int(share.argmax())
        shares.append(
            messages.LimitShare(name, unit, float(mean[i]), limit, float(share[i]), is_minimum)
        )
    return tuple(shares)


FRAME_INTERVAL_S = 0.05
FRAMES_PER_STATUS = 5
MAX_READING_AGE = 8  # statuses, i.e. 2 s; an older reading is dropped; assumed
LIVE_QUANTITIES = (  # `data.quantities` on the page, and thrust
    "thrust_N", "torque_Nm", "power_W", "mechanical_power_W", "efficiency_gf_W",
    "motor_efficiency", "propeller_efficiency_N_W", "figure_of_merit",
)  # fmt: skip


def live_values(
    channels: Sequence[Channel], means: Array, context: MeasurementContext, *, is_driven: bool
) -> dict[str, tuple[float, str]]:
    """Return value and unit of the mean thrust, and of quantities derived from means (c,).

    Derived quantities (power, efficiency) need driven motors.
    """
    recording = Recording(tuple(channels), means[None])
    values = evaluate_quantities(recording, context) if is_driven else {}
    if "thrust_N" in recording:
        values["thrust_N"] = recording.column("thrust_N")
    titles = {quantity.name: quantity.title for quantity in QUANTITIES} | {"thrust_N": "thrust"}
    return {
        titles[name]: (float(values[name][0]), unit_from_name(name))
        for name in LIVE_QUANTITIES
        if name in values and np.isfinite(values[name][0])
    }


class Telemetry:
    """Telemetry of every read of a bench; `speed` returns 0 for real time."""

    def __init__(
        self, session: int, rig: Rig, publisher: EventPublisher, speed: Callable[[], float]
    ) -> None:
        self.rig = rig  # with the limits in force
        self._session, self._publisher = session, publisher
        self._speed = speed
        self._guarded: GuardedBench | None = None
        self._frames: Decimator | None = None
        self._live = messages.LiveStatus()
        self._frames_since_status = 0
        self._rate_samples, self._rate_time_s = 0, 0.0
        self._samples: list[Array] = []
        self._idle: dict[str, float] = {}
        self._rig_context = measurement_context(rig=rig)

    def begin(self, identity: DeviceInfo, guarded: GuardedBench | None) -> None:
        """Start publishing; earlier reads are dropped."""
        self._guarded = guarded
        self._channels = identity.channels
        self._frames = Decimator(self._session, len(identity.channels))
        self._readings: Array = np.full((3, len(identity.channels)), np.nan)
        self._age: Array = np.zeros(len(identity.channels))  # of the readings, in statuses
        self._start_s = self._last_frame_s = time.monotonic()

    def update(self, **changes: Any) -> None:
        """Change the next status; a change of `busy` is published at once."""
        is_urgent = "busy" in changes and changes["busy"] != self._live.busy
        self._live = replace(self._live, **changes)
        if is_urgent:
            self._publisher.publish(self._live)

    def add(self, readings: Readings) -> None:
        """Add the readings of one read; called for every read of the bench."""
        if self._frames is None:
            return
        self._frames.add(readings.values, readings.lost)
        self._samples.append(readings.values)
        live = self._live
        self._live = replace(
            live,
            samples=live.samples + len(readings),
            lost=live.lost + readings.lost,
            corrupt=live.corrupt + readings.corrupt,
        )
        for message in readings.messages:
            if not message.startswith("arrived"):
                self._publisher.publish(messages.Notice(text=f"device: {message}"))
        now_s = time.monotonic()
        if now_s - self._last_frame_s < FRAME_INTERVAL_S:
            return
        # Frames stay on their time grid, except after a delay of more than one interval.
        self._last_frame_s = max(self._last_frame_s + FRAME_INTERVAL_S, now_s - FRAME_INTERVAL_S)
        self._publisher.publish_frame(self._frames.pop_frame(now_s - self._start_s))
        self._frames_since_status += 1
        if self._frames_since_status >= FRAMES_PER_STATUS:
            self._publish_status(float(readings.time_s[-1]) if len(readings) else None)
            self._frames_since_status = 0

    def _update_readings(self) -> None:
        """Set the readings to those since the last status; slow channels keep theirs for 2 s."""
        samples = np.concatenate(self._samples)
        self._samples.clear()
        samples[~np.isfinite(samples)] = np.nan
        counts = np.isfinite(samples).sum(axis=0)
        with np.errstate(invalid="ignore"):
            mean = np.nansum(samples, axis=0) / counts
        low, high = (f.reduce(samples, axis=0, initial=np.nan) for f in (np.fmin, np.fmax))
        self._age = np.where(counts, 0, self._age + 1)
        is_held = (self._age > 0) & (self._age < MAX_READING_AGE)
        self._readings = np.where(is_held, self._readings, (low, mean, high))

    def _publish_status(self, newest_s: float | None) -> None:
        self._update_readings()
        command_pwm_us = tuple(self._guarded.pwm_us.tolist()) if self._guarded else ()
        standstill = self._guarded.standstill if self._guarded else None
        is_driven = self._guarded is not None and standstill is None
        rate_Hz = self._live.rate_Hz
        if newest_s is not None:
            n_samples, duration_s = self._live.samples, newest_s - self._rate_time_s
            if self._rate_time_s and duration_s > 0.0:
                rate_Hz = (n_samples - self._rate_samples) / duration_s
            self._rate_samples, self._rate_time_s = n_samples, newest_s
        self._live = replace(
            self._live,
            command_pwm_us=command_pwm_us,
            rate_Hz=rate_Hz,
            values=live_values(
                self._channels, self._readings[1], self._rig_context, is_driven=is_driven
            ),
            limits=limit_shares(
                self._channels, self._readings, command_pwm_us, self.rig, self._idle
            ),
            speed=self._speed(),
            standstill=standstill.text if standstill else "",
        )
        self._publisher.publish(self._live)
