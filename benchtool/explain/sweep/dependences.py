"""What thrusts of sweeps may depend on: channels, states and their histories, over references."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array import Array
from benchtool.explain.engine.hypotheses import Hypotheses
from benchtool.explain.engine.shared_errors import solved
from benchtool.explain.found.law import DISTANCE, Form, Variable
from benchtool.explain.found.search import FOLDS, Fold, Missed, Says
from benchtool.explain.sweep.evidence import SweepEvidence
from benchtool.explain.sweep.log import SweepLog
from benchtool.physics.effects.effect import PAST_S

FARTHEST = 12.0  # distance over radius from which on a plate is as good as away
TOLERANCE = 0.005  # departure of thrust that does not matter, over it; assumed


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


def sweep_forms(logs: tuple[SweepLog, ...], radius_m: float, shown_N: Array) -> list[Form]:
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
        Form(
            name="factor", hook="factor", weights=thrust, formula="1 + {f}",
            code="1.0 + p.a * {f}", matters=matters,
        ),
        Form(
            name="covered", hook="factor", weights=thrust * covered, formula="1 + {f}",
            code="1.0 + p.a * flow.coverage[i] * {f}", matters=matters,
        ),
        Form(
            name="near", hook="factor", weights=thrust * covered / (1.0 + z**2),
            formula="1 + {f} / (1 + (z/R)^2)", code=f"1.0 + p.a * {near} * {{f}}",
            matters=matters, centred=True, phrase=" near the plate",
        ),
        Form(
            name="nearer", hook="factor", weights=thrust * covered * z**-3.0,
            formula="1 + {f} (z/R)^-3", code=f"1.0 + p.a * {nearer} * {{f}}",
            matters=matters, centred=True, phrase=" next to the plate",
        ),
        Form(
            name="reading", hook="thrust_reading", weights=np.full(len(thrust), middle),
            formula="reading + {f}", code="reading + p.a * p.typical * {f}", matters=matters,
        ),
    ]  # fmt: skip


def missed_thrusts(evidence: SweepEvidence, at: Array, opened: Sequence[str]) -> list[Missed]:
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
    says, bare = (_says(white.T @ solved(columns, both)) for columns in (known, slope))
    radius_m = evidence.model.rig.propulsion.radius_m
    variables = sweep_variables(evidence.logs, radius_m, shown)
    forms = sweep_forms(evidence.logs, radius_m, shown)
    variance = float(np.mean(errors.variance[evidence.thrust_rows]))
    folds = list(_folds(says, bare, places_of(evidence.logs), variance))
    return [
        Missed(variable=variable, form=form, says=says, bare=bare, folds=folds)
        for variable in variables
        for form in forms
        if form.name in variable.forms
    ]


def _says(products: Array) -> Says:
    """Return what readings say, from Q and Q z (m, m + 1) of them; z Q z is left out."""
    return Says(products[:, :-1], products[:, -1], 0.0)


def _folds(says: Says, bare: Says, places: NDArray[np.intp], variance: float) -> Iterator[Fold]:
    """Give the folds, whole places of the plate each; readings of noise with that variance."""
    numbers = np.unique(places)
    part = np.random.default_rng(0).permutation(len(numbers)) % FOLDS
    for number in range(min(FOLDS, len(numbers))):
        out = np.isin(places, numbers[part == number])
        yield Fold(
            rest=says.without(out), bare_rest=bare.without(out), noise=variance * float(out.sum())
        )


def places_of(logs: tuple[SweepLog, ...]) -> NDArray[np.intp]:
    """Return the number of each thrust's place of the plate (m,), alike in all sweeps."""
    c = [log.conditions for log in logs]
    places = np.concatenate([np.stack([one.plate_z_m, one.plate_x_m]) for one in c], axis=1)
    return np.unique(np.round(places, 3), axis=1, return_inverse=True)[1].reshape(-1)
