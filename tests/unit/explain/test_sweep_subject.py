"""Plate sweeps are explained: the paper's own story, real data, and what to sweep next."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchtool.acquire.check_plan import check_plan
from benchtool.acquire.plan import Plan, plan_from_toml
from benchtool.acquire.visit_order import expected_duration_s, plan_visits
from benchtool.core.recording import Recording
from benchtool.data.columns import KINDS
from benchtool.data.run.read import read_points
from benchtool.data.table import read_table
from benchtool.explain.engine.explain import explain
from benchtool.explain.findings import NextExperiment
from benchtool.explain.next_steps import format_added_model
from benchtool.explain.result import Explanation
from benchtool.explain.sweep.log import sweep_log
from benchtool.explain.sweep.next_experiment import MINUTES, SweepDesigner
from benchtool.explain.sweep.subject import SweepSubject
from benchtool.fit.recipe import Recipe
from benchtool.fit.run_recipe import run_recipe
from benchtool.physics.baseline import DiscrepancyTolerances
from benchtool.physics.model import Model
from benchtool.physics.model_file import load_model
from tests.unit.explain.hand_made import answer, far_off

DATASETS = Path(__file__).parents[3] / "datasets"


def halves(name: str) -> tuple[Recording, Recording]:
    """Return the odd repeats of a run, and the even ones; tares in both."""
    points = read_points(DATASETS / name / "run", KINDS)
    odd = points.column("repeat") % 2 == 1
    tare = points.column("kind") == KINDS.index("tare")
    return points.select(odd | tare), points.select(~odd | tare)


def subject_of(
    model: Model, learn: Sequence[Recording], check: Sequence[Recording]
) -> SweepSubject:
    """Return sweeps to learn from and to check on, with a model."""
    logs = ([sweep_log(points, model.rig) for points in part] for part in (learn, check))
    return SweepSubject(model, *logs)


def explained(model: str, name: str) -> Explanation:
    """Explain one half of a run, checked on the other."""
    learn, check = halves(name)
    return explain(subject_of(load_model(model).model, [learn], [check]))


@pytest.fixture(scope="module")
def story():
    return explained("quad", "quad")


def test_the_quadrotor_lacks_the_body_lift_of_the_paper(story):
    verdict = story
    assert (verdict.kind, verdict.names) == ("effect", ("body_lift",))
    (found,) = verdict.effects[0].parameters
    truth = load_model("virtual_pquad").model.parameters["body_lift.K_b"].value
    assert found.low < truth < found.high
    assert found.value == pytest.approx(2.0, abs=0.3)
    assert 0.1 < found.std < 0.3  # most of it is the law's own, a tenth of what it does
    assert verdict.effects[0].probability > 0.95


def test_a_fit_of_the_new_model_keeps_the_truth_in_its_interval(story, tmp_path):
    """It carries what explain adjusted within what was known; held, K_b alone would be too sure."""
    given = replace(story, source=answer(loaded=load_model("quad")).source)
    (tmp_path / "model.toml").write_text(format_added_model(given), encoding="utf-8")
    run = str(DATASETS / "quad" / "run")
    recipe = Recipe(name="again", model=str(tmp_path / "model.toml"), data=(run,))
    fitted = run_recipe(recipe).results[0]
    found = fitted["body_lift.K_b"]
    truth = load_model("virtual_pquad").model.parameters["body_lift.K_b"].value
    assert {"k", "R_m", "ground_shape.curvature"} <= {item.name for item in fitted.estimates}
    assert abs(found.value - truth) < 1.96 * found.sd
    assert 0.02 < found.sd < 0.15
    alone = run_recipe(replace(recipe, hold=("k", "R_m", "ground_shape.curvature"))).results[0]
    assert alone["body_lift.K_b"].sd < 0.2 * found.sd
    assert fitted.chi2_per_dof < alone.chi2_per_dof


def test_the_whole_model_lacks_nothing():
    verdict = explained("quad_bench", "quad")
    assert (verdict.kind, verdict.names) == ("none", ())
    for gap in verdict.gaps:
        assert gap.after == gap.before


def proposed(name: str, first: str, second: str) -> tuple[NextExperiment, Plan]:
    """Return the sweep that shall tell two effects of five tolerances apart, and its plan."""
    learn, check = halves(name)
    subject = subject_of(load_model(MODELS[name]).model, [learn], [check])
    pair = [far_off(subject.evidence, name, 5.0) for name in (first, second)]
    found = SweepDesigner(subject.all_evidence, pair, np.random.default_rng(0)).propose(None, None)
    return found, plan_from_toml(found.plan_toml, "next").resolved(subject.evidence.model.rig)


MODELS = {"quad": "quad", "single_rotor": "single"}


@pytest.mark.parametrize(
    ("first", "second"),
    [("plate_tilt", "plate_offset"), ("neighbour_images", "body_lift")],
)
def test_the_next_sweep_is_one_that_a_bench_accepts_and_decides(first, second):
    chosen, plan = proposed("quad", first, second)
    rig = load_model("quad").model.rig
    check_plan(plan, rig)
    minutes = expected_duration_s(plan, rig, plan_visits(plan, rig)) / 60.0
    assert minutes == pytest.approx(chosen.minutes, rel=0.4)
    assert chosen.minutes <= MINUTES
    assert chosen.candidates == (first, second)
    assert chosen.expected[second] > 3.0
    assert chosen.is_decisive
    assert chosen.schedule is None


def test_what_no_sweep_can_tell_apart_is_said_not_to_be_decided():
    chosen, _ = proposed("single_rotor", "load_cell_hysteresis", "tare_offset")
    assert not chosen.is_decisive


def test_a_measured_rotor_pair_follows_another_law(reference_data):
    """As one disc it lacks something at z/R of 1 to 3, where the other rotor's image acts.

    There is one coplanar series, so it is checked on what it learned from. No effect of a single
    disc is the truth: nothing is named, and what departs is said with its size.
    """
    loaded = load_model(DATASETS / "rotor_pair" / "model.toml")
    path = reference_data / "ground_effect" / "rotor_pairs.csv"
    points = read_table(path, loaded.columns, ["series=Fz0"])
    verdict = explain(subject_of(loaded.model, [points], [points]))
    assert verdict.kind == "unknown"
    assert verdict.probabilities["unknown"] > 0.9
    assert verdict.unnamed[0].name == "thrust: distance"
    assert 0.02 < verdict.unnamed[0].share < 0.05
    assert "a different law of thrust against distance" in verdict.sentence
    (gap,) = verdict.gaps
    assert gap.after > 2.0 * gap.floor
    assert "body_lift" in verdict.not_judged
    assert any("no time_s" in remark for remark in verdict.remarks)


def lab_sweep(path: Path, seed: int, distances: Sequence[float]) -> Recording:
    """Sweep a bench whose thrust goes as 1 + 0.09 (z/R)^-1.6, on a cell of 12 mN hysteresis."""
    model, rng = load_model("single").model, np.random.default_rng(seed)
    p, k = model.rig.propulsion, model.parameters["k"].value
    rows = ["point,time_s,elapsed_s,kind,pwm1_us,rpm1,plate_z_m,thrust_N,thrust_se_N"]
    for place, ratio in enumerate((*distances, *distances[::-1])):
        began, z_m = 60.0 * place, ratio * p.radius_m
        zero = 0.001 * rng.standard_normal()
        rows.append(f"{len(rows)},{began},0,tare,1000,0,{z_m},{zero},0.001")
        for visit, pulse in enumerate((1400, 1500, 1600, 1500, 1400)):
            speed = p.speed_per_us_rad_s * (pulse - p.pwm_start_us)
            force = k * speed**2 * (1.0 + 0.09 * ratio**-1.6) + 0.001 * rng.standard_normal()
            force += 0.012 if visit > 2 else -0.012
            rpm, after = 30.0 / np.pi * speed + rng.standard_normal(), 8.0 * (visit + 1)
            rows.append(
                f"{len(rows)},{began + after},{after},measure,{pulse},{rpm},{z_m},{force},0.001"
            )
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return read_table(path, {}, [])


def test_a_lab_bench_of_another_law_is_said_to_be_that(tmp_path):
    learn = lab_sweep(tmp_path / "learn.csv", 1, (0.6, 0.8, 1.0, 1.3, 1.8, 2.5, 3.5, 6.0))
    check = lab_sweep(tmp_path / "check.csv", 2, (0.7, 0.9, 1.2, 1.6, 2.2, 3.0, 5.0))
    subject = subject_of(load_model("single").model, [learn], [check])
    verdict = explain(subject, propose=False)
    assert verdict.kind == "unknown"
    assert "a different law of thrust against distance, up to 2" in verdict.sentence
    assert "also load-cell hysteresis, probability above 0.99" in verdict.sentence


def measured_sweep(curve: Path, path: Path, seed: int, *, sd_N: float) -> Recording:
    """Sweep a bench whose ground effect is a measured curve, that of a pair of tilted rotors."""
    rng, model = np.random.default_rng(seed), load_model("single").model
    with curve.open(encoding="utf-8") as file:
        series = [row for row in csv.DictReader(file) if row["series"] == "Fz30_beta20"]
    places = [(float(row["z_over_R"]), float(row["Fz_over_Fz_at_5R"])) for row in series]
    p = model.rig.propulsion
    speed = p.speed_per_us_rad_s * (1600.0 - p.pwm_start_us)
    rows = ["point,time_s,kind,pwm1_us,rpm1,plate_z_m,thrust_N,thrust_se_N"]
    near = [place for place in places if place[0] < 3.6]
    for number, (ratio, gain) in enumerate((*near, *near[::-1])):
        z_m, time_s = ratio * p.radius_m, 60.0 * number
        force = model.parameters["k"].value * speed**2 * gain
        readings = [("tare", 1000, 0.0, 0.0), ("measure", 1600, 30.0 * speed / np.pi, force)]
        for kind, pulse, rpm, thrust in readings:
            read = thrust + sd_N * rng.standard_normal()
            rows.append(f"{len(rows)},{time_s},{kind},{pulse},{rpm},{z_m},{read},{sd_N}")
            time_s += 10.0
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return read_table(path, {}, [])


def test_a_measured_curve_of_two_rotors_is_no_sure_effect_of_one(reference_data, tmp_path):
    """With k and R free and no far point a different law looks like a stand in the wake."""
    curve = reference_data / "ground_effect" / "rotor_pairs.csv"
    model, classes = load_model("single").model.with_free("k", "R_m"), 0
    for seed in range(0, 12, 2):
        learn, check = (
            measured_sweep(curve, tmp_path / f"{number}.csv", number, sd_N=0.03)
            for number in (seed, seed + 1)
        )
        verdict = explain(subject_of(model, [learn], [check]), propose=False)
        assert all(effect.probability <= 0.9 for effect in verdict.effects)
        if verdict.kind == "class":
            classes += 1
            assert "unknown" in verdict.class_members
            assert any("record points beyond 5 R" in remark for remark in verdict.remarks)
    assert classes >= 1
    known = subject_of(model.with_fixed("R_m"), [learn], [check])
    assert known.free_law == ""


def test_a_departure_within_the_stated_discrepancy_is_none_that_matters(tmp_path):
    """The law of the lab bench departs from eq. (2) by 2 to 3 % of thrust."""
    distances = (0.6, 0.8, 1.0, 1.3, 1.8, 2.5, 3.5, 6.0)
    learn, check = (lab_sweep(tmp_path / f"{seed}.csv", seed, distances) for seed in (1, 2))
    model = load_model("single").model
    model = replace(model, discrepancy=DiscrepancyTolerances(thrust=0.1))
    verdict = explain(subject_of(model, [learn], [check]), propose=False)
    assert verdict.names == ("load_cell_hysteresis",)
    assert verdict.kind == "effect"
