"""Telemetry of every sample: frames for the charts, and a few numbers four times a second."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from benchtool.bench.bench import DeviceInfo, Readings
from benchtool.bench.guard import GuardedBench
from benchtool.core.array_type import Array
from benchtool.core.channel import Channel, unit_from_name
from benchtool.core.recording import Recording
from benchtool.core.rig import Limits, Rig
from benchtool.data.derived import MeasurementContext, quantities_of, rig_circumstances
from benchtool.data.quantities import QUANTITIES
from benchtool.web.bench_process.messages import (
    SPEED_LIMIT,
    LimitShare,
    LiveStatus,
    LiveValue,
    Notice,
)
from benchtool.web.bench_process.publisher import Decimator, EventPublisher, merged, split


def limit_shares(
    names: Sequence[str], low: Array, high: Array, pulses_us: Sequence[float], limits: Limits
) -> tuple[LimitShare, ...]:
    """Return every limit with the reading that was nearest to it."""
    found = []
    for family, label, limit in (
        ("thrust_N", "thrust, N", min(limits.thrust_N, limits.load_cell_rating_N)),
        ("rpm", SPEED_LIMIT, limits.rpm),
        ("current_A", "current, A", limits.current_A),
        ("temperature_degC", "ESC, degC", limits.temperature_degC),
    ):
        columns = [i for i, name in enumerate(names) if _family(name) == family]
        values = [max(high[i], -low[i] if family == "thrust_N" else high[i]) for i in columns]
        present = [float(value) for value in values if np.isfinite(value)]
        if present:
            found.append(LimitShare(label, max(present), limit, max(present) / limit))
    if "voltage_V" in names:
        volts = float(low[list(names).index("voltage_V")])
        if np.isfinite(volts) and volts > 0.0:
            least = limits.voltage_min_V
            found.append(LimitShare("least voltage, V", volts, least, least / volts))
    if pulses_us:
        pulse = max(pulses_us)
        found.append(LimitShare("pulse, us", pulse, limits.pwm_us, pulse / limits.pwm_us))
    return tuple(found)


def _family(name: str) -> str:
    bare = name.rstrip("0123456789")
    return "rpm" if bare == "rpm" else name


FRAME_S = 0.05  # Time between two frames: 20 a second
STATUS_FRAMES = 5  # Frames from one status to the next: four a second


SHOWN = (
    "thrust_N", "torque_Nm", "power_W", "mechanical_power_W", "efficiency_gf_W",
    "motor_efficiency", "propeller_efficiency_N_W", "figure_of_merit",
)  # fmt: skip
"""Quantities of `data.quantities` that the page shows live, and thrust."""


def live_values(
    channels: Sequence[Channel], samples: Array, known: MeasurementContext, *, turning: bool
) -> tuple[LiveValue, ...]:
    """Return means over samples (m, c), nan left out, and what follows while motors turn."""
    present = np.isfinite(samples)
    with np.errstate(invalid="ignore"):
        means = np.where(present, samples, 0.0).sum(axis=0) / present.sum(axis=0)
    recording = Recording(tuple(channels), means[None])
    found = quantities_of(recording, known) if turning else {}
    if "thrust_N" in recording:
        found["thrust_N"] = recording.column("thrust_N")
    titles = {one.name: one.title for one in QUANTITIES} | {"thrust_N": "thrust"}
    return tuple(
        LiveValue(titles[name], float(found[name][0]), unit_from_name(name))
        for name in SHOWN
        if name in found and np.isfinite(found[name][0])
    )


class Telemetry:
    """Receive every read of a bench and publish it; speed is 0 where the clock is the wall's."""

    def __init__(
        self,
        session: int,
        rig: Rig,
        publisher: EventPublisher,
        speed: Callable[[], float],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._session, self._rig, self._publisher = session, rig, publisher
        self._speed, self._clock = speed, clock
        self._guarded: GuardedBench | None = None
        self._names: tuple[str, ...] = ()
        self._frames: Decimator | None = None
        self._since_status: bytes | None = None
        self._live = LiveStatus()
        self._begun_s = self._framed_s = clock()
        self._frames_since_status = 0
        self._counted, self._counted_s = 0, 0.0
        self._channels: tuple[Channel, ...] = ()
        self._seen: list[Array] = []
        self._known = rig_circumstances(rig)

    def tighten(self, limits: Limits) -> None:
        """Show other limits from now on."""
        self._rig = replace(self._rig, limits=limits)

    def begin(self, identity: DeviceInfo, guarded: GuardedBench | None) -> None:
        """Publish from now on; what is read before the bench is known is left out."""
        self._guarded = guarded
        self._channels = identity.channels
        self._names = tuple(channel.name for channel in identity.channels)
        self._frames = Decimator(self._session, len(self._names))
        self._begun_s = self._framed_s = self._clock()

    def note(self, **facts: Any) -> None:
        """Change the next status; another `busy` is published at once."""
        hurry = "busy" in facts and facts["busy"] != self._live.busy
        self._live = replace(self._live, **facts)
        if hurry:
            self._publisher.publish(self._live)

    def take(self, readings: Readings) -> None:
        """Take what a read brought; every read of the bench passes here."""
        if self._frames is None:
            return
        self._frames.add(readings.values)
        self._seen.append(readings.values)
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
        now_s = self._clock()
        if now_s - self._framed_s < FRAME_S:
            return
        # The next frame is due on the grid, unless this one came far too late.
        self._framed_s = max(self._framed_s + FRAME_S, now_s - FRAME_S)
        frame = frames.take(now_s - self._begun_s)
        since = self._since_status
        self._since_status = frame if since is None else merged(since, frame)
        self._publisher.publish_frame(frame)
        self._frames_since_status += 1
        if self._frames_since_status >= STATUS_FRAMES:
            self._publish_status(self._since_status, newest_s)
            self._since_status, self._frames_since_status = None, 0

    def _publish_status(self, frame: bytes, newest_s: float | None) -> None:
        low, high = split(frame)
        pulses = tuple(self._guarded.pwm_us.tolist()) if self._guarded else ()
        seen = self._guarded.standstill if self._guarded else None
        turning = self._guarded is not None and seen is None
        rate_Hz = self._live.rate_Hz
        if newest_s is not None:
            if self._counted_s and newest_s > self._counted_s:
                rate_Hz = (self._live.samples - self._counted) / (newest_s - self._counted_s)
            self._counted, self._counted_s = self._live.samples, newest_s
        self._live = replace(
            self._live,
            pulses_us=pulses,
            rate_Hz=rate_Hz,
            values=live_values(
                self._channels, np.concatenate(self._seen), self._known, turning=turning
            ),
            limits=limit_shares(self._names, low, high, pulses, self._rig.limits),
            speed=self._speed(),
            standstill=seen.text if seen else "",
        )
        self._seen.clear()
        self._publisher.publish(self._live)
