"""The virtual bench as a whole: perfect it is the model, imperfect it is off by what is stated."""

from dataclasses import fields, replace

import numpy as np
import pytest

from benchtool.core.rig_file import load_rig_by_name
from benchtool.physics.conditions import Conditions
from benchtool.physics.model_file import load_model
from benchtool.simulate.imperfections import Imperfections
from benchtool.simulate.plate_bench import PlateBench

RIG = load_rig_by_name("pquad")
TRUTH = load_model("quad_body_lift", RIG).model
NONE = Imperfections.none()


def bench(imperfections=None, truth=TRUTH, seed=1, rate_Hz=200.0):
    return PlateBench(RIG, truth, np.random.default_rng(seed), imperfections, rate_Hz)


def column(plant, block, name):
    return block[:, [channel.name for channel in plant.channels].index(name)]


def settled(plant, pwm_us=1500.0, z_m=0.2, duration_s=30.0):
    plant.command_plate(z_m)
    while plant.plate_moving:
        plant.advance(200)
    plant.command_pwm(np.full(RIG.n_rotors, pwm_us))
    plant.advance(round(2.0 * plant.rate_Hz))
    return plant.advance(round(duration_s * plant.rate_Hz))


def model_N(truth, speed_rad_s, z_m, **conditions):
    at = Conditions.build(
        RIG, speed_rad_s=np.full((4, 1), speed_rad_s), plate_z_m=np.array([z_m]), **conditions
    )
    return truth.thrust_N(at)[0]


def test_a_perfect_bench_is_the_model_exactly():
    plant = bench(NONE)
    block = settled(plant, duration_s=1.0)
    speed = RIG.propulsion.speed_per_us_rad_s * (1500.0 - RIG.propulsion.pwm_start_us)
    expected = model_N(TRUTH, speed, 0.2)
    np.testing.assert_allclose(column(plant, block, "thrust_N"), expected, rtol=1e-12)
    np.testing.assert_allclose(column(plant, block, "rpm2"), speed * 30.0 / np.pi, rtol=1e-12)
    assert np.all(column(plant, block, "plate_z_m") == 0.2)
    voltage = column(plant, block, "voltage_V")
    assert np.all(voltage[~np.isnan(voltage)] == RIG.propulsion.voltage_nominal_V)
    assert not np.isnan(column(plant, block, "thrust_N")).any()


@pytest.mark.parametrize("name", [item.name for item in fields(Imperfections)])
def test_every_imperfection_is_neutral_at_zero_and_shows_elsewhere(name):
    size = {"thrust_rate_Hz": 80.0, "motor_lag_s": 0.5, "battery_drop_V_per_Ah": 50.0}
    size |= {"battery_excess_V": 1.0, "thrust_quantum_N": 0.5, "esc_time_s": 40.0}
    size |= {"esc_heating_K": 30.0, "plate_quantum_m": 0.03}
    flawed = replace(NONE, **{name: size.get(name, 0.05)})
    perfect = NONE
    if name == "esc_time_s":
        flawed, perfect = replace(flawed, esc_heating_K=35.0), replace(perfect, esc_heating_K=35.0)
    true, shown = [
        np.concatenate([settled(plant, duration_s=1.0), settled(plant, 1300.0, 0.4, 1.0)])
        for plant in (bench(perfect), bench(flawed))
    ]
    assert not np.array_equal(true, shown, equal_nan=True)
    again = bench(replace(flawed, **{name: 0.0}))
    back = np.concatenate([settled(again, duration_s=1.0), settled(again, 1300.0, 0.4, 1.0)])
    assert np.array_equal(true, back, equal_nan=True)


def test_the_same_seed_gives_the_same_readings_however_the_span_is_split():
    whole, split = bench(), bench()
    for plant in (whole, split):
        plant.command_pwm(np.full(4, 1500.0))
        plant.command_plate(1.2)
    at_once = whole.advance(1000)
    parts = np.concatenate([split.advance(n) for n in (1, 2, 97, 400, 500)])
    np.testing.assert_allclose(parts, at_once, rtol=1e-9, atol=1e-9)
    assert not np.array_equal(bench(seed=2).advance(1000), at_once, equal_nan=True)


def test_a_tare_takes_offset_and_creep_away_and_leaves_the_counts():
    plant = bench(replace(NONE, start_offset_N=0.7, drift_N_per_s=0.01))
    before = plant.advance(2000)
    assert column(plant, before, "thrust_N")[-1] == pytest.approx(0.8, abs=1e-9)
    plant.tare()
    after = plant.advance(200)
    thrust = column(plant, after, "thrust_N")
    assert thrust[0] == pytest.approx(0.0, abs=2e-3)
    assert thrust[-1] - thrust[0] == pytest.approx(0.01 * 199 / 200, rel=1e-6)
    raw = np.concatenate([column(plant, block, "thrust_raw") for block in (before, after)])
    assert np.max(np.abs(np.diff(raw))) < 20.0


def test_drift_and_offset_of_the_model_count_from_the_tare():
    truth = TRUTH.with_effect("load_cell_drift", rate_N_per_s=0.02)
    truth = truth.with_effect("tare_offset", thrust_N=0.3)
    plant = bench(NONE, truth)
    plant.advance(2000)
    plant.tare()
    thrust = column(plant, plant.advance(400), "thrust_N")
    assert thrust[-1] == pytest.approx(0.3 + 0.02 * 2.0, abs=2e-3)
    raw = column(plant, plant.advance(2), "thrust_raw")
    assert abs(raw[0] * plant.count_N - (0.3 + 0.02 * 12.0)) < 2e-3


def test_the_plate_offset_of_the_truth_moves_the_curve():
    truth = TRUTH.with_effect("plate_offset", dz_m=-0.02)
    plant = bench(NONE, truth)
    block = settled(plant, z_m=0.2, duration_s=0.5)
    speed = RIG.propulsion.speed_per_us_rad_s * (1500.0 - RIG.propulsion.pwm_start_us)
    expected = model_N(TRUTH, speed, 0.18)
    assert column(plant, block, "thrust_N")[-1] == pytest.approx(expected, rel=1e-12)
    assert column(plant, block, "plate_z_m")[-1] == 0.2


def test_battery_sag_of_the_truth_slows_the_rotors_and_shows_in_the_voltage():
    truth = TRUTH.with_effect("battery_sag", rate_per_s=0.001)
    plant = bench(NONE, truth)
    plant.command_pwm(np.full(4, 1500.0))
    block = plant.advance(20_000)
    for name in ("rpm1", "voltage_V"):
        read = column(plant, block, name)
        read = read[np.isfinite(read)]
        assert read[-1] / read[0] == pytest.approx(1.0 - 0.001 * 100.0, abs=1e-3)
