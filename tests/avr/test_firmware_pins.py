"""The firmware's pins, seen by what is wired to them, while a host drives it."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Callable

import numpy as np
import pytest

from benchtool.bench.serial.bench import SerialBench
from benchtool.core.errors import DeviceStopped
from tests.avr.avr_bench import AvrBench

FLASH_BYTES, RAM_BYTES, BOOTLOADER_BYTES = 32_768, 2_048, 512  # ATmega328P, and optiboot on it
STACK_BYTES = 512  # memory that must never have been touched, by variables or stack; assumed


def host(bench: AvrBench) -> SerialBench:
    return SerialBench(bench, bench.address, bench.clock)


def read_for(driver: SerialBench, seconds: float) -> np.ndarray:
    """Return the rows of a span; not one may be lost."""
    rows = []
    end_s = driver.now_s() + seconds
    while driver.now_s() < end_s:
        got = driver.read(0.1)
        assert (got.lost, got.corrupt) == (0, 0)
        rows.append(got.values)
    return np.concatenate(rows)


def stopped_by(driver: SerialBench, act: Callable[[], object]) -> str:
    """Do something that must end in a stop; return the device's reason."""
    act()
    with pytest.raises(DeviceStopped) as caught:
        read_for(driver, 3.0)
    return str(caught.value)


def spin(driver: SerialBench, pulse_us: float) -> None:
    driver.set_pwm(np.full(driver.identity.n_rotors, pulse_us))


def test_flash_and_memory_suffice(firmware, pair_firmware):
    for program in (firmware, pair_firmware):
        told = subprocess.run(["avr-size", program], capture_output=True, text=True, check=True)
        code, data, bss = map(int, told.stdout.splitlines()[1].split()[:3])
        print(f"{program.parent.parent.name}: flash {code + data}, variables {data + bss} bytes")
        assert code + data <= FLASH_BYTES - BOOTLOADER_BYTES
        assert data + bss <= RAM_BYTES - STACK_BYTES


def test_pulses_are_what_was_asked_for(pair):
    with host(pair) as driver:
        for pulses_us in ((1200.0, 1000.0), (1000.0, 1899.5), (1512.5, 1333.3), (1000.0, 1000.0)):
            driver.set_pwm(np.array(pulses_us))
            seen = read_for(driver, 0.1)[-1]
            assert pair.state.pulses_us == pytest.approx(pulses_us, abs=0.5)
            assert seen[:2] == pytest.approx(pulses_us, abs=0.25)


def test_sensors_are_read_truly(bench):
    with host(bench) as driver:
        driver.tare()
        spin(driver, 1500.0)
        read_for(driver, 1.0)
        rows = read_for(driver, 2.0)
    pwm, rpm, thrust_N, counts, voltage_V = rows.T
    assert np.all(pwm == 1500.0)
    fresh = ~np.isnan(thrust_N)
    assert np.array_equal(fresh, ~np.isnan(counts))
    assert fresh.mean() == pytest.approx(0.8, abs=0.02)
    tared_N = counts[fresh] * bench.plant.count_N
    assert thrust_N[fresh] - tared_N == pytest.approx((thrust_N[fresh] - tared_N)[0], abs=2e-4)
    expected_rpm = 1.05 * (1500.0 - 1050.0) * 30.0 / np.pi
    assert np.nanmedian(rpm) == pytest.approx(expected_rpm, rel=0.1)
    assert np.nanmedian(thrust_N) == pytest.approx(
        1.035e-5 * (np.nanmedian(rpm) * np.pi / 30.0) ** 2, rel=0.1
    )
    assert np.nanmedian(voltage_V) == pytest.approx(12.0, abs=1.2)
    assert bench.state.faults == 0


def test_the_fastest_stream_loses_nothing(pair):
    with host(pair) as driver:
        driver.set_rate(200.0)
        driver.set_pwm(np.array([1450.0, 1550.0]))
        begin_us = pair.state.time_us
        rows = read_for(driver, 2.0)
        simulated_s = 1e-6 * (pair.state.time_us - begin_us)
        assert len(rows) == pytest.approx(200.0 * simulated_s, rel=0.1)
    state = pair.state
    assert state.faults == 0
    assert state.untouched >= STACK_BYTES


@pytest.mark.parametrize(
    ("name", "limit", "reading"), [("thrust_N", 1.0, "thrust_N"), ("rpm", 1500.0, "rpm1")]
)
def test_a_limit_stops_the_motors(bench, name, limit, reading):
    with host(bench) as driver:
        driver.set_limit(name, limit)
        driver.tare()
        reason = stopped_by(driver, lambda: spin(driver, 1600.0))
    (told,) = re.findall(rf"limit: {reading} ([\d.]+) against limit {limit:g};", reason)
    assert limit < float(told) < 2.0 * limit
    bench.wait(lambda state: state.pulses_us[0] == pytest.approx(1000.0, abs=0.5))


def test_a_battery_that_is_gone_stops_the_motors(bench):
    def pull_the_battery() -> None:
        bench.battery = False

    with host(bench) as driver:
        spin(driver, 1200.0)
        read_for(driver, 0.3)
        reason = stopped_by(driver, pull_the_battery)
    assert re.search(r"limit: voltage_V 0 against limit 9\.6; motors stopped", reason)


def test_a_load_cell_that_falls_silent_stops_the_motors(bench):
    with host(bench) as driver:
        spin(driver, 1300.0)
        read_for(driver, 0.3)
        reason = stopped_by(driver, bench.unplug_cell)
    assert re.search(r"limit: silence of thrust_N in s 0\.3\d* against limit 0\.3", reason)
    bench.wait(lambda state: state.pulses_us[0] == pytest.approx(1000.0, abs=0.5))


def test_a_program_that_hangs_is_reset_within_300_ms(bench):
    with host(bench) as driver:
        spin(driver, 1300.0)
        read_for(driver, 0.2)
        hung_us = bench.state.time_us
        bench.hang()
        reason = stopped_by(driver, lambda: None)
        assert "boot: the program hung and was reset" in reason
    state = bench.wait(lambda state: state.time_us > hung_us + 0.6e6)
    print(f"last pulse above stop {1e-3 * (state.drive_us - hung_us):.0f} ms after the hang")
    assert state.drive_us - hung_us < 300e3
    # It has come back, at the stop pulse.
    assert state.pulses_us[0] == pytest.approx(1000.0, abs=0.5)


def test_a_host_that_falls_silent_leaves_motors_at_zero_within_300_ms(bench):
    with host(bench) as driver:
        spin(driver, 1500.0)
        read_for(driver, 1.0)
        assert bench.state.pulses_us[0] == pytest.approx(1500.0, abs=0.5)
        silent_us = bench.state.time_us
        state = bench.wait(lambda state: state.time_us > silent_us + 1e6)
    assert 200e3 < state.drive_us - state.heard_us < 300e3
    assert state.drive_us - silent_us < 300e3
    assert state.pulses_us[0] == pytest.approx(1000.0, abs=0.5)
