"""Virtual benches and flights of rigs with blades and motors: speed, current, torque."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from benchtool.core.rig import Rig
from benchtool.core.rig_file import load_rig_by_name
from benchtool.physics.effects.blade_inflow import (
    inflow_at_equal_thrust,
    inflow_response,
    profile_share,
    thrust_at_equal_speed,
    torque_at_equal_speed,
)
from benchtool.physics.model_file import load_model
from benchtool.simulate.flight.cases import FlightCase, Goal
from benchtool.simulate.flight.environment import Block, Environment
from benchtool.simulate.flight.flight import fly
from benchtool.simulate.flight.vehicle import FlightVehicle
from benchtool.simulate.gain_file import load_gains
from benchtool.simulate.imperfections import Imperfections
from benchtool.simulate.plate_bench import PlateBench
from tests.unit.physics.blades import BLADE, MOTOR, bladed
from tests.unit.physics.closed_forms import single_rotor_factor
from tests.unit.simulate.flying import look_below

FAR_M = 1.4


def bench(rig: Rig, truth: str = "single", seed: int = 1) -> PlateBench:
    model = load_model(truth, rig).model
    return PlateBench(rig, model, np.random.default_rng(seed), Imperfections.none())


def settled(plant: PlateBench, z_m: float, pwm_us: float = 1500.0) -> dict[str, float]:
    """Return the last reading of every channel after a long stay."""
    plant.command_plate(z_m)
    while plant.plate_moving:
        plant.advance(200)
    plant.command_pwm(np.full(plant.rig.n_rotors, pwm_us))
    block = plant.advance(round(4.0 * plant.rate_Hz))
    last = [column[~np.isnan(column)][-1] for column in block.T]
    return {channel.name: float(x) for channel, x in zip(plant.channels, last, strict=True)}


@pytest.mark.parametrize("z_over_R", [0.5, 1.0, 2.0])
def test_speed_torque_and_current_are_what_the_motor_and_the_blades_give(z_over_R):
    rig = bladed("pquad_single")
    c = rig.propulsion.drag_coefficient_Nm_s2
    kappa = inflow_at_equal_thrust(single_rotor_factor(1.0, z_over_R))
    m, share = inflow_response(BLADE), profile_share(BLADE)
    t, q = thrust_at_equal_speed(kappa, m), torque_at_equal_speed(kappa, m, share)
    per_volt, ohm = MOTOR.Kv_rpm_V * np.pi / 30.0, MOTOR.resistance_ohm
    free = rig.propulsion.speed_per_us_rad_s * (1500.0 - rig.propulsion.pwm_start_us)

    def current(w: float, factor: float) -> float:
        return MOTOR.no_load_current_A + per_volt * c * factor * w * w

    def volts(w: float, factor: float) -> float:
        return w / per_volt + ohm * current(w, factor)

    near_w = brentq(lambda w: volts(w, q) - volts(free, 1.0), 0.5 * free, 2.0 * free, xtol=1e-12)
    plant = bench(rig)
    far, near = settled(plant, FAR_M), settled(plant, z_over_R * 0.12)
    far_q = torque_at_equal_speed(
        inflow_at_equal_thrust(single_rotor_factor(0.12, FAR_M)), m, share
    )
    assert far["rpm1"] == pytest.approx(free * 30.0 / np.pi, rel=1e-4)
    assert near["rpm1"] * np.pi / 30.0 == pytest.approx(near_w, rel=1e-9)
    k = rig.propulsion.thrust_coefficient_N_s2
    assert near["thrust_N"] == pytest.approx(k * near_w**2 * t, rel=1e-9)
    assert abs(near["torque_Nm"]) == pytest.approx(c * q * near_w**2, rel=1e-9)
    power = volts(near_w, q) * current(near_w, q)
    assert near["current_A"] * near["voltage_V"] == pytest.approx(power, rel=1e-6)
    assert near["current_A"] < far["current_A"]
    assert far_q == pytest.approx(1.0, abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(
    "rig", [load_rig_by_name("pquad"), bladed("pquad")], ids=["printed", "blades"]
)
def test_in_flight_the_torque_turns_the_vehicle_where_blades_answer(rig):
    """Over an edge under the front rotor alone, whose reaction torque is not balanced any more."""
    edge = Environment(blocks=(Block(x_m=(0.1, 3.0), top_m=0.0),))
    vehicle = FlightVehicle.of_rig(rig)
    below = look_below(vehicle, edge, (0.0, 0.0, 0.12))
    m, share = inflow_response(BLADE), profile_share(BLADE)
    law = look_below(FlightVehicle.of_rig(load_rig_by_name("pquad")), edge, (0.0, 0.0, 0.12)).factor
    kappa = inflow_at_equal_thrust(np.array(law))
    expected = torque_at_equal_speed(kappa, m, share) if rig.blade else np.ones(4)
    np.testing.assert_allclose(below.drag, expected, rtol=1e-13)
    case = FlightCase(
        name="edge", vehicle=vehicle, gains=load_gains("s3"), below=edge, start_m=(0.0, 0.0, 0.12),
        goals=(Goal(x_m=0.0, z_m=0.12),), duration_s=0.1, log_Hz=250.0,
    )  # fmt: skip
    turned = np.abs(fly(case)["r_rad_s"]).max()
    assert (turned > 1e-4) == (rig.blade is not None)
