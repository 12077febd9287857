from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchtool.bench.clocks import DeviceClock
from benchtool.bench.mavlink.auxiliary_load_cell import (
    AuxiliaryLoadCell,
    LoadCellDecoder,
    merge_in_order,
)
from benchtool.bench.mavlink.frames import ESC_STATUS, dialect
from benchtool.bench.mavlink.motor_test import OutputMonitor
from benchtool.bench.mavlink.rows import MavlinkRows, SpeedSources
from benchtool.bench.mavlink.settings import MavlinkSettings, MotorMap, ThrustSource, build_channels
from tests.doubles.scripted_link import Talker

W = dialect()
TWO = MotorMap(rig="", autopilot="", motors=(1, 2), outputs=(3, 1), escs=(3, 1))
NAMES = [channel.name for channel in build_channels(2)]


def servo(time_us: int, *pulses: int) -> object:
    return W.MAVLink_servo_output_raw_message(time_us, 0, *pulses, *[0] * (8 - len(pulses)))


def rows_of(*messages: object, **given: Any) -> dict[str, list[float]]:
    """Give what each channel got from messages, in order."""
    rows = MavlinkRows(TWO, MavlinkSettings(**given), idle_us=1100.0)
    for message in (*messages, servo(99_000_000, 1000, 1000, 1000)):
        rows.update(message)
    _, values = rows.take_rows()
    told = {name: values[:, index] for index, name in enumerate(NAMES)}
    return {name: column[np.isfinite(column)].tolist() for name, column in told.items()}


@pytest.mark.parametrize("unknown", [np.nan, np.inf])
def test_an_output_that_shows_no_number_shows_no_stop(unknown):
    rows, watch = MavlinkRows(TWO, MavlinkSettings(), idle_us=1100.0), OutputMonitor("mav", 1000.0)
    watch.command({1: (3, 1000.0), 2: (1, 1000.0)}, 0.0)
    for step, shown in enumerate([1000.0, 1200.0, *[unknown] * 20]):
        pulses = [0.0, 0.0, shown, *[0.0] * 29]
        rows.update(W.MAVLink_actuator_output_status_message(100_000 * step, 4, pulses))
        watch.update_outputs(rows.outputs_us, 0.1 * step)
        assert watch.outputs_match == (step == 0)
    fault = watch.fault(rows.outputs_us, 2.2)
    assert fault is not None
    assert (
        f"rotor 1 was commanded 1000 us and mav acknowledged it, but output 3 shows {unknown} us"
        in fault
    )
    _, values = rows.take_rows()
    np.testing.assert_array_equal(values[:3, NAMES.index("pwm1_us")], [1000.0, 1200.0, unknown])
    assert set(values[:, NAMES.index("pwm2_us")]) == {0.0}


def test_messages_of_one_millisecond_are_one_row():
    rows = MavlinkRows(TWO, MavlinkSettings(), idle_us=1100.0)
    for step in range(3):
        rows.update(servo(20_000 * step + 7, 1000, 1000, 1000))
        rows.update(W.MAVLink_named_value_float_message(20 * step, b"thrust", 1.5))
    rows.update(servo(60_000, 1000, 1000, 1000))
    times_us, values = rows.take_rows()
    assert times_us.tolist() == [7, 20_007, 40_007]
    assert np.isfinite(values[:, NAMES.index("thrust_N")]).all()
    assert np.isfinite(values[:, NAMES.index("pwm1_us")]).all()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("cell", W.MAVLink_named_value_float_message(5, b"cell", 2.5)),
        ("cell.y", W.MAVLink_debug_vect_message(b"cell", 5000, 1.0, 2.5, 3.0)),
        (
            "cell[2]",
            W.MAVLink_debug_float_array_message(5000, b"cell", 1, [0.0, 1.0, 2.5] * 19 + [0]),
        ),
    ],
)
def test_thrust_comes_by_name_in_three_messages(text, message):
    other = W.MAVLink_named_value_float_message(5, b"other", 9.0)
    told = rows_of(message, other, thrust=ThrustSource.parse(text), thrust_scale_N=2.0)
    assert told["thrust_raw"] == [2.5]
    assert told["thrust_N"] == [5.0]


def telemetry(rpm: list[int], count: int) -> object:
    return W.MAVLink_esc_telemetry_1_to_4_message(
        [30] * 4, [1200] * 4, [0] * 4, [0] * 4, rpm, [count] * 4
    )


def test_speeds_of_every_message():
    told = rows_of(telemetry([0, 0, 0, 0], 6), telemetry([3000, 0, 4000, 0], 7))
    assert told["rpm1"] == [4000.0]
    assert told["temperature_degC"] == [30.0]
    esc = W.mavlink_map[ESC_STATUS](0, 5000, [-3000, 0, 4000, 0], [12.0] * 4, [1.0] * 4)
    assert rows_of(esc)["rpm2"] == [3000.0]
    assert rows_of(W.MAVLink_raw_rpm_message(2, 4100.0))["rpm1"] == [4100.0]
    told = rows_of(W.MAVLink_rpm_message(-1.0, -1.0), W.MAVLink_rpm_message(3100.0, -1.0))
    assert told["rpm2"] == [3100.0]
    assert told["rpm1"] == []


