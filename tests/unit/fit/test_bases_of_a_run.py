"""One bench at equal speed, pulse and power: one radius where blades and motor are known."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchtool.core.errors import InputError
from benchtool.core.rig import Motor, Rig
from benchtool.core.rig_file import rig_to_toml
from benchtool.data.run.read import fill_missing_parts, find_differences
from benchtool.fit.nominal import rig_for_data
from benchtool.fit.recipe import Basis, Recipe
from benchtool.fit.run_recipe import run_recipe
from benchtool.physics.model_file import load_model
from benchtool.simulate.imperfections import Imperfections
from tests.unit.fit.test_own_rig import swept
from tests.unit.physics.blades import BLADE, bladed

RIG = bladed("pquad_single")
TRUE_M = 0.125
QUIET = replace(Imperfections.none(), thrust_noise_N=5e-4, rpm_noise_rpm=0.2)


def bare() -> Rig:
    return replace(RIG, blade=None, motor=None)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    truth = load_model("single", RIG).model.with_fixed("R_m", TRUE_M)
    return swept(tmp_path_factory.mktemp("bases") / "run", RIG, 1, truth, QUIET)


def radius(run: str, basis: Basis, **more: object) -> tuple[float, float]:
    recipe = Recipe(name="b", data=(run,), model="single", basis=basis, **more)  # type: ignore[arg-type]
    found = run_recipe(recipe).results[0]["R_m"]
    return found.value, found.sd


@pytest.mark.parametrize("basis", ["joint", "equal_rpm2", "equal_pwm", "equal_power"])
def test_every_basis_finds_the_radius_of_the_bench(run, basis):
    value, sd = radius(run, basis)
    assert value == pytest.approx(TRUE_M, abs=max(4.0 * sd, 1e-4))
    assert sd < 5e-4


def test_read_as_eq_10_is_printed_the_bases_disagree(run):
    printed = {
        basis: radius(run, basis, fix={"blade_inflow.share": 0.0})[0]
        for basis in ("equal_rpm2", "equal_pwm", "equal_power")
    }
    assert printed["equal_rpm2"] < printed["equal_pwm"] < printed["equal_power"] < TRUE_M
    assert printed["equal_rpm2"] < 0.97 * TRUE_M


def test_a_rig_that_is_named_adds_blades_to_an_older_run(tmp_path):
    older = swept(tmp_path / "older", bare(), 1, load_model("single", bare()).model, QUIET)
    now = tmp_path / "now.toml"
    now.write_text(rig_to_toml(RIG))
    found = rig_for_data([older], "single", str(now))
    assert found is not None
    assert (found.blade, found.motor) == (RIG.blade, RIG.motor)
    assert rig_for_data([older], "single") == replace(found, blade=None, motor=None)
    assert fill_missing_parts(RIG, bare()) == RIG
    other = replace(RIG, blade=replace(BLADE, solidity=0.2), motor=Motor(governed=True))
    assert [text.split(" of ")[0] for text in find_differences(RIG, other)] == [
        "different blades", "different motors",
    ]  # fmt: skip
    now.write_text(rig_to_toml(other))
    newer = swept(tmp_path / "newer", RIG, 1, load_model("single", RIG).model, QUIET)
    with pytest.raises(InputError, match="different blades"):
        rig_for_data([newer], "single", str(now))
