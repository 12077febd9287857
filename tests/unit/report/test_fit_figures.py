"""The figures of a fit: what is drawn is what the fit found."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.report.fit.residuals import expected_runs, judge_runs, runs_of_sign


def test_runs_are_counted_and_judged():
    values = np.array([1.0, 2.0, -1.0, -2.0, -3.0, 0.5])
    assert runs_of_sign(values).tolist() == [2, -3, 1]
    # Three above, three below: 1 + 2*3*3/6 and 18 (18 - 6) / (36 * 5).
    assert expected_runs(values) == pytest.approx((4.0, np.sqrt(1.2)))
    assert judge_runs(3, 4.0, np.sqrt(1.2)) == "as independent residuals show"
    few = np.repeat([1.0, -1.0], 20)
    assert judge_runs(2, *expected_runs(few)).startswith("too few")
    assert judge_runs(40, *expected_runs(few)).startswith("too many")
    assert judge_runs(1, *expected_runs(np.ones(5))) == "as independent residuals show"
    assert runs_of_sign(np.empty(0)).tolist() == []


def test_the_expected_runs_are_those_of_independent_signs(rng):
    signs = np.repeat([1.0, -1.0], [12, 18])
    counts = [len(runs_of_sign(rng.permutation(signs))) for _ in range(400)]
    mean, sd = expected_runs(signs)
    assert np.mean(counts) == pytest.approx(mean, abs=4.0 * sd / 20.0)
    assert np.std(counts) == pytest.approx(sd, rel=0.15)
