from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchtool.acquire.measure import VisitChecks
from benchtool.core.channel import Channel
from benchtool.core.recording import Recording
from benchtool.core.rig import Sensor


def span(thrust_values: int, rpm_values: int) -> Recording:
    rows = np.full((200, 2), np.nan)
    rows[:thrust_values, 0], rows[:rpm_values, 1] = 1.0, 4500.0
    return Recording((Channel("thrust_N", "N"), Channel("rpm1", "rpm")), rows)


@pytest.mark.parametrize(
    ("thrust", "rpm", "said"),
    [
        (160, 200, ""),
        (127, 200, ""),  # one below 80 %: the span may begin just behind a value
        (126, 200, "126 of 160 samples of thrust_N received, minimum 80 %"),
        (0, 200, "0 of 160 samples of thrust_N"),
        (160, 40, "40 of 200 samples of rpm1"),
    ],
)
def test_a_point_needs_its_share(thrust, rpm, said):
    text = checks(thrust_N=80.0, rpm1=100.0).shortage(span(thrust, rpm))
    assert text.startswith(said)
    assert bool(text) == bool(said)


def test_a_channel_that_never_had_a_value_is_short_whatever_its_rate():
    assert "0 of 0 samples of thrust_N" in checks(thrust_N=0.0).shortage(span(0, 0))


def checks(before: dict[str, float] | None = None, **rates_Hz: float) -> VisitChecks:
    return VisitChecks(
        rates_Hz=rates_Hz,
        sensors={"rpm": Sensor(noise=8.0, quantum=1.0), "plate_z_m": Sensor(noise=1e-4)},
        seconds=2.0,
        share=0.8,
        before=before or {},
    )


def visit(rpm1: np.ndarray, thrust_N: np.ndarray | None = None) -> Recording:
    """Return three seconds at 100 Hz."""
    time_s = np.arange(300) / 100.0
    thrust = 1.0 + 1e-3 * np.sin(50.0 * time_s) if thrust_N is None else thrust_N
    channels = (Channel("time_s", "s"), Channel("thrust_N", "N"), Channel("rpm1", "rpm"))
    return Recording(channels, np.column_stack([time_s, thrust, rpm1]))


RAW = np.random.default_rng(2).normal(4312.0, 8.0, 300).round()
COARSE = Sensor(noise=8.0, quantum=100.0)


def frozen(seen: Recording, before: float | None = None, sensor: Sensor | None = None) -> str:
    own = checks({"rpm1": before} if before else None, thrust_N=100.0, rpm1=100.0)
    if sensor:
        own = replace(own, sensors={"rpm": sensor})
    return own.frozen(seen, 0.0).get("rpm1", "")


def test_a_speed_whose_noise_does_not_show_is_frozen():
    assert frozen(visit(RAW)) == ""
    assert frozen(visit(np.where(np.arange(300) < 205, RAW, 4310.0))) == ""  # not yet a second
    stuck = np.where(np.arange(300) < 150, RAW, 4310.0)
    said = "rpm1 repeats 4310 for 1.5 s (150 values), but noise 8 at resolution 1 is expected"
    assert frozen(visit(stuck)).startswith(said)


def test_a_coarse_speed_may_repeat_itself_unless_the_pulses_or_the_thrust_changed():
    same = np.full(300, 4300.0)
    assert frozen(visit(same), sensor=COARSE) == ""
    assert frozen(visit(same), 4100.0, COARSE) == ""
    assert "the same as at the previous pulses" in frozen(visit(same), 4300.0, COARSE)
    rising = np.linspace(1.0, 1.2, 300)
    assert "changed by 8 %" in frozen(visit(same, rising), sensor=COARSE)
    assert frozen(visit(np.where(np.arange(300) % 50, 4300.0, 4400.0), rising)) == ""


@pytest.mark.parametrize("channel", ["rpm1", "thrust_N"])
def test_telemetry_older_than_its_period_is_late(channel):
    seen = visit(RAW)
    values = seen.values.copy()
    values[255:, seen.index(channel)] = np.nan
    both = checks(thrust_N=100.0, rpm1=100.0)
    assert both.late(Recording(seen.channels, values[:290])) == ""
    said = both.late(Recording(seen.channels, values))
    assert said.startswith(f"the newest value of {channel} is 0.45 s old, its period is 0.01 s")
    assert both.late(Recording(seen.channels, values[:0])) == ""
