"""The contract of every built-in controller: in the compiled loop and through the seam alike."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from pkgutil import iter_modules
from typing import Any, NamedTuple

import numpy as np
import pytest

from benchtool.core.rig_file import load_rig_by_name
from benchtool.physics.expression import inlined_expression
from benchtool.simulate import controllers
from benchtool.simulate.controllers import laws
from benchtool.simulate.controllers.controller import (
    ControlLaw,
    FlightCommand,
    PitchMeasurement,
    PitchPlant,
    PitchReference,
)
from benchtool.simulate.controllers.laws import (
    FLIGHT_CONTROLLERS,
    LAWS,
    PITCH_CONTROLLERS,
    build_pitch_controller,
    find_law,
)
from benchtool.simulate.flight.cases import FlightCase, Goal, flight_case
from benchtool.simulate.flight.flight import fly, fly_user_controller
from benchtool.simulate.flight.vehicle import FlightVehicle
from benchtool.simulate.gain_file import gain_names, load_gains
from benchtool.simulate.pitch.run import PitchJob, torque_limit_Nm
from benchtool.simulate.pitch.simulate import simulate_controller, simulate_pitch
from tests.unit.simulate.pitching import STEADY_PLATE, SWAY, noisy_bench, sampled

EACH = pytest.mark.parametrize("name", PITCH_CONTROLLERS)
SETS = pytest.mark.parametrize("gains", gain_names())


def over(name: str) -> FlightCase:
    """Return a short flight towards an edge with a noisy gyro."""
    vehicle = FlightVehicle.of_rig(load_rig_by_name("pquad"), lag_s=0.02)
    case = flight_case("over", vehicle, load_gains("s3"), control=name, gyro_noise_rad_s=0.015)
    return replace(case, duration_s=3.0)


def plant() -> PitchPlant:
    bench = noisy_bench()
    inertia_kgm2 = bench.model.rig.body.inertia_yy_kgm2
    return PitchPlant(inertia_kgm2, torque_limit_Nm(bench))


class LawController:
    """A built-in law as a `Controller`, outside of a compiled loop."""

    def __init__(self, law, numbers):
        self.law, self.numbers, self.state = law, numbers, law.state

    def step(self, measurement, reference, dt_s):
        self.state, command = self.law.step(self.numbers, self.state, measurement, reference, dt_s)
        return command


def through_the_seam(name: str, gains: str) -> LawController:
    control = build_pitch_controller(name, load_gains(gains))
    return LawController(control.law, control.law.numbers(control, plant()))


@EACH
@SETS
def test_the_loop_and_the_seam_give_the_same_run(name, gains):
    schedule = sampled(2.0, reference_deg=SWAY, plate=STEADY_PLATE)
    job = PitchJob(noisy_bench(), build_pitch_controller(name, load_gains(gains)))
    compiled = simulate_pitch(job, schedule, seed=8)
    stepped = simulate_controller(through_the_seam(name, gains), job, schedule, seed=8)
    for column in ("true_theta_rad", "torque_Nm"):
        np.testing.assert_allclose(
            stepped.column(column), compiled.column(column), rtol=1e-9, atol=1e-12
        )


@EACH
@SETS
def test_at_rest_at_the_reference_it_asks_for_nothing(name, gains):
    controller = through_the_seam(name, gains)
    still = PitchMeasurement(0.0, 0.1, 0.0, 1.0, ())
    for _ in range(100):
        assert controller.step(still, PitchReference(0.1, 3.4), 0.004).torque_Nm == 0.0


@EACH
@SETS
def test_it_pushes_towards_the_reference_within_what_the_mixer_can_give(name, gains):
    for wanted in (0.05, -0.05, 50.0, -50.0):
        controller = through_the_seam(name, gains)
        level = PitchMeasurement(0.0, 0.0, 0.0, 1.0, ())
        torque = controller.step(level, PitchReference(wanted, 3.4), 0.004).torque_Nm
        assert torque * wanted > 0.0
        assert abs(torque) <= plant().torque_limit_Nm


@EACH
@SETS
def test_it_holds_the_reference_out_of_ground_effect(name, gains):
    schedule = sampled(6.0)
    job = PitchJob(noisy_bench(), build_pitch_controller(name, load_gains(gains)))
    run = simulate_pitch(job, schedule, seed=2)
    assert np.degrees(np.max(np.abs(run.column("true_theta_rad")))) < 0.3


@pytest.mark.parametrize("name", [n for n in FLIGHT_CONTROLLERS if not over(n).feeds_forward])
def test_the_loop_and_the_seam_give_the_same_flight(name):
    case = over(name)
    law = find_law(name, "free")
    compiled = fly(case)
    stepped = fly_user_controller(
        case, LawController(law, law.numbers(case, case.vehicle.rig.body)), name
    )
    assert np.ptp(compiled["x_m"]) > 0.05
    for column in ("x_m", "z_m", "roll_rad", "pitch_rad", "speed1_rad_s"):
        np.testing.assert_allclose(stepped[column], compiled[column], rtol=1e-9, atol=1e-11)


class ClimbState(NamedTuple):
    integral_N: float = 0.0


@inlined_expression
def climb(
    p: tuple[float, float], state: ClimbState, measured: Any, reference: Any, dt_s: float
) -> tuple[ClimbState, FlightCommand]:
    error_m = reference.z_m - measured.z_m
    thrust_N = reference.hover_N + p[0] * error_m - p[1] * measured.vz_m_s + state.integral_N
    return ClimbState(state.integral_N + error_m * dt_s), FlightCommand(thrust_N, 0.0, 0.0, 0.0)


def test_a_flight_law_of_any_state_goes_the_way_of_the_cascade(monkeypatch):
    law = ControlLaw(
        name="climb", title="climb", body="free", step=climb, state=ClimbState(),
        numbers=lambda case, body: (8.0 * body.mass_kg, 4.0 * body.mass_kg),
    )  # fmt: skip
    monkeypatch.setattr(laws, "LAWS", (*LAWS, law))
    monkeypatch.setitem(FLIGHT_CONTROLLERS, "climb", law.title)
    case = replace(over("climb"), start_m=(0.0, 0.0, 2.0), goals=(Goal(x_m=0.0, z_m=2.5),))
    case = replace(case, duration_s=1.0, gyro_noise_rad_s=0.0)
    built_in = fly(case)
    own = fly_user_controller(
        case, LawController(law, law.numbers(case, case.vehicle.rig.body)), "climb"
    )
    assert built_in["z_m"][-1] > 2.3
    assert np.isnan(built_in["pitch_ref_rad"]).all()
    np.testing.assert_allclose(own["z_m"], built_in["z_m"], rtol=1e-12)


@pytest.mark.parametrize("name", FLIGHT_CONTROLLERS)
def test_in_flight_it_holds_a_place_out_of_ground_effect(name):
    high = replace(over(name), start_m=(0.0, 0.0, 2.0), goals=(), gyro_noise_rad_s=0.0)
    flight = fly(high)
    assert np.abs(np.stack([flight["x_m"], flight["y_m"], flight["z_m"] - 2.0])).max() < 1e-3


def test_every_law_in_the_folder_is_registered():
    names = [info.name for info in iter_modules(controllers.__path__, f"{controllers.__name__}.")]
    found = (getattr(import_module(name), "LAW", None) for name in names)
    written = {(law.name, law.body) for law in found if isinstance(law, ControlLaw)}
    missing = written ^ {(law.name, law.body) for law in LAWS}
    assert not missing, f"list {missing} in LAWS of benchtool/simulate/controllers/laws.py"
