"""What does not matter goes with the vehicle, unless a model file states it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchtool.core.rig import Rig
from benchtool.core.rig_file import rig_named
from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.model import Model
from benchtool.physics.model_file import model_from_toml
from benchtool.physics.tolerances import default_tolerances, tolerances, with_tolerances

ON_THE_BEAM = {  # what the owner of the pitch bench named
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
    """Return a model with every effect in it."""
    model = Model.single(rig)
    for name in EFFECTS:
        model = model.with_effect(name) if EFFECTS[name].distance_law is None else model
    return model


def scaled(rig: Rig, mass: float = 1.0, length: float = 1.0) -> Rig:
    """Return a vehicle of another weight and size."""
    return replace(
        rig,
        body=replace(rig.body, mass_kg=mass * rig.body.mass_kg),
        propulsion=replace(rig.propulsion, radius_m=length * rig.propulsion.radius_m),
        rotors=tuple(replace(place, x_m=length * place.x_m) for place in rig.rotors),
    )


def test_on_the_beam_they_are_what_its_owner_named() -> None:
    known = tolerances(with_all(rig_named("beam")), "pitch")
    assert {name: known[name] for name in ON_THE_BEAM} == pytest.approx(ON_THE_BEAM, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "growth"),
    [
        ("coulomb_friction.torque_Nm", 30.0),
        ("viscous_friction.damping_Nms", 30.0),
        ("hinge_spring.stiffness_Nm_per_rad", 30.0),
        ("cog_offset.x_m", 3.0),
        ("plate_offset.dz_m", 3.0),
        ("tare_offset.thrust_N", 10.0),
        ("load_cell_drift.rate_N_per_s", 10.0),
        ("load_cell_hysteresis.half_width_N", 10.0),
        ("rotor_asymmetry.ratio", 1.0),
        ("transport_delay.delay_s", 1.0),
        ("body_lift.K_b", 1.0),
    ],
)
def test_they_grow_with_a_vehicle_ten_times_as_heavy_and_three_times_as_long(
    name: str, growth: float
) -> None:
    rig = rig_named("beam")
    small = tolerances(with_all(rig))
    large = tolerances(with_all(scaled(rig, mass=10.0, length=3.0)))
    assert large[name] / small[name] == pytest.approx(growth)


def test_a_rotor_by_itself_takes_its_radius_for_an_arm() -> None:
    rig = rig_named("pquad_single")
    known = default_tolerances(EFFECTS["cog_offset"], rig, "pitch")
    assert known["x_m"] == pytest.approx(0.0005 * 0.12 / 0.25)


def test_a_model_file_goes_first() -> None:
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
    assert tolerances(model) == pytest.approx(
        {
            "rotor_images.own_strength": 0.05,
            "coulomb_friction.torque_Nm": 0.07,
            "cog_offset.x_m": 0.0005 * 0.45 / 0.25,
        }
    )
    stated = with_tolerances(model)
    assert stated["coulomb_friction.torque_Nm"].tolerance == 0.07
    assert stated["cog_offset.x_m"].tolerance == pytest.approx(0.0009)
    assert stated["k"].tolerance is None
