"""Readings that miss a law of rotor speed, made in memory."""

from __future__ import annotations

import numpy as np

from benchtool.explain.law_search import (
    FOLDS,
    CrossValidationFold,
    QuadraticSummary,
    ResidualSummary,
)
from benchtool.explain.laws import DISTANCE, LawForm, Variable

NOISE_N = 0.004

SPEED = "flow.speed_rad_s[i] / p.reference"
PLACES = np.repeat(np.arange(30), 5)


def shown(law: np.ndarray, rng: np.random.Generator, speed: np.ndarray) -> list[ResidualSummary]:
    """Return 150 thrusts of 3 N that miss a law of rotor speed, which no nuisance takes up."""
    n = len(speed)
    thrust = np.full(n, 3.0)
    level, other = np.ones((n, 1)), rng.uniform(0.6, 4.0, n)
    covariance = np.diag(np.full(n, NOISE_N**2)) + 1.0 * level @ level.T
    precision = np.linalg.inv(covariance)
    says = QuadraticSummary(
        precision, precision @ (thrust * law + NOISE_N * rng.standard_normal(n)), 0.0
    )
    outs = [fold == PLACES % FOLDS for fold in range(FOLDS)]
    rests = [says.without(out) for out in outs]
    form = LawForm(
        name="factor", hook="factor", weights=thrust, formula="1 + {f}", code="1.0 + p.a * {f}",
        tolerance=0.015,
    )  # fmt: skip
    time = np.arange(n) / n
    return [
        ResidualSummary(
            variable=variable, form=form, quadratic=says, bare_quadratic=says,
            folds=[
                CrossValidationFold(training=rest, bare_training=rest, noise=float(out.sum()))
                for rest, out in zip(rests, outs, strict=True)
            ],
        )
        for variable in (
            Variable(phrase="rotor speed", symbol="w/w_ref", code=SPEED, reference=500.0,
                     unit="rad/s", values=speed),
            Variable(phrase="plate distance", symbol="z/R", code=DISTANCE, values=other),
            Variable(phrase="time", symbol="t", code="flow.time_s", values=time, scale="time"),
            Variable(phrase="the visit", symbol="visit", values=PLACES.astype(float),
                     is_categorical=True),
        )
    ]  # fmt: skip


LAWS = {
    "line": lambda u: 0.04 * (u - 1.0) / 0.2,
    "power": lambda u: 0.02 * u**-4.0,
    "step": lambda u: 0.03 / (1.0 + np.exp(-(u - 0.95) / 0.01)),
    "saturation": lambda u: -0.3 * np.maximum(u - 1.1, 0.0),
    "resonance": lambda u: -0.04 / (1.0 + ((u - 0.93) / 0.05) ** 2),
}
