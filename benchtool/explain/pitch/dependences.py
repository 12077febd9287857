"""What pitch recordings may depend on: torques, thrusts and readings over each variable.

A recording has thousands of readings that a filter joins, so a law is not looked for among readings
but among the functions that are linear between knots of a variable: what each of them does to the
innovations follows from the filter (`discrepancies`), and everything that a search asks for follows
from products of those columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array_type import Array
from benchtool.explain.engine.hypotheses import Hypotheses
from benchtool.explain.law_search.law import DISTANCE, LawForm, Variable
from benchtool.explain.law_search.search import (
    FOLDS,
    CrossValidationFold,
    QuadraticSummary,
    ResidualSummary,
)
from benchtool.explain.pitch.discrepancies import DiscrepancySimulation
from benchtool.explain.pitch.evidence import PitchEvidence

KNOTS = 21  # so many at even quantiles of a variable and so many at even steps of its range
BLOCK_S = 2.0  # length of what is held out as one: far longer than a filter remembers
TORQUE, FACTOR = 3.0, 0.005  # departures that do not matter, in tolerances and as a factor
TYPICAL = 0.3  # what a law of the torque counts in, over thrust times arm; assumed


@dataclass(frozen=True, slots=True, eq=False)
class _Pair:
    """Hold a variable of each recording, by disc (discs or 1, n), and what it changes."""

    phrase: str
    symbol: str
    code: str
    reference: float
    unit: str
    scale: Literal["positive", "time", "signed", "distance"]
    form: str
    values: Sequence[Array]


def missed_torques(
    evidence: PitchEvidence, at: Array, opened: Sequence[str]
) -> list[ResidualSummary]:
    """Return what innovations miss, over each variable and form that it may depend on.

    Args:
        at: (n_parameters,) about which the model is taken to be linear.
    """
    hypotheses = Hypotheses(evidence)
    errors = hypotheses.errors
    missed, slope, departures = hypotheses.missed(at, opened)
    logs = evidence.departing()
    beside = _Beside(np.hstack([slope, departures]), slope.shape[1], _parts(logs))
    noise = [float(errors.variance[part].sum()) for part in beside.parts[:-1]]
    out = []
    for pair in _pairs(logs):
        knots = _knots(np.concatenate([one.ravel() for one in pair.values]))
        if len(knots) < 3:
            continue
        columns = [
            _changed(log, pair.form, values, knots)
            for log, values in zip(logs, pair.values, strict=True)
        ]
        both = np.column_stack([np.concatenate(columns) / errors.noise[:, None], missed])
        (says, *rests), (bare, *bare_rests) = beside.said(both)
        out.append(
            ResidualSummary(
                variable=Variable(
                    phrase=pair.phrase, symbol=pair.symbol, code=pair.code, values=knots,
                    reference=pair.reference, unit=pair.unit, scale=pair.scale,
                ),
                form=_form(pair.form, logs, len(knots)),
                says=says,
                bare=bare,
                folds=[
                    CrossValidationFold(rest=rest, bare_rest=bare_rest, noise=squares)
                    for rest, bare_rest, squares in zip(rests, bare_rests, noise, strict=True)
                ],
            )
        )  # fmt: skip
    return out


@dataclass(frozen=True, eq=False)
class _Beside:
    """Hold what may vary beside what is missed, and the parts that are held out.

    Attributes:
        columns: (n_rows, r) by one standard deviation, of parameters the first `n_slopes`.
        parts: masks (n_rows,); all but the last are held out in turn.
    """

    columns: Array
    n_slopes: int
    parts: list[NDArray[np.bool_]]

    @cached_property
    def grams(self) -> list[Array]:
        """Products of the columns with each other (r, r), by part."""
        return [self.columns[part].T @ self.columns[part] for part in self.parts]

    def said(self, both: Array) -> list[list[QuadraticSummary]]:
        """Return what columns and, last, readings (n_rows, m + 1) say: of all, without each part.

        With everything beside them, then with parameters alone.
        """
        products = [
            (both[part].T @ both[part], both[part].T @ self.columns[part], gram)
            for part, gram in zip(self.parts, self.grams, strict=True)
        ]
        out = []
        for n in (self.columns.shape[1], self.n_slopes):
            parts = [(own, cross[:, :n], gram[:n, :n]) for own, cross, gram in products]
            whole = [np.sum(kind, axis=0) for kind in zip(*parts, strict=True)]
            rests = [
                [all_ - one for all_, one in zip(whole, part, strict=True)] for part in parts[:-1]
            ]
            out.append([_says(*kinds) for kinds in (whole, *rests)])
        return out


def _says(own: Array, cross: Array, gram: Array) -> QuadraticSummary:
    """Return what readings say of columns, everything beside them free under a unit normal prior.

    From products (m + 1, m + 1) of columns and readings, (m + 1, r) of those with what is beside
    them, and (r, r) of that with itself.
    """
    left = own - cross @ np.linalg.solve(np.eye(len(gram)) + gram, cross.T)
    return QuadraticSummary(left[:-1, :-1], left[:-1, -1], float(left[-1, -1]))


def _parts(logs: Sequence[DiscrepancySimulation]) -> list[NDArray[np.bool_]]:
    """Return masks (n_rows,) of the folds and, last, of rotor speeds, which are never held out."""
    rng, labels = np.random.default_rng(0), []
    for one in logs:
        log = one.log
        block = (
            log.rows(np.arange(float(len(log.logged)))) / log.logged.rate_Hz // BLOCK_S
        ).astype(int)
        fold = (rng.permutation(int(block.max()) + 1) % FOLDS)[block]
        labels += [fold] * (1 + log.has_gyro)
        labels += [np.full(len(fold), FOLDS)] * sum(log.has_speed)
    label = np.concatenate(labels)
    return [label == number for number in range(FOLDS + 1)]


def _knots(values: Array) -> Array:
    """Return places over a variable: dense where there are readings, and over its whole range."""
    known = values[np.isfinite(values)]
    if not known.size or not np.ptp(known) > 0.0:
        return np.empty(0)
    low, high = np.quantile(known, [0.001, 0.999])
    share = np.linspace(0.0, 1.0, KNOTS)
    places = np.sort(np.concatenate([np.quantile(known, share), low + share * (high - low)]))
    places = np.clip(places, low, high)
    apart = np.diff(places, prepend=-np.inf) > 0.005 * (high - low)
    return np.asarray(places[apart], float)


def _changed(log: DiscrepancySimulation, form: str, values: Array, knots: Array) -> Array:
    """Return whitened rows (n_rows, m) of a form's functions of values (discs or 1, n)."""
    hats = [np.nan_to_num(_hats(row, knots)) for row in values]
    if form == "torque":
        return log.rows("torque", hats[0])
    if form in ("gyro", "encoder"):
        return log.rows("gyro" if form == "gyro" else "pitch", hats[0])
    x_m = log.model.rig.disc_positions_m[:, 0]
    acting = -x_m[:, None] * log.thrust
    if form != "factor":
        over = np.zeros_like(acting)
        ratio = log.height_m / log.model.rig.propulsion.radius_m
        near = 1.0 / (1.0 + ratio**2) if form == "near" else 1.0
        over[log.over] = log.log.logged.plate_share * near
        acting = acting * over
    every = hats * len(acting) if len(hats) == 1 else hats
    torque = sum(row[:, None] * one for row, one in zip(acting, every, strict=True))
    return log.rows("torque", np.asarray(torque))


