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
from benchtool.core.rig import Limits, Rig
from benchtool.core.units import Array
from benchtool.data.derived import MeasurementContext, evaluate_quantities, measurement_context
from benchtool.data.quantities import QUANTITIES
from benchtool.web.bench_process.messages import (
    SPEED_LIMIT,
    LimitShare,
    LiveStatus,
    LiveValue,
    Notice,
)
from benchtool.web.bench_process.publisher import (
    Decimator,
    EventPublisher,
    frame_extremes,
    merge_frames,
)


def limit_shares(
    names: Sequence[str], low: Array, high: Array, command_pwm_us: Sequence[float], limits: Limits
) -> tuple[LimitShare, ...]:
    """Return every limit with the closest reading."""
    shares = []
    for family, label, limit in (
        ("thrust_N", "thrust, N", min(limits.thrust_N, limits.load_cell_rating_N)),
        ("rpm", SPEED_LIMIT, limits.rpm),
        ("current_A", "current, A", limits.current_A),
        ("temperature_degC", "ESC, degC", limits.temperature_degC),
    ):
        columns = [i for i, name in enumerate(names) if channel_family(name) == family]
        values = [max(high[i], -low[i] if family == "thrust_N" else high[i]) for i in columns]
        finite = [float(value) for value in values if np.isfinite(value)]
        if finite:
            shares.append(LimitShare(label, max(finite), limit, max(finite) / limit))
    if "voltage_V" in names:
        voltage_V = float(low[list(names).index("voltage_V")])
        if np.isfinite(voltage_V) and voltage_V > 0.0:
            min_V = limits.voltage_min_V
            shares.append(LimitShare("min. voltage, V", voltage_V, min_V, min_V / voltage_V))
    if command_pwm_us:
        max_us = max(command_pwm_us)
        shares.append(LimitShare("pulse width, us", max_us, limits.pwm_us, max_us / limits.pwm_us))
    return tuple(shares)


FRAME_INTERVAL_S = 0.05
FRAMES_PER_STATUS = 5
LIVE_QUANTITIES = (  # `data.quantities` on the page, and thrust
    "thrust_N", "torque_Nm", "power_W", "mechanical_power_W", "efficiency_gf_W",
    "motor_efficiency", "propeller_efficiency_N_W", "figure_of_merit",
)  # fmt: skip


def live_values(
    channels: Sequence[Channel], samples: Array, context: MeasurementContext, *, is_driven: bool
) -> tuple[LiveValue, ...]:
    """Return means over samples (m, c), ignoring nan, and derived quantities of driven motors."""
    is_finite = np.isfinite(samples)
    with np.errstate(invalid="ignore"):
        means = np.where(is_finite, samples, 0.0).sum(axis=0) / is_finite.sum(axis=0)
    recording = Recording(tuple(channels), means[None])
    values = evaluate_quantities(recording, context) if is_driven else {}
    if "thrust_N" in recording:
        values["thrust_N"] = recording.column("thrust_N")
    titles = {quantity.name: quantity.title for quantity in QUANTITIES} | {"thrust_N": "thrust"}
    return tuple(
        LiveValue(titles[name], float(values[name][0]), unit_from_name(name))
        for name in LIVE_QUANTITIES
        if name in values and np.isfinite(values[name][0])
    )


class Telemetry:
    """Telemetry of every read of a bench; `speed` returns 0 for real time."""

    def __init__(
        self,
        session: int,
        rig: Rig,
        publisher: EventPublisher,
        speed: Callable[[], float],
    ) -> None:
        self._session, self._rig, self._publisher = session, rig, publisher
        self._speed = speed
        self._guarded: GuardedBench | None = None
        self._names: tuple[str, ...] = ()
        self._frames: Decimator | None = None
        self._status_frame: bytes | None = None
        self._live = LiveStatus()
        self._start_s = self._last_frame_s = time.monotonic()
        self._frames_since_status = 0
        self._rate_samples, self._rate_time_s = 0, 0.0
        self._channels: tuple[Channel, ...] = ()
        self._samples: list[Array] = []
        self._rig_context = measurement_context(rig=rig)

    def set_limits(self, limits: Limits) -> None:
        self._rig = replace(self._rig, limits=limits)

    def begin(self, identity: DeviceInfo, guarded: GuardedBench | None) -> None:
        """Start publishing; earlier reads are dropped."""
        self._guarded = guarded
        self._channels = identity.channels
        self._names = tuple(channel.name for channel in identity.channels)
        self._frames = Decimator(self._session, len(self._names))
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
        self._frames.add(readings.values)
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
                self._publisher.publish(Notice(text=f"device: {message}"))
        self._publish(self._frames, float(readings.time_s[-1]) if len(readings) else None)

    def _publish(self, frames: Decimator, newest_s: float | None) -> None:
        now_s = time.monotonic()
        if now_s - self._last_frame_s < FRAME_INTERVAL_S:
            return
        # Frames stay on their time grid, except after a delay of more than one interval.
        self._last_frame_s = max(self._last_frame_s + FRAME_INTERVAL_S, now_s - FRAME_INTERVAL_S)
        frame = frames.pop_frame(now_s - self._start_s)
        older = self._status_frame
        self._status_frame = frame if older is None else merge_frames(older, frame)
        self._publisher.publish_frame(frame)
        self._frames_since_status += 1
        if self._frames_since_status >= FRAMES_PER_STATUS:
            self._publish_status(self._status_frame, newest_s)
            self._status_frame, self._frames_since_status = None, 0

    def _publish_status(self, frame: bytes, newest_s: float | None) -> None:
        low, high = frame_extremes(frame)
        command_pwm_us = tuple(self._guarded.pwm_us.tolist()) if self._guarded else ()
        standstill = self._guarded.standstill if self._guarded else None
        is_driven = self._guarded is not None and standstill is None
        samples, rate_Hz = np.concatenate(self._samples), self._live.rate_Hz
        if newest_s is not None:
            n_samples, duration_s = self._live.samples, newest_s - self._rate_time_s
            if self._rate_time_s and duration_s > 0.0:
                rate_Hz = (n_samples - self._rate_samples) / duration_s
            self._rate_samples, self._rate_time_s = n_samples, newest_s
        self._live = replace(
            self._live,
            command_pwm_us=command_pwm_us,
            rate_Hz=rate_Hz,
            values=live_values(self._channels, samples, self._rig_context, is_driven=is_driven),
            limits=limit_shares(self._names, low, high, command_pwm_us, self._rig.limits),
            speed=self._speed(),
            standstill=standstill.text if standstill else "",
        )
        self._samples.clear()
        self._publisher.publish(self._live)
