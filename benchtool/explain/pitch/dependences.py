"""Summaries of pitch residuals over each candidate variable of a law.

A law is a piecewise linear function of a variable. The filter gives the change of the innovations
by each hat function (`FilteredLog`); products of those columns suffice for the search.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from benchtool.core.units import Array
from benchtool.explain.engine.hypotheses import Hypotheses
from benchtool.explain.law_search import (
    FOLDS,
    CrossValidationFold,
    QuadraticSummary,
    ResidualSummary,
)
from benchtool.explain.laws import DISTANCE, NEAR, LawForm, Scale, Variable
from benchtool.explain.pitch.evidence import PitchEvidence
from benchtool.explain.pitch.filter import COVERED_DISC, FilteredLog

KNOTS = 21  # at even quantiles of a variable, and as many at even steps of its range
BLOCK_S = 2.0  # validation block; far longer than the memory of the filter
TORQUE, FACTOR = 3.0, 0.005  # negligible discrepancies: in tolerances, and of a factor
TYPICAL = 0.3  # unit of a torque law over thrust times arm; assumed


def summarize_residuals(
    evidence: PitchEvidence, values: Array, active: Sequence[str]
) -> list[ResidualSummary]:
    """Return a summary of the innovations at values (n_parameters,) by variable and form of a law.

    Active effects may exceed their tolerances.
    """
    hypotheses = Hypotheses(evidence)
    errors = hypotheses.errors
    residuals, by_parameter, by_discrepancy = hypotheses.linearise_residuals(values, active)
    logs = evidence.logs
    nuisance, parts = np.hstack([by_parameter, by_discrepancy]), _fold_masks(logs)
    nuisances = [nuisance[part] for part in parts]
    grams = [nuisance[part].T @ nuisance[part] for part in parts]
    sizes = nuisance.shape[1], by_parameter.shape[1]
    noise = [float(errors.variance[part].sum()) for part in parts[:-1]]
    summaries = []
    for variable, ratios in _list_variables(logs):
        if len(variable.values) < 3:
            continue
        for form in variable.forms:
            columns = [
                _build_rows(log, form, series, variable.values)
                for log, series in zip(logs, ratios, strict=True)
            ]
            rows = np.column_stack([np.concatenate(columns) / errors.noise[:, None], residuals])
            products = [
                (rows[part].T @ rows[part], rows[part].T @ columns_, gram)
                for part, columns_, gram in zip(parts, nuisances, grams, strict=True)
            ]
            (says, *folds), (bare, *bare_folds) = (_summarize(products, n) for n in sizes)
            triples = zip(folds, bare_folds, noise, strict=True)
            summaries.append(
                ResidualSummary(
                    variable=variable,
                    form=_build_form(form, logs, len(variable.values)),
                    quadratic=says,
                    bare_quadratic=bare,
                    folds=[CrossValidationFold(*parts) for parts in triples],
                )
            )
    return summaries


def _summarize(products: Sequence[tuple[Array, Array, Array]], n: int) -> list[QuadraticSummary]:
    """Return summaries of all rows, then without each fold, with the first n nuisance columns.

    From products of each fold and, last, of the other rows, as in `_marginalize`.
    """
    parts = [(law_gram, cross[:, :n], gram[:n, :n]) for law_gram, cross, gram in products]
    totals = [np.sum(part, axis=0) for part in zip(*parts, strict=True)]
    training = [[a - b for a, b in zip(totals, part, strict=True)] for part in parts[:-1]]
    return [_marginalize(*part) for part in (totals, *training)]


def _marginalize(law_gram: Array, cross: Array, gram: Array) -> QuadraticSummary:
    """Return the summary of law columns, with nuisances under a unit normal prior marginalised.

    From products (m + 1, m + 1) of law columns and residuals, (m + 1, r) of those with nuisance
    columns, and (r, r) of nuisance columns.
    """
    reduced = law_gram - cross @ np.linalg.solve(np.eye(len(gram)) + gram, cross.T)
    return QuadraticSummary(reduced[:-1, :-1], reduced[:-1, -1], float(reduced[-1, -1]))


def _fold_masks(logs: Sequence[FilteredLog]) -> list[NDArray[np.bool_]]:
    """Return masks (n_rows,) of the folds and, last, of rotor speeds (training rows only)."""
    rng, labels = np.random.default_rng(0), []
    for log in logs:
        row = log.average(np.arange(float(len(log.logged))))
        block = (row / log.logged.rate_Hz // BLOCK_S).astype(int)
        fold = (rng.permutation(int(block.max()) + 1) % FOLDS)[block]
        labels += [fold] * (1 + log.has_gyro)
        labels += [np.full(len(fold), FOLDS)] * sum(log.has_speed)
    label = np.concatenate(labels)
    return [label == number for number in range(FOLDS + 1)]


def _place_knots(values: Array) -> Array:
    """Return knots of a variable: dense where there are readings, and over its whole range."""
    finite = values[np.isfinite(values)]
    if not finite.size or not np.ptp(finite) > 0.0:
        return np.empty(0)
    low, high = np.quantile(finite, [0.001, 0.999])
    share = np.linspace(0.0, 1.0, KNOTS)
    knots = np.sort(np.concatenate([np.quantile(finite, share), low + share * (high - low)]))
    knots = np.clip(knots, low, high)
    is_distinct = np.diff(knots, prepend=-np.inf) > 0.005 * (high - low)
    return np.asarray(knots[is_distinct], float)


def _build_rows(log: FilteredLog, form: str, values: Array, knots: Array) -> Array:
    """Return whitened rows (n_rows, m) of a form's hat functions of values (discs or 1, n)."""
    hats = [np.nan_to_num(_hat_functions(row, knots)) for row in values]
    if form == "torque":
        return log.error_rows("torque", hats[0])
    if form in ("gyro", "encoder"):
        return log.error_rows("gyro" if form == "gyro" else "pitch", hats[0])
    x_m = log.model.rig.disc_positions_m[:, 0]
    torque_Nm = -x_m[:, None] * log.thrust
    if form != "factor":
        plate_share = np.zeros_like(torque_Nm)
        ratio = log.height_m / log.model.rig.propulsion.radius_m
        near = 1.0 / (1.0 + ratio**2) if form == "near" else 1.0
        plate_share[COVERED_DISC] = log.logged.plate_share * near
        torque_Nm = torque_Nm * plate_share
    disc_hats = hats * len(torque_Nm) if len(hats) == 1 else hats
    torque = sum(row[:, None] * hat for row, hat in zip(torque_Nm, disc_hats, strict=True))
    return log.error_rows("torque", np.asarray(torque))


