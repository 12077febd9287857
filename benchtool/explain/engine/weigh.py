"""From likelihoods and the held-out gap to probabilities.

Likelihoods are tempered: a law that is a few per cent off in shape makes their ratios look sharper
than they are. Whether anything that was named explains the recording is judged by the gap on the
check recording, not by likelihood; what is left over is the probability of "unknown".
"""

from __future__ import annotations

from collections.abc import Mapping
from math import exp, log

from benchtool.explain.engine.search import ENOUGH

TEMPERATURE = 2.0
"""Divides differences of log-likelihood, where a bench names no other; chosen on 137 development
records of pitch benches. Log and Brier score were best between 1.25 and 1.75, and worse at 3; an
error on this side only asks for one more experiment."""

REFUSED_AT = 1.35
"""Held-out error after the fix over the upper noise quantile at which "unknown" is as likely as
what was named."""

SHARPNESS = 15.0
"""How quickly the probability of "unknown" grows with the logarithm of that ratio."""


LEFTOVER_SHARPNESS = 30.0
"""The same with the variance of the residuals that are left, beyond what the subject allows."""

CLOSED_SHARPNESS = 30.0
"""How quickly that probability falls with the share of the gap that is closed, past what is enough
on the subject's bench."""


def weighed(
    gains: Mapping[str, float],
    dispersion: float,
    best_is_noise: float,
    null_is_noise: float,
    temperature: float = TEMPERATURE,
) -> dict[str, float]:
    """Return probabilities of every effect for one place, of "none" and of "unknown"; sum 1.

    Args:
        gains: what each effect gains in the sum of squares over the base.
        dispersion: variance of the residuals over that of the stated noise.
        best_is_noise, null_is_noise: `accepted` of the best hypothesis and of the null.
        temperature: divides differences of log-likelihood.
    """
    scale = 2.0 * temperature * dispersion
    weights = {name: (gain - ENOUGH * dispersion) / scale for name, gain in gains.items()}
    top = max([0.0, *weights.values()])
    nothing = exp(max(-ENOUGH * dispersion / scale - top, -700.0))  # an effect that gains nothing
    parts = {
        name: max(exp(max(weight - top, -700.0)) - nothing, 0.0) for name, weight in weights.items()
    }
    none = exp(max(-top, -700.0))
    total = none + sum(parts.values())
    named = {name: part / total * best_is_noise for name, part in parts.items()}
    none *= null_is_noise / total
    unknown = min(1.0, max(0.0, 1.0 - none - sum(named.values())))
    return {**named, "none": none, "unknown": unknown}


def accepted(ratio: float, leftover: float, closed: float = 0.0) -> float:
    """Return the probability that what a hypothesis leaves is noise.

    Args:
        ratio: held-out error over the upper noise quantile, in the worst channel.
        leftover: variance of the whitened residuals of the worst stage, over what a bench with
            nothing but small imperfections may show.
        closed: share of the gap that it closes, over the share that is enough on this bench
            whatever is left; 1 and more: the gap is this effect's, its law a little off.
    """
    gap = SHARPNESS * (log(max(ratio, 1e-6)) - log(REFUSED_AT))
    gap = min(gap, CLOSED_SHARPNESS * (1.0 - closed))
    rest = LEFTOVER_SHARPNESS * (leftover - 1.0)
    return 1.0 / ((1.0 + exp(min(gap, 300.0))) * (1.0 + exp(min(rest, 300.0))))
