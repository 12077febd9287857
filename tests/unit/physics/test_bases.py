"""Thrust ratios at equal speed, pulse width and power, against motors solved by bisection."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq

from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.core.rig_file import load_rig_by_name
from benchtool.fit.least_squares import fit_least_squares
from benchtool.fit.model_problem import problem_from_model
from benchtool.fit.recipe import Basis
from benchtool.physics.bases import (
    ground_effect_ratio,
    thrust_per_power_N_W,
    thrust_ratio,
    with_rig_blades,
)
from benchtool.physics.conditions import Conditions
from benchtool.physics.effects.blade_inflow import (
    inflow_at_equal_thrust,
    inflow_response,
    profile_share,
    thrust_at_equal_speed,
    torque_at_equal_speed,
)
from benchtool.physics.model import Model
from tests.unit.physics.blades import BLADE, MOTOR, bladed
from tests.unit.physics.closed_forms import single_rotor_factor

RATIOS: tuple[Basis, ...] = ("equal_rpm2", "equal_pwm", "equal_power")
Z_M = 0.12 * np.array([0.6, 0.8, 1.0, 1.5, 2.0, 3.0])
SPEED_RAD_S = np.array([400.0, 480.0, 560.0, 600.0, 500.0, 450.0])
PER_VOLT = MOTOR.Kv_rpm_V * np.pi / 30.0


def voltage(w: float, torque_Nm: float) -> float:
    """Return the voltage of a motor for a torque at a speed: V."""
    assert MOTOR.resistance_ohm is not None
    current = MOTOR.no_load_current_A + PER_VOLT * torque_Nm
    return w / PER_VOLT + MOTOR.resistance_ohm * current


def reference_speed(basis: Basis, w: float, c: float, near: float, far: float) -> float:
    """Return the speed at the reference with the voltage or power of the point, by bisection."""

    def input_level(speed: float, factor: float) -> float:
        torque = c * factor * speed * speed
        volts = voltage(speed, torque)
        if basis == "equal_pwm":
            return volts
        return volts * (MOTOR.no_load_current_A + PER_VOLT * torque)

    target = input_level(w, near)
    return float(brentq(lambda v: input_level(v, far) - target, 0.5 * w, 2.0 * w, xtol=1e-11))


def response(radius_m: float, z_m: float) -> tuple[float, float]:
    """Return thrust and torque ratio at equal speed of eq. (2)."""
    kappa = inflow_at_equal_thrust(single_rotor_factor(radius_m, z_m))
    m = inflow_response(BLADE)
    return (thrust_at_equal_speed(kappa, m), torque_at_equal_speed(kappa, m, profile_share(BLADE)))


def measured(basis: Basis, radius_m: float, parked_m: float, rig: Rig) -> NDArray[np.float64]:
    """Return T_IGE/T_OGE of a bench according to eq. (2), with that park distance as reference."""
    c, ratios = rig.propulsion.drag_coefficient_Nm_s2, []
    far_t, far_q = response(radius_m, parked_m)
    for z, w in zip(Z_M, SPEED_RAD_S, strict=True):
        t, q = response(radius_m, z)
        v = w if basis == "equal_rpm2" else reference_speed(basis, w, c, q, far_q)
        ratios.append(t * w * w / (far_t * v * v))
    return np.array(ratios)


def sweep(rig: Rig, z_m: Any, **options: Any) -> Conditions:
    return Conditions.build(
        rig, speed_rad_s=SPEED_RAD_S[None, :], plate_z_m=np.broadcast_to(z_m, (6,)), **options
    )


@pytest.mark.parametrize("basis", RATIOS)
def test_a_ratio_at_any_basis_gives_the_same_radius(basis):
    rig, true_m, parked_m = bladed("pquad_single"), 0.128, 1.0
    model = with_rig_blades(Model.single(rig)).with_free("R_m")
    observed = measured(basis, true_m, parked_m, rig)
    near, reference, u = sweep(rig, Z_M), sweep(rig, parked_m), np.full(6, 1e-4)
    problem = problem_from_model(model, near, observed, u, basis=basis, reference=reference)
    assert fit_least_squares(problem)["R_m"].value == pytest.approx(true_m, rel=1e-9)
    model = Model.single(rig).with_free("R_m")
    printed = problem_from_model(model, near, observed, u, basis=basis, reference=reference)
    assert fit_least_squares(printed)["R_m"].value < 0.99 * true_m


def test_speeds_from_pulses_are_those_near_the_plate():
    """Same points with measured speeds or speeds from pulse widths: equal ratios at equal pulse."""
    rig = bladed("pquad")
    model = with_rig_blades(Model.single(rig).with_effect("neighbour_images"))
    values = model.parameters.values_array()
    pulses = sweep(rig, Z_M, speed_measured=False, plate_x_m=0.6)
    far = pulses.out_of_ground_effect()
    near_flow, far_flow = model.flow(pulses, values), model.flow(far, values)
    expected = model.squared_speed(near_flow, values) / model.squared_speed(far_flow, values)
    read = sweep(rig, Z_M, plate_x_m=0.6)
    read.speed_rad_s[:] = np.array(near_flow.speed_rad_s)
    far = read.out_of_ground_effect()
    flows = model.flow(read, values), model.flow(far, values)
    ratio = thrust_ratio(model, "equal_pwm", *flows, values)
    np.testing.assert_allclose(ratio, expected, rtol=1e-13)
    assert np.all(np.array(near_flow.speed_rad_s[0]) > SPEED_RAD_S)
    np.testing.assert_allclose(near_flow.speed_rad_s[2], SPEED_RAD_S, rtol=1e-13)


def test_without_blades_every_basis_is_the_papers():
    rig = load_rig_by_name("pquad_single")
    assert with_rig_blades(Model.single(rig)).effects == Model.single(rig).effects
    model = Model.single(bladed("pquad_single"))
    values = model.parameters.values_array()
    near, far = sweep(rig, Z_M), sweep(rig, 1e6)
    flows = model.flow(near, values), model.flow(far, values)
    law = single_rotor_factor(0.12, Z_M)
    for basis in RATIOS:
        np.testing.assert_allclose(thrust_ratio(model, basis, *flows, values), law, rtol=1e-9)


def test_equal_pulse_width_without_a_motor_is_rejected():
    rig = bladed("pquad_single", None)
    model = with_rig_blades(Model.single(rig)).with_free("R_m")
    with pytest.raises(InputError, match=r"no \[motor\] table, .*governed = true"):
        problem_from_model(model, sweep(rig, Z_M), np.ones(6), basis="equal_pwm")
    power = problem_from_model(model, sweep(rig, Z_M), np.ones(6), basis="equal_power")
    assert power.facts["power"] == "of the shafts: the rig describes no motor"


def test_thrust_per_power_follows_from_thrust_and_torque():
    """Blades reduce the torque near the plate, so the ratio increases by more than thrust."""
    for motor in (MOTOR, None):
        rig = bladed("pquad_single", motor)
        k, c = rig.propulsion.thrust_coefficient_N_s2, rig.propulsion.drag_coefficient_Nm_s2
        model = with_rig_blades(Model.single(rig))
        expected = []
        for z, w in zip(Z_M, SPEED_RAD_S, strict=True):
            t, q = response(0.12, z)
            torque = c * q * w * w
            power = w * torque / rig.propulsion.efficiency
            if motor is not None:
                power = voltage(w, torque) * (MOTOR.no_load_current_A + PER_VOLT * torque)
            expected.append(k * t * w * w / power)
        near = thrust_per_power_N_W(model, sweep(rig, Z_M))
        np.testing.assert_allclose(near, expected, rtol=1e-12)
        far = thrust_per_power_N_W(model, sweep(rig, Z_M).out_of_ground_effect())
        assert np.all(near / far > ground_effect_ratio(model, "equal_rpm2", sweep(rig, Z_M)))
