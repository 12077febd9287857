"""Plate sweeps as the subject of an explanation.

Blocks of errors are stays at one place of the plate. Thrust is predicted point by point, a rotor's
speed from the earlier visits of its level, which give the scale that belongs to the pulse. The
floor is made by the model itself: its points with stated noise, predicted with parameters drawn
from what the sweeps to learn from leave of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array_type import Array
from benchtool.core.recording import Recording
from benchtool.explain.engine.evidence import ChannelErrors, Overlay, Subject
from benchtool.explain.engine.hypotheses import Hypotheses
from benchtool.explain.engine.shared_errors import solve_covariance
from benchtool.explain.law_search.law import DISTANCE, LawForm, Variable
from benchtool.explain.law_search.search import (
    FOLDS,
    CrossValidationFold,
    QuadraticSummary,
    ResidualSummary,
)
from benchtool.explain.sweep.evidence import SweepEvidence
from benchtool.explain.sweep.log import SweepLog, refuse_other_sweeps, sweep_log
from benchtool.explain.sweep.next_experiment import next_sweep
from benchtool.physics.effects.effect import PAST_S, Effect
from benchtool.physics.model import Model

FARTHEST = 12.0  # distance over radius from which on a plate is as good as away
TOLERANCE = 0.005  # departure of thrust that does not matter, over it; assumed
RPM = 30.0 / np.pi

STEP = 0.05  # finite difference, in scales of the parameters
SAME_LOAD = 0.02  # share of the squared speed within one level; assumed
REFERENCE_Z_OVER_R = 5.0  # eq. (2) adds a quarter of a per cent there; assumed
FARTHEST_Z_OVER_R = 12.0  # a plate farther away than this is drawn here: nothing of it shows


def sweep_variables(logs: tuple[SweepLog, ...], radius_m: float, shown_N: Array) -> list[Variable]:
    """Return what thrusts (m,) of all sweeps may depend on."""

    def joined(name: str) -> Array:
        return np.concatenate([getattr(log.conditions, name) for log in logs], axis=-1)

    turning = np.concatenate([~log.tare for log in logs])
    speed = np.sqrt(np.mean(joined("speed_rad_s") ** 2, axis=0))
    middle = float(np.median(speed[turning]))
    thrust = float(np.median(shown_N[turning]))
    time, tare_s, moved_s = joined("time_s"), joined("elapsed_s"), joined("moved_s")
    stays = np.concatenate([1000 * k + log.stay for k, log in enumerate(logs)])
    out = [
        Variable(
            phrase="plate distance", symbol="z/R", code=DISTANCE, reference=radius_m, unit="m",
            values=np.minimum(joined("plate_z_m") / radius_m, FARTHEST), scale="distance",
            forms=("covered",),
        ),
        Variable(
            phrase="rotor speed", symbol="w/w_ref", code="flow.speed_rad_s[i] / p.reference",
            reference=middle, unit="rad/s", values=speed / middle,
            forms=("factor", "near", "nearer"),
        ),
        Variable(
            phrase="the load on the cell", symbol="T/T_ref", code="reading / p.reference",
            reference=thrust, unit="N", values=shown_N / thrust, forms=("reading",),
        ),
        Variable(
            phrase="which way the load was reached", symbol="direction",
            code="flow.load_direction", values=joined("load_direction"), scale="side",
        ),
        Variable(
            phrase="from where the plate came", symbol="came_from", code="flow.moved_direction",
            values=joined("moved_direction"), scale="side", forms=("near", "nearer"),
        ),
        Variable(
            phrase="lateral position", symbol="x/R", code="flow.plate_x_m / p.reference",
            reference=radius_m, unit="m", values=joined("plate_x_m") / radius_m, scale="signed",
        ),
    ]  # fmt: skip
    if any(len(np.unique(log.stay)) > len(np.unique(places_of((log,)))) for log in logs):
        out.append(
            Variable(
                phrase="the visit", symbol="visit", values=stays.astype(float), blocks=True,
                forms=("reading", "near"),
            )
        )  # fmt: skip
    for phrase, symbol, code, values in (
        ("time since the run began", "t/t_ref", "flow.time_s", time),
        ("time since the tare", "s/t_ref", "flow.elapsed_s", tare_s),
        ("time since the plate moved", "m/t_ref", "flow.moved_s", moved_s),
    ):
        span = max(float(values.max()), 1.0)
        out.append(
            Variable(
                phrase=phrase, symbol=symbol, code=f"{code} / p.reference", reference=span,
                unit="s", values=values / span, scale="time",
            )
        )  # fmt: skip
    for name, phrase in (("load", "the rotors' load"), ("wash", "the wash on the plate")):
        past = joined(f"past_{name}")
        out += [
            Variable(
                phrase=f"{phrase} over the last {time_s:g} s", symbol=f"{name}_{time_s:g}s",
                code=f"flow.past_{name}[{k}]", values=past[k], scale="time",
            )
            for k, time_s in enumerate(PAST_S)
        ]  # fmt: skip
    volts = joined("voltage_V")
    out.append(
        Variable(
            phrase="supply voltage", symbol="V/V_ref", code="flow.voltage_V / p.reference",
            reference=float(np.median(volts)), unit="V", values=volts / float(np.median(volts)),
        )
    )  # fmt: skip
    return out


def sweep_forms(logs: tuple[SweepLog, ...], radius_m: float, shown_N: Array) -> list[LawForm]:
    """Return how a law may change thrusts (m,) of all sweeps."""
    c = [log.conditions for log in logs]
    turning = np.concatenate([~log.tare for log in logs])
    thrust = np.where(turning, shown_N, 0.0)
    covered = np.concatenate([np.mean(one.coverage, axis=0) for one in c])
    z = np.concatenate([one.plate_z_m for one in c]) / radius_m
    middle = float(np.median(thrust[turning]))
    near = f"flow.coverage[i] / (1.0 + ({DISTANCE}) * ({DISTANCE}))"
    nearer = f"flow.coverage[i] * power({DISTANCE}, -3.0)"
    matters = TOLERANCE * middle
    return [
        LawForm(
            name="factor", hook="factor", weights=thrust, formula="1 + {f}",
            code="1.0 + p.a * {f}", matters=matters,
        ),
        LawForm(
            name="covered", hook="factor", weights=thrust * covered, formula="1 + {f}",
            code="1.0 + p.a * flow.coverage[i] * {f}", matters=matters,
        ),
        LawForm(
            name="near", hook="factor", weights=thrust * covered / (1.0 + z**2),
            formula="1 + {f} / (1 + (z/R)^2)", code=f"1.0 + p.a * {near} * {{f}}",
            matters=matters, centred=True, phrase=" near the plate",
        ),
        LawForm(
            name="nearer", hook="factor", weights=thrust * covered * z**-3.0,
            formula="1 + {f} (z/R)^-3", code=f"1.0 + p.a * {nearer} * {{f}}",
            matters=matters, centred=True, phrase=" next to the plate",
        ),
        LawForm(
            name="reading", hook="thrust_reading", weights=np.full(len(thrust), middle),
            formula="reading + {f}", code="reading + p.a * p.typical * {f}", matters=matters,
        ),
    ]  # fmt: skip


def missed_thrusts(
    evidence: SweepEvidence, at: Array, opened: Sequence[str]
) -> list[ResidualSummary]:
    """Return what thrusts miss, over each variable and form that it may depend on.

    Args:
        at: (n_parameters,) about which the model is taken to be linear.
    """
    hypotheses = Hypotheses(evidence)
    errors = hypotheses.errors
    missed, slope, departures = hypotheses.missed(at, opened)
    shown = np.concatenate(
        [evidence.thrusts(log.conditions, at[None])[:, 0] for log in evidence.logs]
    )
    white = evidence.white_thrusts(np.eye(len(shown))) / errors.noise[:, None]
    both, known = np.column_stack([white, missed]), np.hstack([departures, slope])
    says, bare = (_says(white.T @ solve_covariance(columns, both)) for columns in (known, slope))
    radius_m = evidence.model.rig.propulsion.radius_m
    variables = sweep_variables(evidence.logs, radius_m, shown)
    forms = sweep_forms(evidence.logs, radius_m, shown)
    variance = float(np.mean(errors.variance[evidence.thrust_rows]))
    folds = list(_folds(says, bare, places_of(evidence.logs), variance))
    return [
        ResidualSummary(variable=variable, form=form, says=says, bare=bare, folds=folds)
        for variable in variables
        for form in forms
        if form.name in variable.forms
    ]


def _says(products: Array) -> QuadraticSummary:
    """Return what readings say, from Q and Q z (m, m + 1) of them; z Q z is left out."""
    return QuadraticSummary(products[:, :-1], products[:, -1], 0.0)


def _folds(
    says: QuadraticSummary, bare: QuadraticSummary, places: NDArray[np.intp], variance: float
) -> Iterator[CrossValidationFold]:
    """Give the folds, whole places of the plate each; readings of noise with that variance."""
    numbers = np.unique(places)
    part = np.random.default_rng(0).permutation(len(numbers)) % FOLDS
    for number in range(min(FOLDS, len(numbers))):
        out = np.isin(places, numbers[part == number])
        yield CrossValidationFold(
            rest=says.without(out), bare_rest=bare.without(out), noise=variance * float(out.sum())
        )


def places_of(logs: tuple[SweepLog, ...]) -> NDArray[np.intp]:
    """Return the number of each thrust's place of the plate (m,), alike in all sweeps."""
    c = [log.conditions for log in logs]
    places = np.concatenate([np.stack([one.plate_z_m, one.plate_x_m]) for one in c], axis=1)
    return np.unique(np.round(places, 3), axis=1, return_inverse=True)[1].reshape(-1)


