"""Whether the samples of a visit can make a point: enough of them, on time, and not frozen."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import inf, nan, pi, sqrt

import numpy as np

from benchtool.bench.bench import Readings
from benchtool.bench.channel_limits import CHECKS, ChannelChecks
from benchtool.core.array_type import Array
from benchtool.core.channel import channel_family
from benchtool.core.recording import Recording
from benchtool.core.rig import Sensor

FROZEN_S, FROZEN_VALUES = 1.0, 20  # a channel that repeats one number so long and often; assumed
FALSE_ALARM_PROBABILITY = (
    1e-9  # probability of a repetition by noise, below which it is frozen; assumed
)
MIN_RELATIVE_CHANGE = (
    0.05  # change of thrust per squared speed within a visit; drift makes less; assumed
)
MAX_LAG_S = 1.0  # of a load cell behind the pulse: twice that of slow ones; assumed
MAX_DELAY_PERIODS = 3.0  # a value may be so many of its channel's periods old; assumed


def required_samples(name: str) -> bool:
    """Return whether a point cannot do without a channel."""
    return CHECKS.get(channel_family(name), ChannelChecks()).needed


@dataclass(frozen=True, slots=True, kw_only=True)
class VisitChecks:
    """Check the samples of one visit, while they come and when all are there.

    Attributes:
        rates_Hz: how often each channel that turns with the visit's rotors should bring a value.
        sensors: of the rig: noise and resolution by kind of channel.
        seconds, share: span of the samples, and the share of them that a point needs.
        before: what each channel showed last in the visit before, at other pulses; empty where
            the pulses are the same or zero was commanded between.
    """

    rates_Hz: Mapping[str, float]
    sensors: Mapping[str, Sensor]
    seconds: float
    share: float
    before: Mapping[str, float] = field(default_factory=dict)

    def shortage(self, samples: Recording) -> str:
        """Return which needed channel of a whole visit lacks samples, in words; "" for none."""
        for name in filter(required_samples, self.rates_Hz):
            expected = self.seconds * self.rates_Hz[name]
            count = int(np.isfinite(samples.column(name)).sum())
            # The span may begin just behind a value.
            if count < self.share * expected - 1.0 or not count:
                return (
                    f"{count} of {expected:.0f} samples of {name} came, at least "
                    f"{100.0 * self.share:g} % are needed (sample_share)"
                )
        return ""

    def late(self, seen: Recording) -> str:
        """Return which needed channel's newest value is too old, in words; "" for none.

        Older than three periods of its channel, and than the silence that `share` allows, while
        other channels bring values.
        """
        time_s = seen.column("time_s")
        for name in filter(required_samples, self.rates_Hz if len(time_s) else ()):
            if not (rate_Hz := self.rates_Hz[name]):
                continue
            present = np.isfinite(seen.column(name))
            newest_s = time_s[present][-1] if present.any() else time_s[0]
            allowed_s = max(MAX_DELAY_PERIODS / rate_Hz, (1.0 - self.share) * self.seconds)
            if (age_s := float(time_s[-1] - newest_s)) > allowed_s:
                return (
                    f"the newest value of {name} is {age_s:.2f} s old, its period is "
                    f"{1.0 / rate_Hz:.3g} s, limit {allowed_s:.2f} s; check its sensor and wiring"
                )
        return ""

    def frozen(self, seen: Recording, commanded_s: float) -> dict[str, str]:
        """Return the channels that repeat one number although they should not: why, in words.

        Args:
            seen: samples of the visit from the end of its ramp on.
        """
        found = {}
        for name in self.rates_Hz:
            column, time_s = seen.column(name), seen.column("time_s")
            present = np.isfinite(column)
            values, times_s = column[present], time_s[present]
            if not len(values):
                continue
            others = np.flatnonzero(values != values[-1])
            begin = int(others[-1]) + 1 if len(others) else 0
            count, since_s = len(values) - begin, float(times_s[begin])
            if count < FROZEN_VALUES or times_s[-1] - since_s < FROZEN_S:
                continue
            if why := self._why(name, float(values[-1]), count) or self._moved(
                name, seen, max(since_s, commanded_s + MAX_LAG_S)
            ):
                found[name] = (
                    f"{name} repeats {values[-1]:.6g} for {times_s[-1] - since_s:.1f} s "
                    f"({count} values), {why}"
                )
        return found

    def _why(self, name: str, number: float, count: int) -> str:
        checks = CHECKS.get(channel_family(name), ChannelChecks())
        sensor = self.sensors.get(channel_family(name), Sensor())
        if sensor.noise > 0.0:
            # Two readings round to one number: q times the density of their difference at zero.
            equal = sensor.quantum / (2.0 * sqrt(pi) * sensor.noise)
            if min(equal, 1.0) ** (count - 1) < FALSE_ALARM_PROBABILITY:
                return (
                    f"but noise of {sensor.noise:g} at a resolution of {sensor.quantum:g} should "
                    f"show; check its sensor, or correct sensors.{channel_family(name)} of the rig"
                )
        if checks.follows and number == self.before.get(name):
            return "as it did at the pulses before; check its sensor and wiring"
        return ""

    def _moved(self, name: str, seen: Recording, since_s: float) -> str:
        """Return that thrust and squared speeds went apart while a channel stood still."""
        rotors = [other for other in self.rates_Hz if channel_family(other) == "rpm"]
        time_s = seen.column("time_s")
        if not rotors or name not in ("thrust_N", *rotors) or time_s[-1] - since_s < FROZEN_S:
            return ""
        thirds = np.linspace(since_s, time_s[-1], 4)
        ratios = []
        for low_s, high_s in ((thirds[0], thirds[1]), (thirds[2], thirds[3])):
            rows = (time_s >= low_s) & (time_s <= high_s)
            thrust, *speeds = (_mean(seen.column(other)[rows]) for other in ("thrust_N", *rotors))
            squares = sum(speed**2 for speed in speeds)
            ratios.append(thrust / squares if squares > 0.0 else nan)
        change = abs(ratios[1] / ratios[0] - 1.0) if ratios[0] else nan
        if not change > MIN_RELATIVE_CHANGE:
            return ""
        return (
            f"while thrust over the squared speeds changed by {100.0 * change:.0f} %; check its "
            f"sensor and wiring"
        )


def _mean(values: Array) -> float:
    present = values[np.isfinite(values)]
    return float(present.mean()) if len(present) else nan


LOOK_EVERY_S, LOOK_BACK_S = 0.25, 30.0  # interval of looks at samples, and their span; assumed


class VisitWatch:
    """Look at the samples of a visit while they come.

    Attributes:
        problem: event and text of what makes the visit bad, once it is found.
        remarks: what is wrong with channels that a point can do without, by channel.
    """

    def __init__(
        self, checks: VisitChecks, joined: Callable[[list[Readings]], Recording], commanded_s: float
    ) -> None:
        self._checks, self._joined, self._commanded_s = checks, joined, commanded_s
        self._recent: list[Readings] = []
        self._looked_s = -inf
        self.problem: tuple[str, str] | None = None
        self.remarks: dict[str, str] = {}

    def take(self, readings: Readings) -> bool:
        """Take what arrived; return whether the visit is bad."""
        if not len(readings):
            return False
        self._recent.append(readings)
        now_s = float(readings.time_s[-1])
        if now_s - self._looked_s < LOOK_EVERY_S:
            return False
        self._looked_s = now_s
        while self._recent[0].time_s[-1] < now_s - LOOK_BACK_S:
            del self._recent[0]
        seen = self._joined(self._recent)
        if late := self._checks.late(seen):
            self.problem = ("late", late)
        frozen = self._checks.frozen(seen, self._commanded_s)
        for name, text in frozen.items():
            if required_samples(name):
                self.problem = ("frozen", text)
            else:
                self.remarks.setdefault(name, text)
        return self.problem is not None