def _hat_functions(values: Array, knots: Array) -> Array:
    """Return hat functions (n, m): 1 at one knot, linear to 0 at its neighbours."""
    left = np.clip(np.searchsorted(knots, values) - 1, 0, len(knots) - 2)
    share = np.clip((values - knots[left]) / np.diff(knots)[left], 0.0, 1.0)
    hats = np.zeros((len(values), len(knots)))
    rows = np.arange(len(values))
    hats[rows, left], hats[rows, left + 1] = 1.0 - share, share
    return hats


def _list_variables(logs: Sequence[FilteredLog]) -> Iterator[tuple[Variable, list[Array]]]:
    """Yield each variable with its knots, and its values by recording (discs or 1, n)."""
    angle = [log.values("angle")[None] for log in logs]
    rate = [log.rate[None] for log in logs]
    speed = [log.speed for log in logs]
    load = [log.thrust.sum(axis=0)[None] for log in logs]
    time = [np.arange(len(log.logged))[None] / log.logged.rate_Hz for log in logs]
    radius_m = logs[0].model.rig.propulsion.radius_m
    height = [
        np.where(log.logged.plate_share > 0.0, log.height_m / radius_m, np.nan)[None]
        for log in logs
    ]
    speed_change = [np.gradient(log.speed, axis=1) * log.logged.rate_Hz for log in logs]
    discs = range(logs[0].logged.n_discs)
    total = " + ".join(f"flow.thrust_N[{disc}]" for disc in discs)
    table: tuple[tuple[str, str, str, str, Scale, list[Array], float, tuple[str, ...]], ...] = (
        ("the angle", "angle/ref", "flow.pitch_rad / p.reference", "rad", "signed", angle,
         _max_abs(angle), ("torque", "near", "gyro", "encoder")),
        ("the rate", "rate/ref", "flow.rate_rad_s / p.reference", "rad/s", "signed", rate,
         _max_abs(rate), ("torque", "near", "encoder")),
        ("rotor speed", "w/w_ref", "flow.speed_rad_s[i] / p.reference", "rad/s", "positive", speed,
         _median(speed), ("factor", "near")),
        ("the thrust of all rotors", "T/T_ref", f"({total}) / p.reference", "N", "positive", load,
         _median(load), ("torque",)),
        ("time since the run began", "t/t_ref", "flow.time_s / p.reference", "s", "time", time,
         _max_abs(time), ("torque", "factor", "near", "gyro")),
        ("plate distance", "z/R", DISTANCE, "1", "distance", height, 1.0, ("covered",)),
        ("how quickly a rotor's speed changes", "dw/dt", "", "rad/s^2", "signed", speed_change,
         _max_abs(speed_change), ("factor",)),
    )  # fmt: skip
    for phrase, symbol, code, unit, scale, values, reference, forms in table:
        ratios = [series / reference for series in values]
        knots = _place_knots(np.concatenate([series.ravel() for series in ratios]))
        yield Variable(phrase, symbol, knots, code, reference, unit, scale, forms), ratios