class SweepSubject(Subject):
    """Hold plate sweeps against a model.

    Laws a few per cent off in shape leave more than noise in good sweeps, so that nothing is
    refused by what is left; shape parameters of their own carry what is off in them.
    """

    kind = "sweep"
    missed_by = staticmethod(missed_thrusts)
    next_by = staticmethod(next_sweep)
    evidence: SweepEvidence
    all_evidence: SweepEvidence
    validation: Sequence[SweepLog]

    def __init__(
        self,
        model: Model,
        learn: Sequence[Recording],
        check: Sequence[Recording],
        extra: Sequence[Effect] = (),
    ) -> None:
        logs = [sweep_log(one, model.rig) for one in (*learn, *check)]
        refuse_other_sweeps(logs)
        powers = [log.power for log in logs[: len(learn)] if log.power is not None]
        if powers:  # the supply's load is counted alike in all sweeps
            logs = [
                replace(log, power=log.power and log.power.loaded_as(powers[0])) for log in logs
            ]
        self.training, self.validation = logs[: len(learn)], logs[len(learn) :]
        self.evidence = SweepEvidence(model, logs[: len(learn)], extra)
        self._check = SweepEvidence(model, logs[len(learn) :], extra)
        self.all_evidence = SweepEvidence(model, logs, extra)

    def errors(self, sets: Array, changes: Array) -> Mapping[str, ChannelErrors]:
        check = self._check
        thrust, speed = [], []
        for log, of_thrust, of_speed in self._by_log(changes):
            missed = log.thrust_N[:, None] - check.thrusts(log.conditions, sets) - of_thrust
            thrust.append(_by_stay(missed, log.stay))
            if log.power is not None:
                read = log.power.rotor_rad_s[:, :, None] - of_speed
                speed.append(_of_speeds(log, read - check.predicted(log, sets, read)))
        out = {"thrust_N": ChannelErrors(unit="N", squares=np.concatenate(thrust))}
        if speed:
            out["rpm"] = ChannelErrors(unit="rpm", squares=np.concatenate(speed))
        return out

    @property
    def free_law(self) -> str:
        model = self.evidence.model
        items = [model.parameters[name] for name in ("k", "R_m")]
        known = [not item.free or item.prior.kind == "normal" for item in items]
        turning = [log.conditions.plate_z_m[~log.tare] for log in self.evidence.logs]
        farthest = float(np.max(np.concatenate(turning))) / model.rig.propulsion.radius_m
        if any(known) or farthest >= REFERENCE_Z_OVER_R:
            return ""
        return (
            f"k and R_m are free and the farthest point lies at {farthest:.2g} R, so an effect "
            f"near the plate looks like a different law of distance; record points beyond "
            f"{REFERENCE_Z_OVER_R:g} R, or state k or R_m with its standard error"
        )

    def _by_log(self, changes: Array) -> Iterator[tuple[SweepLog, Array, Array]]:
        """Return check sweeps with changes of their thrusts and speeds, (m, n_sets) each."""
        first = 0
        for log in self.validation:
            speeds = first + len(log)
            last = speeds + (log.power.n_rows if log.power is not None else 0)
            running = int((~log.tare).sum())
            yield log, changes[first:speeds], changes[speeds : min(last, speeds + running)]
            first = last

    def floor(
        self, at: Array, changes: Array, rng: np.random.Generator, spread: Array | None = None
    ) -> Mapping[str, Array]:
        check, n, draws = self._check, len(at), changes.shape[1]
        off = np.zeros((n, draws))
        if spread is not None:
            off = np.linalg.cholesky(spread) @ rng.standard_normal((n, draws))
        sets = np.vstack([at, at + STEP * np.eye(n)])
        thrust, speed = [], []
        for (log, of_thrust, of_speed), root in zip(
            self._by_log(changes), check.noise_roots, strict=True
        ):
            missed = of_thrust + _moved(check.thrusts(log.conditions, sets), off)
            missed += root @ rng.standard_normal((len(log), draws))
            thrust.append(_by_stay(missed, log.stay))
            power = log.power
            if power is not None:
                shape = power.rotor_rad_s.shape
                read = power.rotor_se[:, :, None] * rng.standard_normal((*shape, draws)) + of_speed
                wrong = (
                    _moved(check.predicted(log, sets, power.rotor_rad_s[:, :, None]), off) + read
                )
                wrong -= power.predicted(check.drive(log, sets[:1]), read)
                speed.append(_of_speeds(log, wrong))
        out = {"thrust_N": np.sqrt(np.mean(np.concatenate(thrust), axis=0))}
        if speed:
            out["rpm"] = np.sqrt(np.mean(np.concatenate(speed), axis=0))
        return out

    def overlays(self, before: Array, after: Array) -> tuple[Overlay, ...]:
        """Return the first check sweep: thrust over plate distance, speeds over time.

        Rows are sorted by level and distance; lines break between levels.
        """
        check = self._check
        log, sets = check.logs[0], np.vstack([before, after])
        running = ~log.tare
        shown = check.thrusts(log.conditions, sets)[running]
        ratio = log.conditions.plate_z_m / check.model.rig.propulsion.radius_m
        ratio = np.minimum(ratio, FARTHEST_Z_OVER_R)[running]
        level = _levels(log)[running]
        rows = np.column_stack([ratio, log.thrust_N[running], shown])
        out = [_overlay("thrust_N", "N", "z_over_R", level, rows)]
        power = log.power
        if power is not None:
            shown = check.predicted(log, sets, power.rotor_rad_s[:, :, None]).mean(axis=0)
            rows = np.column_stack([power.time_s, RPM * power.speed_rad_s, RPM * shown])
            late = power.late
            out.append(_overlay("rpm", "rpm", "time_s", power.level[late], rows[late]))
        return tuple(out)


