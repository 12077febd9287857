"""Data of somebody's own vehicle are held against that vehicle, whatever a model file names."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import pytest

from benchtool.acquire.inputs import SweepInputs
from benchtool.acquire.plan import (
    OrderPart,
    Plan,
    PlatePart,
    SettlePart,
    TarePart,
    ThrottlePart,
    plan_to_toml,
)
from benchtool.acquire.sweep import Sweep
from benchtool.bench.guard import GuardedBench
from benchtool.bench.stage.stage import DeviceStage
from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.rig import Rig
from benchtool.core.rig_file import load_rig_by_name, rig_to_toml
from benchtool.data.run.read import run_rig
from benchtool.data.run.run import Run
from benchtool.explain.inputs import ExplainInputs
from benchtool.explain.request import read_request
from benchtool.fit.nominal import nominal_model
from benchtool.fit.recipe import Recipe
from benchtool.fit.run_recipe import run_recipe
from benchtool.physics.model import Model
from benchtool.physics.model_file import load_model
from benchtool.report.fit.page import write_fit
from benchtool.simulate.imperfections import Imperfections
from benchtool.virtual.devices import build_hello, virtual_plant
from benchtool.virtual.simulated_bench import SimulatedBench

K_B = 2.0


def five_inch() -> Rig:
    """Return a quadrotor with other arms, rotors and motors than pquad."""
    rig = load_rig_by_name("pquad")
    propulsion = replace(
        rig.propulsion,
        radius_m=0.0635,
        thrust_coefficient_N_s2=1.6e-6,
        drag_coefficient_Nm_s2=1.2e-8,
        speed_per_us_rad_s=2.4,
    )
    return replace(
        rig,
        name="five_inch",
        title="Quadrotor with 5 inch rotors",
        rotors=tuple(
            replace(place, x_m=place.x_m * 0.49, y_m=place.y_m * 0.49) for place in rig.rotors
        ),
        propulsion=propulsion,
        body=replace(rig.body, mass_kg=0.6),
        limits=replace(rig.limits, rpm=26_000.0),
    )


def swept(
    path: Path,
    rig: Rig,
    seed: int,
    truth: Model | None = None,
    flaws: Imperfections | None = None,
) -> str:
    """Write the run of a sweep over a vehicle, with body lift `K_B` where no truth is given."""
    lifted = Model.single(rig).with_effect("neighbour_images").with_effect("body_lift", K_b=K_B)
    truth = truth or lifted
    plan = Plan(
        name="own",
        repeats=2,
        sample_s=0.5,
        plate=PlatePart(distances_over_R=(0.8, 1.0, 1.5, 2.0, 3.0)),
        throttle=ThrottlePart(pwm_us=(1350.0, 1450.0)),
        order=OrderPart(seed=seed, anchor_every=0),
        settle=SettlePart(window_s=0.6),
        tare=TarePart(every_minutes=0.0),
    ).resolved(rig)
    run = Run.create(path, plan_to_toml(plan), {"simulated": True, "rig": asdict(rig)})
    plant = virtual_plant(rig, truth, seed, flaws or Imperfections(), rate_Hz=80.0)
    bench = SimulatedBench("sim:own", plant, build_hello(plant, truth, seed))
    with GuardedBench(bench, rig) as guarded:
        sweep = Sweep(SweepInputs(plan=plan), rig)
        sweep.stage = DeviceStage(guarded, rig.plate)
        sweep.record(guarded, run)
    return str(path)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("own")
    return swept(folder / "one", five_inch(), 1), swept(folder / "two", five_inch(), 2)


def recipe(*data: str, model: str = "quad_bench") -> Recipe:
    return Recipe(name="own", data=data, model=model)


def test_a_fit_holds_the_truth_of_an_own_vehicle(runs, tmp_path):
    output = run_recipe(recipe(runs[0]))
    low, high = output.results[0]["body_lift.K_b"].interval_95
    assert low < K_B < high
    assert high - low < 0.3
    assert output.results[0]["R_m"].value == pytest.approx(0.0635, rel=0.02)
    assert output.fitted.rig == run_rig(runs[0])
    assert output.fitted.rig.rotors == five_inch().rotors

    # What it wrote stands by itself: a report draws it, and another fit begins with it.
    write_fit(tmp_path / "fit", output)
    written = tmp_path / "fit" / "model.toml"
    again = load_model(written).model
    assert again.rig.rotors == five_inch().rotors
    assert again.rig.propulsion == five_inch().propulsion
    assert again.parameters["body_lift.K_b"].value == output.results[0]["body_lift.K_b"].value
    assert nominal_model(str(written), five_inch()).draws
    with pytest.raises(InputError, match="another rig than the run's"):
        nominal_model(str(written), load_rig_by_name("pquad"))


def explained(learn: str, check: str, model: str) -> ExplainInputs:
    return ExplainInputs(recordings=(learn,), check=(check,), model=model)


def test_runs_of_two_vehicles_are_no_data_of_one_model(runs, tmp_path):
    other = Run.create(tmp_path / "pquad", "", {"rig": asdict(load_rig_by_name("pquad"))}).path
    for read in (
        lambda: run_recipe(recipe(runs[0], str(other))),
        lambda: read_request(explained(runs[0], str(other), "quad_bench")),
    ):
        with pytest.raises(InputError, match=r"have different rigs \(different rotor positions"):
            read()


HELD = """
[model]
name = "mine"
rig = "pquad"
[parameters]
k = {{ value = 1.1e-5, free = true, lower = 1e-6, upper = 1e-3, source = "start" }}
R_m = {radius}
[effects.neighbour_images]
strength = 1.0
"""


@pytest.mark.parametrize(
    ("radius", "said"),
    [
        ("0.12", ""),
        ("0.0635", ""),
        ("{ free = true }", ""),
        ("0.126", r"R_m is fixed at 0\.126 for rig 'pquad', but the data are from rig"),
        (
            '{ value = 0.12, free = true, prior = { kind = "normal", mean = 0.12, sd = 0.01 } }',
            "R_m has a prior for rig 'pquad', but the data are from rig 'five_inch'",
        ),
    ],
)
def test_numbers_of_another_vehicle_give_way_or_are_refused(radius, said, tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(HELD.format(radius=radius))
    if said:
        with pytest.raises(FileFormatError, match=said):
            load_model(file, five_inch())
        return
    items = load_model(file, five_inch()).model.parameters
    assert (items["k"].value, items["k"].lower, items["k"].free) == (1.6e-6, 0.0, True)
    assert (items["R_m"].value, items["R_m"].upper) == (0.0635, pytest.approx(3 * 0.0635))
    same = load_model(file, load_rig_by_name("pquad")).model.parameters
    assert (same["k"].value, same["k"].lower) == (1.1e-5, 1e-6)


TABLE = """plate_z_m,rpm1,thrust_N,thrust_se_N
0.0635,15000,4.82,0.02
0.09,15000,4.35,0.02
0.127,15000,4.17,0.02
0.19,15000,4.05,0.02
0.4,15000,3.98,0.02
"""


def test_a_table_on_a_shipped_model_asks_for_its_rig(tmp_path):
    one, two, rig = tmp_path / "one.csv", tmp_path / "two.csv", tmp_path / "rig.toml"
    one.write_text(TABLE)
    two.write_text(TABLE.replace("4.82", "4.83"))
    asked = "does not say which rig it was measured on"
    with pytest.raises(InputError, match=asked):
        run_recipe(recipe(str(one), model="single"))
    with pytest.raises(InputError, match=asked):
        read_request(explained(str(one), str(two), "single"))
    rig.write_text(rig_to_toml(replace(five_inch(), rotors=five_inch().rotors[:1])))
    named = run_recipe(replace(recipe(str(one), model="single"), rig=str(rig)))
    assert named.fitted.rig.name == "five_inch"
    # A model file of one's own says which rig it is for, and the data are taken for that one's.
    (tmp_path / "own.toml").write_text('[model]\nname = "own"\nrig = "rig.toml"\n')
    own = replace(recipe(str(one), model=str(tmp_path / "own.toml")), free=("k",))
    assert run_recipe(own).fitted.rig.name == "five_inch"


def on_pquad_single(data: str) -> Recipe:
    return replace(recipe(data, model="single"), rig="pquad_single")


def table(folder: Path, text: str) -> str:
    file = folder / "points.csv"
    file.write_text(text)
    return str(file)


def test_more_rotors_than_the_rig_has_are_refused(tmp_path):
    head, *rows = TABLE.splitlines()
    turning = [f"{row},{15000 + place}" for place, row in enumerate(rows)]
    data = table(tmp_path, "\n".join([f"{head},rpm2", *turning]))
    with pytest.raises(InputError, match=r"speeds of 2 rotors, and the model 1 \(rig"):
        run_recipe(on_pquad_single(data))


def test_a_thrust_coefficient_far_from_the_rigs_is_told(tmp_path):
    grams = table(tmp_path, "rpm1,thrust_N\n4000,185\n5000,289\n6000,416\n7000,567\n")
    warned = run_recipe(replace(on_pquad_single(grams), hold=("R_m",))).results[0].warnings
    assert any("times the thrust coefficient of rig pquad_single" in line for line in warned)
    newtons = table(tmp_path, "rpm1,thrust_N\n4000,1.81\n5000,2.84\n6000,4.08\n7000,5.56\n")
    calm = run_recipe(replace(on_pquad_single(newtons), hold=("R_m",))).results[0].warnings
    assert not any("times the thrust coefficient" in line for line in calm)