def _max_abs(values: Sequence[Array]) -> float:
    return max(float(np.nanmax(np.abs(series))) for series in values) or 1.0


def _median(values: Sequence[Array]) -> float:
    return float(np.median(np.concatenate([series.ravel() for series in values]))) or 1.0


def _build_form(name: str, logs: Sequence[FilteredLog], m: int) -> LawForm:
    """Return the form of a law of m knots; its columns are of functions of unit size."""
    rig, limits = logs[0].model.rig, logs[0].model.discrepancy
    flat = np.ones(m)
    if name == "torque":
        arms_m = np.abs(rig.disc_positions_m[:, 0])
        torque = _median([arms_m @ log.thrust for log in logs])
        return LawForm(
            name=name, hook="torque", weights=TYPICAL * torque * flat, formula="{f}", unit="N m",
            code="p.a * p.typical * {f}", tolerance=TORQUE * limits.torque * torque, bench="pitch",
            quantity=f"{TYPICAL * torque:.2g} N m",
        )  # fmt: skip
    if name == "gyro":
        typical = _median([np.array([np.std(log.rate)]) for log in logs])
        return LawForm(
            name=name, hook="gyro_reading", weights=typical * flat, formula="reading + {f}",
            code="reading + p.a * p.typical * {f}", tolerance=limits.gyro * typical, unit="rad/s",
            bench="pitch", phrase=", in the gyro's reading", quantity=f"{typical:.2g} rad/s",
        )  # fmt: skip
    if name == "encoder":
        typical = _median([np.array([np.std(log.values("angle"))]) for log in logs])
        return LawForm(
            name=name, hook="", weights=typical * flat, formula="", code="", unit="rad",
            tolerance=limits.encoder_rad, bench="pitch", phrase=", in the encoder's reading",
            quantity=f"{typical:.2g} rad",
        )  # fmt: skip
    code = {"factor": "p.a", "covered": "p.a * flow.coverage[i]", "near": f"p.a * {NEAR}"}[name]
    return LawForm(
        name=name, hook="factor", weights=flat, bench="pitch", tolerance=FACTOR, unit="1",
        formula="1 + {f} / (1 + (z/R)^2)" if name == "near" else "1 + {f}",
        code=f"1.0 + {code} * {{f}}", centred=name in ("near", "factor"),
        phrase={"factor": ", in the rotors' thrust", "near": " near the plate"}.get(name, ""),
    )  # fmt: skip
