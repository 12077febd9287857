"""How often a likelihood ratio as large as the one found comes about when nothing is missing."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from benchtool.explain.engine.hypotheses import Hypotheses, Hypothesis


def p_value(
    hypotheses: Hypotheses,
    base: Hypothesis,
    one: Hypothesis,
    bootstrap: int,
    rng: np.random.Generator,
) -> float:
    """Return the p-value of a candidate's gain over its base, for the largest of all candidates.

    Asymptotic: a chi-squared law of as many degrees of freedom as the effect has numbers, the gain
    divided by the dispersion, times the number of candidates (Bonferroni); the tolerance makes it
    conservative. With `bootstrap` draws it is counted: white residuals are drawn about the base,
    and every candidate is fitted to each by the base's own neighbourhood.
    """
    gain = (base.cost - one.cost) / hypotheses.dispersion(one)
    name = one.opened[-1]
    numbers = sum(knob.effect == name for knob in hypotheses.evidence.knobs)
    if bootstrap <= 0:
        return float(min(1.0, len(hypotheses.effects) * chi2.sf(max(gain, 0.0), numbers)))
    drawn = hypotheses.null_gains(base, bootstrap, rng)
    return float((1 + np.sum(drawn >= gain)) / (bootstrap + 1))
