"""Plate sweeps as the subject of an explanation.

Blocks of errors are stays at one plate position. Thrust is predicted point by point, a rotor's
speed from the earlier visits of its level, which fix the scale of the pulse. The floor is simulated
with the model: points with stated noise, predicted with draws from the posterior of the training.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchtool.core.units import Array
from benchtool.explain.engine.bounded_least_squares import solve_covariance
from benchtool.explain.engine.hypotheses import Hypotheses
from benchtool.explain.engine.subject import Subject, build_overlay
from benchtool.explain.findings import Overlay
from benchtool.explain.law_search import (
    FOLDS,
    CrossValidationFold,
    QuadraticSummary,
    ResidualSummary,
)
from benchtool.explain.laws import DISTANCE, NEAR, LawForm, Variable
from benchtool.explain.sweep.evidence import SweepEvidence
from benchtool.explain.sweep.log import SweepLog
from benchtool.explain.sweep.next_experiment import SweepDesigner
from benchtool.physics.effects.effect import HISTORY_TIME_CONSTANTS_S, Effect
from benchtool.physics.model import Model

RPM = 30.0 / np.pi

STEP = 0.05  # finite difference, in scales of the parameters
LEVEL_WIDTH = 0.02  # of the squared speed within one level, relative; assumed
REFERENCE_Z_OVER_R = 5.0  # eq. (2) adds 0.25 % there; assumed
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
        max_s, code = max(float(join(name).max()), 1.0), f"flow.{name} / p.reference"
        variables.append(Variable(phrase, symbol, join(name) / max_s, code, max_s, "s", "time"))
    for name, phrase in (("load", "the rotors' load"), ("wash", "the wash on the plate")):
        pairs = zip(HISTORY_TIME_CONSTANTS_S, join(f"past_{name}"), strict=True)
        for k, (time_s, past) in enumerate(pairs):
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
    table = (  # name, weights, formula, code, phrase of a centred form
        ("factor", thrust_N, "1 + {f}", "1.0 + p.a * {f}", ""),
        ("covered", thrust_N * coverage, "1 + {f}", "1.0 + p.a * flow.coverage[i] * {f}", ""),
        ("near", thrust_N * coverage / (1.0 + z**2), "1 + {f} / (1 + (z/R)^2)",
         f"1.0 + p.a * {NEAR} * {{f}}", " near the plate"),
        ("nearer", thrust_N * coverage * z**-3.0, "1 + {f} (z/R)^-3",
         f"1.0 + p.a * {nearer} * {{f}}", " next to the plate"),
        ("reading", np.full(len(thrust_N), median_N), "reading + {f}",
         "reading + p.a * p.typical * {f}", ""),
    )  # fmt: skip
    return [
        LawForm(
            name=name,
            hook="thrust_reading" if name == "reading" else "factor",
            weights=weights,
            formula=formula,
            code=code,
            tolerance=TOLERANCE * median_N,
            centred=bool(phrase),
            phrase=phrase,
        )
        for name, weights, formula, code, phrase in table
    ]


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


class SweepSubject(Subject):
    """Plate sweeps, compared with a model.

    Shape errors of a law of a few per cent exceed the noise of good sweeps, so sweeps are not
    rejected by their residuals; shape parameters absorb these errors.
    """

    kind = "sweep"
    gather = SweepEvidence
    summarize = staticmethod(summarize_residuals)
    designer = SweepDesigner
    evidence: SweepEvidence
    check_evidence: SweepEvidence
    all_evidence: SweepEvidence

    def __init__(
        self,
        model: Model,
        training: Sequence[SweepLog],
        validation: Sequence[SweepLog],
        extra: Sequence[Effect] = (),
    ) -> None:
        powers = [log.power for log in training if log.power is not None]
        if powers:  # one load scale for all sweeps
            training, validation = (
                [replace(log, power=log.power and log.power.loaded_as(powers[0])) for log in part]
                for part in (training, validation)
            )
        super().__init__(model, training, validation, extra)

    def errors(self, sets: Array, changes: Array) -> Mapping[str, Array]:
        check = self.check_evidence
        thrust, speed = [], []
        for log, thrust_N, speed_rad_s in self._by_log(changes):
            errors = log.thrust_N[:, None] - check.thrusts(log.conditions, sets) - thrust_N
            thrust.append(_mean_squares(errors, log.stay))
            if log.power is not None:
                readings = log.power.rotor_rad_s[:, :, None] - speed_rad_s
                speed.append(_speed_squares(log, readings - check.predicted(log, sets, readings)))
        return _by_channel(thrust, speed)

    @property
    def free_law(self) -> str:
        model = self.evidence.model
        parameters = [model.parameters[name] for name in ("k", "R_m")]
        is_known = [not k.free or k.prior.kind == "normal" for k in parameters]
        distances = [log.conditions.plate_z_m[~log.tare] for log in self.evidence.logs]
        max_ratio = float(np.max(np.concatenate(distances))) / model.rig.propulsion.radius_m
        if any(is_known) or max_ratio >= REFERENCE_Z_OVER_R:
            return ""
        return (
            f"k and R_m are free and the largest distance is {max_ratio:.2g} R, so an effect near "
            f"the plate looks like another law of distance; record points beyond "
            f"{REFERENCE_Z_OVER_R:g} R, or give k or R_m with its standard error"
        )

    def _by_log(self, changes: Array) -> Iterator[tuple[SweepLog, Array, Array]]:
        """Yield validation sweeps with changes of their thrusts and speeds, (m, n_sets) each."""
        for log, thrusts, speeds in self.check_evidence.rows():
            running = int((~log.tare).sum())
            yield log, changes[thrusts], changes[speeds][:running]

    def floor(
        self, at: Array, changes: Array, rng: np.random.Generator, spread: Array | None = None
    ) -> Mapping[str, Array]:
        check, n, draws = self.check_evidence, len(at), changes.shape[1]
        shifts = np.zeros((n, draws))
        if spread is not None:
            shifts = np.linalg.cholesky(spread) @ rng.standard_normal((n, draws))
        sets = np.vstack([at, at + STEP * np.eye(n)])
        thrust, speed = [], []
        for (log, thrust_N, speed_rad_s), root in zip(
            self._by_log(changes), check.noise_roots, strict=True
        ):
            errors_N = thrust_N + _linear_change(check.thrusts(log.conditions, sets), shifts)
            errors_N += root @ rng.standard_normal((len(log), draws))
            thrust.append(_mean_squares(errors_N, log.stay))
            power = log.power
            if power is not None:
                shape = power.rotor_rad_s.shape
                noise = power.rotor_se[:, :, None] * rng.standard_normal((*shape, draws))
                readings = noise + speed_rad_s
                predicted = check.predicted(log, sets, power.rotor_rad_s[:, :, None])
                errors_rad_s = _linear_change(predicted, shifts) + readings
                errors_rad_s -= power.predicted(check.drive(log, sets[:1]), readings)
                speed.append(_speed_squares(log, errors_rad_s))
        squares = _by_channel(thrust, speed)
        return {name: np.sqrt(np.mean(blocks, axis=0)) for name, blocks in squares.items()}

    def overlays(self, before: Array, after: Array) -> tuple[Overlay, ...]:
        """Return overlays of the first validation sweep: thrust over z/R, speeds over time.

        Rows are sorted by level and distance; lines break between levels.
        """
        evidence = self.check_evidence
        log, sets = evidence.logs[0], np.vstack([before, after])
        running = ~log.tare
        predicted = evidence.thrusts(log.conditions, sets)[running]
        ratio = log.conditions.plate_z_m / evidence.model.rig.propulsion.radius_m
        ratio = np.minimum(ratio, MAX_Z_OVER_R)[running]
        level = _levels(log)[running]
        rows = np.column_stack([ratio, log.thrust_N[running], predicted])
        overlays = [_overlay("thrust_N", "z_over_R", level, rows)]
        power = log.power
        if power is not None:
            predicted = evidence.predicted(log, sets, power.rotor_rad_s[:, :, None]).mean(axis=0)
            rows = np.column_stack([power.time_s, RPM * power.speed_rad_s, RPM * predicted])
            mask = power.is_predicted
            overlays.append(_overlay("rpm", "time_s", power.level[mask], rows[mask]))
        return tuple(overlays)


def _by_channel(thrust: list[Array], speed: list[Array]) -> dict[str, Array]:
    """Return mean squares (n_blocks, n_sets) of all sweeps, without missing speeds."""
    return {"thrust_N": np.concatenate(thrust)} | ({"rpm": np.concatenate(speed)} if speed else {})


def _linear_change(predictions: Array, errors: Array) -> Array:
    """Return linear changes by parameter errors (n_parameters, n).

    From predictions (..., m, 1 + n_parameters), each parameter changed by `STEP` in turn.
    """
    slope: Array = (predictions[..., 1:] - predictions[..., :1]) / STEP
    return slope @ errors


def _mean_squares(errors: Array, stay: NDArray[np.intp]) -> Array:
    """Return mean squares (n_stays, n_sets) of errors (m, n_sets), by stay of the plate."""
    numbers = np.unique(stay)
    return np.array([np.mean(errors[stay == number] ** 2, axis=0) for number in numbers])


def _speed_squares(log: SweepLog, errors: Array) -> Array:
    """Return mean squares (n_stays, n_sets): rpm^2, of errors (n_rotors, m, n_sets): rad/s."""
    assert log.power is not None
    mask = log.power.is_predicted
    squares = np.mean((RPM * errors[:, mask]) ** 2, axis=0)
    return _mean_squares(np.sqrt(squares), log.stay[~log.tare][mask])


def _levels(log: SweepLog) -> NDArray[np.intp]:
    """Return the index of each row's throttle level (m,)."""
    squares = np.sum(log.conditions.speed_rad_s**2, axis=0)
    order = np.argsort(squares)
    steps = np.diff(squares[order]) > LEVEL_WIDTH * squares[order][1:]
    levels = np.empty(len(squares), np.intp)
    levels[order] = np.concatenate([[0], np.cumsum(steps)])
    return levels


def _overlay(channel: str, axis: str, level: NDArray[np.intp], rows: Array) -> Overlay:
    """Return rows (m, 4) of position, measured, before, after, sorted by level and position."""
    levels = [rows[level == index] for index in np.unique(level)]
    return build_overlay(
        channel, axis, [part[np.argsort(part[:, 0], kind="stable")] for part in levels]
    )
