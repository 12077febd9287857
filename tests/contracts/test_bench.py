"""One contract for every bench: simulated, over a loop-back wire, TCP, a pseudo-terminal, behind an
autopilot, guarded; what of it a pitch bench keeps, whose loop commands the motors; and what a
replay, which only listens, has in common with them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from benchtool.bench.bench import Bench
from benchtool.bench.drivers import open_bench
from benchtool.core.errors import BenchError, BenchtoolError, InputError, LinkLost, StageError
from benchtool.core.units import find_unit
from benchtool.simulate.imperfections import Imperfections
from benchtool.virtual.links import PtyLink, TcpLink
from tests.contracts.benches import MAKERS, PITCH_MAKERS, STOP_US, served, simulated


@pytest.fixture(params=[*MAKERS, "tcp", "pty"])
def bench(request):
    with made(request.param) as bench:
        yield bench


@pytest.fixture(params=[*MAKERS, *PITCH_MAKERS, "tcp", "pty"])
def any_bench(request):
    """Give a bench of either kind: with a load cell, or with a hinge."""
    with made(request.param) as bench:
        yield bench


@contextmanager
def made(name: str) -> Iterator[Bench]:
    """Give a bench by its name; skip one that this system cannot serve."""
    if name in MAKERS or name in PITCH_MAKERS:
        yield {**MAKERS, **PITCH_MAKERS}[name]()
    elif name == "tcp":
        with served(TcpLink("127.0.0.1", 0)) as bench:
            yield bench
    elif os.name != "posix":
        pytest.skip("this system has no pseudo-terminals")
    else:
        with served(PtyLink()) as bench:
            yield bench


def spin(bench: Bench, pulse_us: float) -> None:
    bench.set_pwm(np.full(bench.identity.n_rotors, pulse_us))


def gather(bench: Bench, duration_s: float) -> np.ndarray:
    """Read for so long on the bench's clock; return (n, 1 + c): time_s and values."""
    until_s = bench.now_s() + duration_s
    parts = []
    while (left_s := until_s - bench.now_s()) > 1e-6:
        readings = bench.read(min(left_s, 0.2))
        assert readings.values.shape == (len(readings), len(bench.identity.channels))
        assert len(readings.device_time_us) == len(readings)
        parts.append(np.column_stack([readings.time_s, readings.values]))
    return np.concatenate(parts)


def column(bench: Bench, rows: np.ndarray, name: str) -> np.ndarray:
    names = [channel.name for channel in bench.identity.channels]
    shown = rows[:, 1 + names.index(name)]
    return shown[~np.isnan(shown)]


def test_it_is_a_bench(any_bench):
    bench = any_bench
    with bench:
        assert isinstance(bench, Bench)


def test_the_identity_is_complete(bench):
    with bench:
        identity = bench.identity
    assert identity.device_id
    assert identity.firmware
    assert identity.protocol
    assert identity.rate_Hz > 0.0
    assert identity.n_rotors == 1
    assert identity.simulated
    assert identity.watchdog_s == 0.25
    names = [channel.name for channel in identity.channels]
    assert len(set(names)) == len(names)
    assert {"pwm1_us", "rpm1", "thrust_N", "plate_z_m", "voltage_V"} <= set(names)
    for channel in identity.channels:
        find_unit(channel.unit)
    # An autopilot knows its pulses, but nothing of load cells.
    own = set() if identity.protocol.startswith("MAVLink") else {"thrust_N", "rpm"}
    assert {"pwm_us", *own} <= set(identity.limits)


def test_time_goes_on_and_samples_come_in_order(any_bench):
    bench = any_bench
    with bench:
        before_s = bench.now_s()
        rows = gather(bench, 2.0)
        assert bench.now_s() >= before_s + 2.0 - 1e-6
    assert len(rows) > 50
    assert np.all(np.diff(rows[:, 0]) > 0.0)


def test_a_pulse_is_acknowledged_and_shows_in_the_stream(bench):
    with bench:
        bench.set_pwm(np.array([1400.0]))
        rows = gather(bench, 3.0)
        assert column(bench, rows, "pwm1_us")[-1] == 1400.0
        assert column(bench, rows, "rpm1")[-1] > 1000.0


