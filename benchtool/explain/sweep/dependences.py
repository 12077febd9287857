"""Summaries of thrust residuals of sweeps over each candidate variable of a law."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from benchtool.core.units import Array
from benchtool.explain.engine.bounded_least_squares import solve_covariance
from benchtool.explain.engine.hypotheses import Hypotheses
from benchtool.explain.law_search import (
    FOLDS,
    CrossValidationFold,
    QuadraticSummary,
    ResidualSummary,
)
from benchtool.explain.laws import DISTANCE, NEAR, LawForm, Variable
from benchtool.explain.sweep.evidence import SweepEvidence
from benchtool.explain.sweep.log import SweepLog
from benchtool.physics.effects.effect import HISTORY_TIME_CONSTANTS_S

TOLERANCE = 0.005  # negligible relative discrepancy of thrust; assumed
MAX_Z_OVER_R = 12.0  # clips larger distances, without ground effect


def sweep_variables(
    logs: tuple[SweepLog, ...], radius_m: float, predicted_N: Array
) -> list[Variable]:
    """Return the candidate variables of thrusts (m,) of all sweeps."""

    def join(name: str) -> Array:
        return np.concatenate([getattr(log.conditions, name) for log in logs], axis=-1)

    is_running = np.concatenate([~log.tare for log in logs])
    speed = np.sqrt(np.mean(join("speed_rad_s") ** 2, axis=0))
    median_speed = float(np.median(speed[is_running]))
    median_N = float(np.median(predicted_N[is_running]))
    variables = [
        Variable(
            "plate distance", "z/R", np.minimum(join("plate_z_m") / radius_m, MAX_Z_OVER_R),
            DISTANCE, radius_m, "m", scale="distance", forms=("covered",),
        ),
        Variable(
            "rotor speed", "w/w_ref", speed / median_speed, "flow.speed_rad_s[i] / p.reference",
            median_speed, "rad/s", forms=("factor", "near", "nearer"),
        ),
        Variable(
            "the load on the cell", "T/T_ref", predicted_N / median_N, "reading / p.reference",
            median_N, "N", forms=("reading",),
        ),
        Variable(
            "which way the load was reached", "direction", join("load_direction"),
            "flow.load_direction", scale="side",
        ),
        Variable(
            "from where the plate came", "came_from", join("moved_direction"),
            "flow.moved_direction", scale="side", forms=("near", "nearer"),
        ),
        Variable(
            "lateral position", "x/R", join("plate_x_m") / radius_m,
            "flow.plate_x_m / p.reference", radius_m, "m", scale="signed",
        ),
    ]  # fmt: skip
    if any(len(np.unique(log.stay)) > len(np.unique(index_positions((log,)))) for log in logs):
        stays = np.concatenate([1000 * k + log.stay for k, log in enumerate(logs)]).astype(float)
        forms = ("reading", "near")
        variables.append(Variable("the visit", "visit", stays, forms=forms, is_categorical=True))
    for phrase, symbol, name in (
        ("time since the run began", "t/t_ref", "time_s"),
        ("time since the tare", "s/t_ref", "elapsed_s"),
        ("time since the plate moved", "m/t_ref", "moved_s"),
    ):
        values = join(name)
        max_value = max(float(values.max()), 1.0)
        code = f"flow.{name} / p.reference"
        variables.append(
            Variable(phrase, symbol, values / max_value, code, max_value, "s", scale="time")
        )
    for name, phrase in (("load", "the rotors' load"), ("wash", "the wash on the plate")):
        for k, (time_s, past) in enumerate(
            zip(HISTORY_TIME_CONSTANTS_S, join(f"past_{name}"), strict=True)
        ):
            phrase_k, symbol = f"{phrase} over the last {time_s:g} s", f"{name}_{time_s:g}s"
            code = f"flow.past_{name}[{k}]"
            variables.append(Variable(phrase_k, symbol, past, code, scale="time"))
    supply_V, code = join("voltage_V"), "flow.voltage_V / p.reference"
    median_V = float(np.median(supply_V))
    return [
        *variables,
        Variable("supply voltage", "V/V_ref", supply_V / median_V, code, median_V, "V"),
    ]


def sweep_forms(logs: tuple[SweepLog, ...], radius_m: float, predicted_N: Array) -> list[LawForm]:
    """Return the forms of laws for thrusts (m,) of all sweeps."""
    rows = [log.conditions for log in logs]
    is_running = np.concatenate([~log.tare for log in logs])
    thrust_N = np.where(is_running, predicted_N, 0.0)
    coverage = np.concatenate([np.mean(v.coverage, axis=0) for v in rows])
    z = np.concatenate([v.plate_z_m for v in rows]) / radius_m
    median_N = float(np.median(thrust_N[is_running]))
    nearer = f"flow.coverage[i] * power({DISTANCE}, -3.0)"
    matters = TOLERANCE * median_N
    return [
        LawForm(
            name="factor", hook="factor", weights=thrust_N, formula="1 + {f}",
            code="1.0 + p.a * {f}", tolerance=matters,
        ),
        LawForm(
            name="covered", hook="factor", weights=thrust_N * coverage, formula="1 + {f}",
            code="1.0 + p.a * flow.coverage[i] * {f}", tolerance=matters,
        ),
        LawForm(
            name="near", hook="factor", weights=thrust_N * coverage / (1.0 + z**2),
            formula="1 + {f} / (1 + (z/R)^2)", code=f"1.0 + p.a * {NEAR} * {{f}}",
            tolerance=matters, centred=True, phrase=" near the plate",
        ),
        LawForm(
            name="nearer", hook="factor", weights=thrust_N * coverage * z**-3.0,
            formula="1 + {f} (z/R)^-3", code=f"1.0 + p.a * {nearer} * {{f}}",
            tolerance=matters, centred=True, phrase=" next to the plate",
        ),
        LawForm(
            name="reading", hook="thrust_reading", weights=np.full(len(thrust_N), median_N),
            formula="reading + {f}", code="reading + p.a * p.typical * {f}", tolerance=matters,
        ),
    ]  # fmt: skip


def summarize_residuals(
    evidence: SweepEvidence, values: Array, active: Sequence[str]
) -> list[ResidualSummary]:
    """Return a summary of the thrust residuals at values (n_parameters,) by variable and form.

    Active effects may exceed their tolerances.
    """
    hypotheses = Hypotheses(evidence)
    errors = hypotheses.errors
    residuals, by_parameter, by_discrepancy = hypotheses.linearise_residuals(values, active)
    thrusts_N = [evidence.thrusts(log.conditions, values[None])[:, 0] for log in evidence.logs]
    predicted_N = np.concatenate(thrusts_N)
    white = evidence.whiten_thrusts(np.eye(len(predicted_N))) / errors.noise[:, None]
    rows = np.column_stack([white, residuals])
    nuisance = np.hstack([by_discrepancy, by_parameter])
    products = [white.T @ solve_covariance(part, rows) for part in (nuisance, by_parameter)]
    # Q and Q z (m, m + 1); z Q z is not needed.
    says, bare = (QuadraticSummary(part[:, :-1], part[:, -1], 0.0) for part in products)
    radius_m = evidence.model.rig.propulsion.radius_m
    variables = sweep_variables(evidence.logs, radius_m, predicted_N)
    forms = sweep_forms(evidence.logs, radius_m, predicted_N)
    variance = float(np.mean(errors.variance[evidence.thrust_rows]))
    folds = list(_folds(says, bare, index_positions(evidence.logs), variance))
    return [
        ResidualSummary(
            variable=variable, form=form, quadratic=says, bare_quadratic=bare, folds=folds
        )
        for variable in variables
        for form in forms
        if form.name in variable.forms
    ]


def _folds(
    says: QuadraticSummary, bare: QuadraticSummary, positions: NDArray[np.intp], variance: float
) -> Iterator[CrossValidationFold]:
    """Yield folds of whole plate positions; readings have this noise variance."""
    numbers = np.unique(positions)
    part = np.random.default_rng(0).permutation(len(numbers)) % FOLDS
    for number in range(min(FOLDS, len(numbers))):
        mask = np.isin(positions, numbers[part == number])
        noise = variance * float(mask.sum())
        yield CrossValidationFold(says.without(mask), bare.without(mask), noise)


def index_positions(logs: tuple[SweepLog, ...]) -> NDArray[np.intp]:
    """Return the index of each thrust's plate position (m,), the same in all sweeps."""
    rows = [np.stack([log.conditions.plate_z_m, log.conditions.plate_x_m]) for log in logs]
    positions = np.round(np.concatenate(rows, axis=1), 3)
    return np.unique(positions, axis=1, return_inverse=True)[1].reshape(-1)
