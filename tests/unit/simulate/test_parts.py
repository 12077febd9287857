"""The parts of the virtual bench, each against its closed form and at its neutral value."""

from dataclasses import replace

import numpy as np
import pytest

from benchtool.core.rig_file import load_rig_by_name
from benchtool.core.schedule import due_ticks
from benchtool.simulate.imperfections import Axis, Imperfections
from benchtool.simulate.powertrain import Battery, Powertrain

RIG = load_rig_by_name("pquad")
PULSE = RIG.propulsion


def powertrain(**flaws):
    numbers = {"motor_lag_s": 0.05, "esc_time_s": 40.0, **flaws}
    return Powertrain(replace(RIG, motor=None), replace(Imperfections.none(), **numbers))


def test_speed_follows_the_exact_first_order_response():
    motors = powertrain(motor_lag_s=0.08)
    motors.pwm_us = np.full(4, 1500.0)
    run = motors.advance(400, 0.005)
    target = PULSE.speed_per_us_rad_s * (1500.0 - PULSE.pwm_start_us)
    expected = target * (1.0 - np.exp(-np.arange(1, 401) * 0.005 / 0.08))
    np.testing.assert_allclose(run.speed_rad_s[0], expected, rtol=1e-12)


def test_charge_drawn_is_current_times_time_and_lowers_the_voltage():
    excess_V = 11.1 - PULSE.voltage_nominal_V
    motors = powertrain(battery_excess_V=excess_V, battery_drop_V_per_Ah=2.0)
    motors.pwm_us = np.full(4, 1600.0)
    run = motors.advance(20_000, 0.005)
    drawn_Ah = np.sum(run.current_A[:-10]) * 0.005 / 3600.0
    assert run.voltage_V[-1] == pytest.approx(11.1 - 2.0 * drawn_Ah, abs=1e-9)
    assert run.voltage_V[-1] < run.voltage_V[0]


def test_esc_temperature_rises_to_the_stated_value_at_full_throttle():
    motors = powertrain(esc_heating_K=35.0)
    motors.pwm_us = np.full(4, PULSE.pwm_max_us)
    start = motors.advance(1, 0.005).temperature_degC[0]
    assert start == pytest.approx(22.0, abs=0.01)
    assert motors.advance(200 * 400, 0.005).temperature_degC[-1] == pytest.approx(57.0, abs=0.05)


def test_terminal_voltage_solves_its_own_equation():
    pack = Battery(12.0, resistance_ohm=0.05)
    voltage = pack.loaded_V(0.0, 300.0)
    assert voltage == pytest.approx(12.0 - 0.05 * 300.0 / voltage, rel=1e-14)
    assert pack.loaded_V(0.0, 1e6) == 6.0
    assert Battery(12.0).loaded_V(5000.0, 300.0) == 12.0


@pytest.mark.parametrize(("rate_Hz", "stream_Hz"), [(80.0, 200.0), (80.0, 1000.0), (50.0, 80.0)])
def test_a_slow_sensor_has_its_own_rate_however_ticks_are_split(rate_Hz, stream_Hz):
    seconds = 7
    ticks = int(seconds * stream_Hz)
    whole = due_ticks(1, ticks, rate_Hz, stream_Hz)
    assert whole.sum() == seconds * rate_Hz
    split = np.concatenate(
        [due_ticks(1, 33, rate_Hz, stream_Hz), due_ticks(34, ticks - 33, rate_Hz, stream_Hz)]
    )
    assert np.array_equal(whole, split)


def test_the_plate_moves_at_its_feed_and_stops_on_target():
    axis = Axis(0.1, 1.0)
    axis.target = 0.7
    shown, true = axis.advance(np.arange(1, 701) * 0.005)
    assert shown[99] == pytest.approx(0.95)
    assert shown[-1] == 0.7
    assert not axis.moving
    assert np.array_equal(shown, true)


def test_the_plate_stands_where_it_reads_from_farther_and_by_the_play_nearer_from_nearer():
    axis = Axis(0.1, 1.0, backlash=0.002)
    moves = []
    for target in (0.5, 0.8, 0.5):
        axis.target = target
        shown, true = axis.advance(np.arange(1, 2001) * 0.005)
        moves.append(true[-1] - shown[-1])
    np.testing.assert_allclose(moves, [0.0, -0.002, 0.0], atol=1e-12)
