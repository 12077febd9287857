"""The contract of every built-in controller: in the compiled loop and through the seam alike."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

import numpy as np
import pytest

from benchtool.simulate import controllers
from benchtool.simulate.controllers.controller import (
    LawController,
    PitchLaw,
    PitchMeasurement,
    PitchPlant,
    PitchReference,
)
from benchtool.simulate.controllers.pitch import LAWS, PITCH_CONTROLLERS, pitch_controller
from benchtool.simulate.gain_file import gain_names, gains_named
from benchtool.simulate.pitch.pack import torque_limit_Nm
from benchtool.simulate.pitch.run import PitchJob
from benchtool.simulate.pitch.simulate import simulate_controller, simulate_pitch
from tests.unit.simulate.pitching import STEADY_PLATE, SWAY, noisy_bench, sampled

PAGE = Path(__file__).parents[2] / "docs/how-to/write-a-controller.md"

EACH = pytest.mark.parametrize("name", PITCH_CONTROLLERS)
SETS = pytest.mark.parametrize("gains", gain_names())


def plant() -> PitchPlant:
    bench = noisy_bench()
    inertia_kgm2 = bench.model.rig.body.inertia_yy_kgm2
    return PitchPlant(inertia_kgm2, torque_limit_Nm(bench, bench.model))


def through_the_seam(name: str, gains: str) -> LawController:
    control = pitch_controller(name, gains_named(gains))
    return LawController(control.law, control.law.numbers(control, plant()))


@EACH
@SETS
def test_the_loop_and_the_seam_give_the_same_run(name: str, gains: str) -> None:
    schedule = sampled(2.0, reference_deg=SWAY, plate=STEADY_PLATE)
    job = PitchJob(noisy_bench(), pitch_controller(name, gains_named(gains)))
    compiled = simulate_pitch(job, schedule, seed=8)
    stepped = simulate_controller(through_the_seam(name, gains), job, schedule, seed=8)
    for column in ("true_theta_rad", "torque_Nm"):
        np.testing.assert_allclose(
            stepped.column(column), compiled.column(column), rtol=1e-9, atol=1e-12
        )


@EACH
@SETS
def test_at_rest_at_the_reference_it_asks_for_nothing(name: str, gains: str) -> None:
    controller = through_the_seam(name, gains)
    still = PitchMeasurement(0.0, 0.1, 0.0, 1.0, ())
    for _ in range(100):
        assert controller.step(still, PitchReference(0.1, 3.4), 0.004).torque_Nm == 0.0


@EACH
@SETS
def test_it_pushes_towards_the_reference_within_what_the_mixer_can_give(
    name: str, gains: str
) -> None:
    for wanted in (0.05, -0.05, 50.0, -50.0):
        controller = through_the_seam(name, gains)
        level = PitchMeasurement(0.0, 0.0, 0.0, 1.0, ())
        torque = controller.step(level, PitchReference(wanted, 3.4), 0.004).torque_Nm
        assert torque * wanted > 0.0
        assert abs(torque) <= plant().torque_limit_Nm


@EACH
@SETS
def test_it_holds_the_reference_out_of_ground_effect(name: str, gains: str) -> None:
    schedule = sampled(6.0)
    job = PitchJob(noisy_bench(), pitch_controller(name, gains_named(gains)))
    run = simulate_pitch(job, schedule, seed=2)
    assert np.degrees(np.max(np.abs(run.column("true_theta_rad")))) < 0.3


@EACH
def test_it_has_a_row_on_the_page_of_controllers(name: str) -> None:
    title = PITCH_CONTROLLERS[name]
    assert f"| `{name}` | {title} |" in PAGE.read_text(encoding="utf-8")


def test_the_page_has_no_row_of_an_unknown_controller() -> None:
    table = PAGE.read_text(encoding="utf-8").partition("| controller | what it does |")[2]
    rows = re.findall(r"^\| `([\w+]+)` \|", table, re.MULTILINE)
    assert set(rows) == set(PITCH_CONTROLLERS)


def test_every_law_in_the_folder_is_registered() -> None:
    names = [info.name for info in iter_modules(controllers.__path__, f"{controllers.__name__}.")]
    found = (getattr(import_module(name), "LAW", None) for name in names)
    assert {law.name for law in found if isinstance(law, PitchLaw)} == {law.name for law in LAWS}
