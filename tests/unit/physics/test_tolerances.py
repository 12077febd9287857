"""Default tolerances scale with the vehicle; a model file has precedence."""

from __future__ import annotations

import pytest

from benchtool.core.rig import Rig
from benchtool.core.rig_file import load_rig_by_name
from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.model import Model
from benchtool.physics.model_file import model_from_toml
from benchtool.physics.tolerances import model_tolerances, with_tolerances

ON_THE_BEAM = {  # from the owner of the pitch bench
    "coulomb_friction.torque_Nm": 0.002,
    "viscous_friction.damping_Nms": 0.004,
    "hinge_spring.stiffness_Nm_per_rad": 0.02,
    "cog_offset.x_m": 0.0005,
    "motor_lag.tau_s": 0.002,
    "transport_delay.delay_s": 0.002,
    "rotor_asymmetry.ratio": 0.015,
    "plate_offset.dz_m": 0.003,
    "battery_sag.rate_per_s": 0.0005,
    "gyro_bias.bias_rad_s": 0.0035,
    "body_lift.K_b": 0.25,
}


def with_all(rig: Rig) -> Model:
    """Return a model with all effects except laws."""
    model = Model.single(rig)
    for name in EFFECTS:
        model = model.with_effect(name) if EFFECTS[name].distance_law is None else model
    return model


def test_tolerances_of_the_beam_are_those_of_its_owner():
    values = model_tolerances(with_all(load_rig_by_name("beam")), "pitch")
    assert {name: values[name] for name in ON_THE_BEAM} == pytest.approx(ON_THE_BEAM, rel=1e-12)


def test_a_model_file_has_precedence():
    text = """
[model]
name = "stated"
rig = "amuse"

[effects.coulomb_friction]
torque_Nm = { value = 0.0, tolerance = 0.07 }

[effects.cog_offset]
x_m = 0.0
"""
    model = model_from_toml(text, "stated.toml").model
    assert model_tolerances(model) == pytest.approx(
        {
            "rotor_images.own_strength": 0.05,
            "coulomb_friction.torque_Nm": 0.07,
            "cog_offset.x_m": 0.0005 * 0.45 / 0.25,
        }
    )
    parameters = with_tolerances(model)
    assert parameters["coulomb_friction.torque_Nm"].tolerance == 0.07
    assert parameters["cog_offset.x_m"].tolerance == pytest.approx(0.0009)
    assert parameters["k"].tolerance is None
