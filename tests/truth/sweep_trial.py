"""One simulated sweep with known numbers, through the whole tool, and what the fit says of them."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchtool.acquire.plan import (
    OrderPart,
    Plan,
    PlatePart,
    SettlePart,
    TarePart,
    ThrottlePart,
    plan_to_toml,
)
from benchtool.acquire.sweep import run_sweep
from benchtool.bench.guard import GuardedBench
from benchtool.bench.stage.stage import DeviceStage, OneSidedStage
from benchtool.core.rig import Rig
from benchtool.core.rig_file import rig_to_dict
from benchtool.data.run.run import Run
from benchtool.fit.recipe import Method, Recipe
from benchtool.fit.run_recipe import run_recipe
from benchtool.physics.model import Model
from benchtool.physics.model_file import load_model
from benchtool.simulate.imperfections import Imperfections
from benchtool.virtual.simulated import SimulatedBench

COUNTED = ("k", "R_m", "body_lift.K_b")
RATE_HZ = 80.0


@dataclass(frozen=True, slots=True)
class Trial:
    """Hold one trial: which intervals hold the truth, by method and parameter."""

    held: dict[str, dict[str, tuple[bool, bool]]]  # {method: {parameter: (68 % holds, 95 % holds)}}
    z: dict[str, dict[str, float]]  # {method: {parameter: (value - truth) / sd}}


def run_trial(seed: int, methods: Sequence[Method]) -> Trial:
    """Draw a bench, sweep it and fit the run.

    k, R and K_b are drawn evenly from wide ranges; the nuisances from the priors that the model
    `quad_bench` states for them; drift, noise, lag, sag and vibration are the virtual bench's own.
    """
    rng = np.random.default_rng([20261121, seed])
    model = load_model("quad_bench").model
    truth = {
        "k": rng.uniform(0.9e-5, 1.15e-5),
        "R_m": rng.uniform(0.11, 0.135),
        "body_lift.K_b": rng.uniform(1.2, 2.8),
        **{
            name: rng.normal(item.prior.mean, item.prior.sd)
            for name, item in model.parameters.items()
            if item.prior.kind == "normal"
        },
    }
    made = model
    for name, value in truth.items():
        made = made.fixed(name, value)
    flaws = Imperfections(drift_N_per_s=rng.normal(0.0, 5e-5), backlash_m=0.0)
    with tempfile.TemporaryDirectory() as folder:
        run = _swept(made, model.rig, flaws, seed, Path(folder) / "run")
        recipe = Recipe(
            name="trial",
            data=(str(run),),
            model="quad_bench",
            methods=tuple(methods),
            seed=seed + 1,
        )
        results = run_recipe(recipe).results
    held: dict[str, dict[str, tuple[bool, bool]]] = {}
    z: dict[str, dict[str, float]] = {}
    for result in results:
        held[result.method], z[result.method] = {}, {}
        for name in COUNTED:
            item, value = result[name], truth[name]
            held[result.method][name] = (
                item.interval_68[0] <= value <= item.interval_68[1],
                item.interval_95[0] <= value <= item.interval_95[1],
            )
            z[result.method][name] = (item.value - value) / item.sd
    return Trial(held, z)


def _swept(made: Model, rig: Rig, flaws: Imperfections, seed: int, path: Path) -> Path:
    plan = Plan(
        name="trial",
        repeats=3,
        sample_s=1.0,
        plate=PlatePart(distances_over_R=(0.6, 0.8, 1.0, 1.5, 2.0, 3.0)),
        throttle=ThrottlePart(pwm_us=(1450.0, 1600.0)),
        order=OrderPart(seed=seed, anchor_every=0),
        settle=SettlePart(window_s=0.6),
        tare=TarePart(every_minutes=0.0),
    ).resolved(rig)
    run = Run.create(path, plan_to_toml(plan), {"simulated": True, "rig": rig_to_dict(rig)})
    bench = SimulatedBench("sim:pquad", rig, made, seed=seed, rate_Hz=RATE_HZ, imperfections=flaws)
    with GuardedBench(bench, rig) as guarded:
        run_sweep(guarded, OneSidedStage(DeviceStage(guarded), rig.plate), plan, rig, run)
    return path