def _hats(values: Array, knots: Array) -> Array:
    """Return functions (n, m) that are 1 at a knot each and linear to 0 at its neighbours."""
    place = np.clip(np.searchsorted(knots, values) - 1, 0, len(knots) - 2)
    share = np.clip((values - knots[place]) / np.diff(knots)[place], 0.0, 1.0)
    out = np.zeros((len(values), len(knots)))
    rows = np.arange(len(values))
    out[rows, place], out[rows, place + 1] = 1.0 - share, share
    return out


def _pairs(logs: Sequence[DiscrepancySimulation]) -> list[_Pair]:
    """Return the variables with the forms in which each may act."""
    angle = [one.values("angle")[None] for one in logs]
    rate = [one.rate[None] for one in logs]
    speed = [one.speed for one in logs]
    load = [one.thrust.sum(axis=0)[None] for one in logs]
    time = [np.arange(len(one.log.logged))[None] / one.log.logged.rate_Hz for one in logs]
    radius_m = logs[0].model.rig.propulsion.radius_m
    height = [
        np.where(one.log.logged.plate_share > 0.0, one.height_m / radius_m, np.nan)[None]
        for one in logs
    ]
    quick = [np.gradient(one.speed, axis=1) * one.log.logged.rate_Hz for one in logs]
    speeds, loads = _typical(speed), _typical(load)
    discs = range(logs[0].log.logged.n_discs)
    total = " + ".join(f"flow.thrust_N[{disc}]" for disc in discs)
    out = []
    for phrase, symbol, code, unit, scale, values, reference, forms in (
        ("the angle", "angle/ref", "flow.pitch_rad / p.reference", "rad", "signed", angle,
         _largest(angle), ("torque", "near", "gyro", "encoder")),
        ("the rate", "rate/ref", "flow.rate_rad_s / p.reference", "rad/s", "signed", rate,
         _largest(rate), ("torque", "near", "encoder")),
        ("rotor speed", "w/w_ref", "flow.speed_rad_s[i] / p.reference", "rad/s", "positive", speed,
         speeds, ("factor", "near")),
        ("the thrust of all rotors", "T/T_ref", f"({total}) / p.reference", "N", "positive", load,
         loads, ("torque",)),
        ("time since the run began", "t/t_ref", "flow.time_s / p.reference", "s", "time", time,
         _largest(time), ("torque", "factor", "near", "gyro")),
        ("plate distance", "z/R", DISTANCE, "1", "distance", height, 1.0, ("covered",)),
        ("how quickly a rotor's speed changes", "dw/dt", "", "rad/s^2", "signed", quick,
         _largest(quick), ("factor",)),
    ):  # fmt: skip
        for form in forms:
            over = [one / reference for one in values]
            out.append(_Pair(phrase, symbol, code, reference, unit, scale, form, over))  # type: ignore[arg-type]
    return out