def test_stop_zeroes_and_may_be_called_twice(any_bench):
    bench = any_bench
    with bench:
        spin(bench, 1400.0)
        gather(bench, 2.0)
        bench.stop()
        bench.stop()
        rows = gather(bench, 4.0)
        assert column(bench, rows, "pwm1_us")[-1] == STOP_US
        assert column(bench, rows, "rpm1")[-1] == 0.0


def test_a_tare_brings_thrust_to_zero(bench):
    with bench:
        before = np.mean(column(bench, gather(bench, 2.0), "thrust_N"))
        bench.tare()
        gather(bench, 0.5)
        after = np.mean(column(bench, gather(bench, 2.0), "thrust_N"))
    assert before == pytest.approx(Imperfections().start_offset_N, abs=0.02)
    assert after == pytest.approx(0.0, abs=0.02)


def test_the_plate_goes_where_it_is_sent(any_bench):
    bench = any_bench
    with bench:
        bench.move_plate(1.2)
        rows = gather(bench, 1.0)
        assert column(bench, rows, "plate_z_m")[-1] == pytest.approx(1.2, abs=1e-3)


def test_the_plate_is_refused_under_throttle_and_outside_of_its_travel(any_bench):
    bench = any_bench
    with bench:
        with pytest.raises(StageError, match=r"0\.05"):
            bench.move_plate(0.001)
        spin(bench, 1400.0)
        with pytest.raises(StageError, match="idle"):
            bench.move_plate(1.0)


def test_a_pulse_that_is_too_long_is_refused_with_the_limit(any_bench):
    bench = any_bench
    with bench:
        with pytest.raises(BenchtoolError, match="1950"):
            spin(bench, 2500.0)
        with pytest.raises(InputError):
            spin(bench, np.nan)
        rows = gather(bench, 1.0)
        assert column(bench, rows, "pwm1_us")[-1] == STOP_US


def test_another_rate_is_told_and_comes(any_bench):
    bench = any_bench
    with bench:
        bench.set_rate(50.0)
        assert bench.identity.rate_Hz == 50.0
        gather(bench, 1.0)
        rows = gather(bench, 4.0)
        names = [channel.name for channel in bench.identity.channels]
        # An autopilot sends each message in its own time, its outputs at the rate.
        told = np.isfinite(rows[:, 1 + names.index("pwm1_us")])
        step_s = np.median(np.diff(rows[told, 0]))
    assert step_s == pytest.approx(0.02, rel=0.05)


def test_leaving_it_stops_the_motors_and_closing_twice_is_safe(any_bench):
    bench = any_bench
    with bench:
        spin(bench, 1400.0)
        gather(bench, 1.0)
    bench.close()
    bench.close()
    with bench:
        rows = gather(bench, 3.0)
        assert column(bench, rows, "pwm1_us")[0] == STOP_US
        assert column(bench, rows, "rpm1")[-1] == 0.0


def test_an_error_in_the_body_is_not_hidden_by_leaving(any_bench):
    bench = any_bench
    with pytest.raises(ZeroDivisionError), bench:
        _ = 1 / 0


def test_reading_a_bench_that_is_not_open_says_so(any_bench):
    bench = any_bench
    with pytest.raises(LinkLost, match=r"open it first|call open"):
        bench.read(0.1)


def test_a_replay_keeps_what_applies_to_it(tmp_path):
    with simulated() as source:
        names = [channel.name for channel in source.identity.channels]
        readings = source.read(2.0)
    header = ",".join(["time_s", "device_time_us", "point", "phase", *names])
    lines = [
        ",".join(
            [f"{time_s:.6f}", f"{us:.0f}", "0", "tare", *("" if v != v else repr(v) for v in row)]
        )
        for time_s, us, row in zip(
            readings.time_s.tolist(),
            readings.device_time_us.tolist(),
            readings.values.tolist(),
            strict=True,
        )
    ]
    (tmp_path / "samples.csv").write_text("\n".join([header, *lines]) + "\n", encoding="utf-8")
    with open_bench(f"replay:{tmp_path}") as bench:
        assert isinstance(bench, Bench)
        assert [channel.name for channel in bench.identity.channels] == names
        rows = gather(bench, 1.5)
        with pytest.raises(BenchError, match="accepts no commands"):
            bench.set_pwm(np.array([1400.0]))
        bench.stop()
    bench.close()
    assert np.array_equal(rows[:, 1:], readings.values[: len(rows)], equal_nan=True)
    assert np.all(np.diff(rows[:, 0]) > 0.0)
