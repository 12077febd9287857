"""Simulated benches on which every source of a budget has a drawn error, as the budget says it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from benchtool.core.channel import Channel
from benchtool.core.recording import Recording
from benchtool.core.units import Array
from benchtool.physics.catalogue import find_effect
from benchtool.physics.conditions import Conditions
from benchtool.physics.effects.effect import LAW_ERROR
from benchtool.physics.model import Model
from benchtool.physics.model_file import load_model
from benchtool.physics.tolerances import default_tolerances

UNSEEN = ("plate_tilt", "load_cell_hysteresis", "plate_side")
"""Effects of the reading that the fitted model has not."""

SE_N = 0.02
LEVELS_RPM = (4200.0, 5400.0)
DISTANCES_M = (0.075, 0.1, 0.15, 0.2, 0.3, 0.45, 0.7, 1.2)


def budget_sweep(
    seed: int, path: Path, fixed: Mapping[str, float] = MappingProxyType({})
) -> dict[str, float]:
    """Write a table of points of a drawn quadrotor and return what it was made with.

    k, R and K_b are drawn evenly; what `quad_bench` has priors for from those; what it lacks evenly
    within its tolerance; each law of thrust is off by its own standard error.

    Args:
        seed: of everything that is drawn.
        path: of the table.
        fixed: true values in place of drawn ones.
    """
    rng = np.random.default_rng([20261123, seed])
    model = load_model("quad_bench").model
    truth = {
        "k": rng.uniform(0.9e-5, 1.15e-5),
        "R_m": rng.uniform(0.11, 0.135),
        "body_lift.K_b": rng.uniform(1.2, 2.8),
        "load_cell_drift.rate_N_per_s": rng.normal(0.0, 5e-5),
    }
    for name, item in model.parameters.items():
        if item.prior.kind == "normal" and item.free:
            truth[name] = rng.normal(item.prior.mean, item.prior.sd)
    for name in UNSEEN:
        effect = find_effect(name)
        values = effect.rig_values(model.rig) if effect.rig_values else {}
        model = model.with_effect(effect, **values)
        for own, half in default_tolerances(effect, model.rig, "sweep").items():
            truth[f"{name}.{own}"] = rng.uniform(-half, half)
    truth |= fixed
    recording = _visits(rng)
    conditions = Conditions.from_recording(recording, model.rig)
    thrust_N = _thrust(model, conditions, truth)
    for effect in model.effects:
        if effect.subsystem == "rpm_to_thrust":
            without = _thrust(model.without(effect.name), conditions, truth)
            thrust_N = thrust_N + rng.normal(0.0, LAW_ERROR) * (thrust_N - without)
    thrust_N = thrust_N + rng.normal(0.0, SE_N, len(thrust_N))
    columns = {name: recording.column(name) for name in recording.names}
    columns |= {"thrust_N": thrust_N, "thrust_se_N": np.full(len(thrust_N), SE_N)}
    header, table = ",".join(columns), np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.9g")
    return truth


def _visits(rng: np.random.Generator) -> Recording:
    """Return three repeats of levels at distances in mixed order, a tare before each repeat."""
    rows = []
    for repeat in range(3):
        elapsed_s = 0.0
        for z_m in rng.permutation(DISTANCES_M):
            for rpm in rng.permutation(LEVELS_RPM):
                elapsed_s += 6.0
                rows.append((200.0 * repeat + elapsed_s, elapsed_s, z_m, *[rpm] * 4))
    names = ("time_s", "elapsed_s", "plate_z_m", "rpm1", "rpm2", "rpm3", "rpm4")
    units = ("s", "s", "m", *["rpm"] * 4)
    table = np.array(rows).T
    return Recording.from_columns(
        [
            (Channel(name, unit), column)
            for name, unit, column in zip(names, units, table, strict=True)
        ]
    )


def _thrust(model: Model, conditions: Conditions, truth: dict[str, float]) -> Array:
    """Return readings at the truth's values, also beyond bounds: a loop has no sign of its own."""
    acting = model.with_free(*model.parameters)
    values = [truth.get(name, item.value) for name, item in acting.parameters.items()]
    return np.asarray(acting.thrust_N(conditions, np.array(values)), float)