def _moved(shown: Array, off: Array) -> Array:
    """Return what parameters that are off (n_parameters, n) change.

    From predictions (..., m, 1 + n_parameters), each parameter moved by `STEP` in turn.
    """
    slope: Array = (shown[..., 1:] - shown[..., :1]) / STEP
    return slope @ off


def _by_stay(missed: Array, stay: NDArray[np.intp]) -> Array:
    """Return the mean square (n_stays, n_sets) of misses (m, n_sets)."""
    numbers = np.unique(stay)
    return np.array([np.mean(missed[stay == number] ** 2, axis=0) for number in numbers])


def _of_speeds(log: SweepLog, wrong: Array) -> Array:
    """Return the mean square (n_stays, n_sets) in rpm of misses (n, m, n_sets) in rad/s.

    Of the visits that are predicted, over the rotors.
    """
    assert log.power is not None
    late = log.power.late
    squares = np.mean((RPM * wrong[:, late]) ** 2, axis=0)
    return _by_stay(np.sqrt(squares), log.stay[~log.tare][late])


def _levels(log: SweepLog) -> NDArray[np.intp]:
    """Return the number of each row's level of throttle (m,)."""
    squares = np.sum(log.conditions.speed_rad_s**2, axis=0)
    order = np.argsort(squares)
    steps = np.diff(squares[order]) > SAME_LOAD * squares[order][1:]
    numbers = np.empty(len(squares), np.intp)
    numbers[order] = np.concatenate([[0], np.cumsum(steps)])
    return numbers


def _overlay(channel: str, unit: str, axis: str, level: NDArray[np.intp], rows: Array) -> Overlay:
    """Return rows (m, 4) of place, measured, before, after by level and place, nan in between."""
    pieces = []
    for number in np.unique(level):
        part = rows[level == number]
        pieces.append(part[np.argsort(part[:, 0], kind="stable")])
        pieces.append(np.full((1, 4), np.nan))
    at, measured, before, after = np.concatenate(pieces).T
    return Overlay(
        channel=channel, unit=unit, axis=axis, at=at, measured=measured, before=before, after=after
    )