def test_an_esc_that_has_said_nothing_new_is_not_repeated():
    told = rows_of(*[telemetry([3000, 0, 4000, 0], count) for count in (7, 7, 8, 8)])
    assert told["rpm1"] == [4000.0]


def test_battery_attitude_and_distance():
    told = rows_of(
        W.MAVLink_battery_status_message(
            0, 0, 0, 32767, [4100, 4000, 3900] + [65535] * 7, 250, -1, -1, -1
        ),
        W.MAVLink_attitude_message(1, 0.0, 0.2, 0.0, 0.0, 0.5, 0.0),
        W.MAVLink_attitude_target_message(1, 0, [np.cos(0.05), 0.0, np.sin(0.05), 0.0], 0, 0, 0, 0),
        W.MAVLink_distance_sensor_message(2, 5, 400, 34, 0, 0, 25, 0),
        W.MAVLink_distance_sensor_message(3, 5, 400, 99, 0, 1, 0, 0),
        orientation=25,
    )
    assert told["voltage_V"] == [pytest.approx(12.0)]
    assert told["current_A"] == [2.5]
    # MAVLink's pitch is positive nose up, ours nose down.
    assert told["theta_rad"] == [pytest.approx(-0.2)]
    assert told["gyro_rad_s"] == [pytest.approx(-0.5)]
    assert told["theta_ref_rad"] == [pytest.approx(-0.1)]
    assert told["plate_z_m"] == [pytest.approx(0.34)]


def test_a_rotor_changes_places_when_its_output_is_found():
    rows = MavlinkRows(replace(TWO, outputs=(0, 0), escs=(1, 2)), MavlinkSettings(), idle_us=1100.0)
    rows.assign_output(1, 2)
    for message in (
        telemetry([0, 0, 0, 0], 2), servo(1000, 1000, 1500), telemetry([0, 4000, 0, 0], 3),
        servo(20_000, 9),
    ):  # fmt: skip
        rows.update(message)
    _, values = rows.take_rows()
    assert values[0, :4].tolist() == [1500.0, 1000.0, 4000.0, 0.0]


STEP_US = 50_000


def run(sources: SpeedSources, source: str, rpm: float, begin: int, driven: bool = True) -> list:
    """Tell 40 readings, two seconds long; return which were taken."""
    return [sources.take(source, 0, rpm, driven, begin + STEP_US * step) for step in range(40)]


def test_a_speed_that_changes_is_taken():
    sources = SpeedSources(1)
    assert all(run(sources, "ESC_TELEMETRY", 0.0, 0, driven=False))
    assert all(run(sources, "ESC_TELEMETRY", 3000.0, 2_000_000))
    assert sources.take_messages() == []


def test_a_constant_zero_while_driven_is_a_dead_channel():
    sources = SpeedSources(1)
    taken = run(sources, "ESC_TELEMETRY", 0.0, 0)
    assert taken == [True] * 20 + [False] * 20
    (told,) = sources.take_messages()
    assert told.startswith(
        "rpm1 of ESC_TELEMETRY reads 0 while its motor is driven: a dead channel"
    )


def test_hx711_examples_are_read_in_pieces():
    lines = LoadCellDecoder()
    text = b"ading: 1\r\nHX711 reading: 124006\r\none reading:\t16.1\t| average:\t4.2\r\n"
    text += b"ready\r\n-3.5\n"
    readings = [value for at in range(0, len(text), 5) for value in lines.feed(text[at : at + 5])]
    assert readings == [124006.0, 16.1, -3.5]


def test_readings_stand_on_the_autopilots_clock():
    link = Talker(b"HX711 reading: 5\n")
    cell = AuxiliaryLoadCell(link, "/dev/cell", link.clock)
    cell.open()
    clock = DeviceClock()
    # At 100 s of ours the autopilot had been up for 7 s.
    clock.update(7_000_000, 100.0)
    times_us, values = cell.rows(lambda wall_s: wall_s, clock, 3, [0, 1])
    assert times_us[-1] == round(7e6 + 1e6 * (link.now_s - 100.0))
    np.testing.assert_array_equal(values[-1], [5.0, 5.0, np.nan])
    assert len(cell.rows(lambda wall_s: wall_s, clock, 3, [0, 1])[0]) == 0


def test_rows_of_two_sources_come_in_order_and_never_twice_at_one_time():
    first = np.array([10, 20, 30]), np.full((3, 2), 1.0)
    second = np.array([5, 20, 31]), np.full((3, 2), 2.0)
    times_us, values = merge_in_order(first, second, after_us=7)
    assert times_us.tolist() == [8, 10, 20, 21, 30, 31]
    assert values[:, 0].tolist() == [2.0, 1.0, 1.0, 2.0, 1.0, 2.0]