def _largest(values: Sequence[Array]) -> float:
    return max(float(np.nanmax(np.abs(one))) for one in values) or 1.0


def _typical(values: Sequence[Array]) -> float:
    return float(np.median(np.concatenate([one.ravel() for one in values]))) or 1.0


def _form(name: str, logs: Sequence[DiscrepancySimulation], m: int) -> LawForm:
    """Return what a law of m knots changes; functions of unit size are in the columns."""
    rig, may = logs[0].model.rig, logs[0].model.discrepancy
    arms_m = np.abs(rig.disc_positions_m[:, 0])
    torque = _typical([arms_m @ one.thrust for one in logs])
    near = f"flow.coverage[i] / (1.0 + ({DISTANCE}) * ({DISTANCE}))"
    ones = np.ones(m)
    if name == "torque":
        return LawForm(
            name=name, hook="torque", weights=TYPICAL * torque * ones, formula="{f}", unit="N m",
            code="p.a * p.typical * {f}", matters=TORQUE * may.torque * torque, bench="pitch",
            share_of=f"{TYPICAL * torque:.2g} N m",
        )  # fmt: skip
    if name == "gyro":
        typical = _typical([np.array([np.std(one.rate)]) for one in logs])
        return LawForm(
            name=name, hook="gyro_reading", weights=typical * ones, formula="reading + {f}",
            code="reading + p.a * p.typical * {f}", matters=may.gyro * typical, unit="rad/s",
            bench="pitch", phrase=", in the gyro's reading", share_of=f"{typical:.2g} rad/s",
        )  # fmt: skip
    if name == "encoder":
        typical = _typical([np.array([np.std(one.values("angle"))]) for one in logs])
        return LawForm(
            name=name, hook="", weights=typical * ones, formula="", code="", unit="rad",
            matters=may.encoder_rad, bench="pitch", phrase=", in the encoder's reading",
            share_of=f"{typical:.2g} rad",
        )  # fmt: skip
    code = {"factor": "p.a", "covered": "p.a * flow.coverage[i]", "near": f"p.a * {near}"}[name]
    return LawForm(
        name=name, hook="factor", weights=ones, bench="pitch", matters=FACTOR, unit="1",
        formula="1 + {f} / (1 + (z/R)^2)" if name == "near" else "1 + {f}",
        code=f"1.0 + {code} * {{f}}", centred=name in ("near", "factor"),
        phrase={"factor": ", in the rotors' thrust", "near": " near the plate"}.get(name, ""),
    )  # fmt: skip
