"""Composite hypotheses and the search over them, on evidence that is linear and known."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from benchtool.core.units import Array
from benchtool.explain.engine.evidence import Discrepancy, RowGroups, ScaledParameter
from benchtool.explain.engine.explain import estimate_parameters
from benchtool.explain.engine.hypotheses import Hypotheses
from benchtool.explain.engine.posterior import Posterior, Trial, search_models
from benchtool.explain.inputs import ExplainInputs
from benchtool.physics.model import Model


def search(truth: list[float], seed: int = 1) -> Posterior:
    """Search 400 rows; 400 more are to check on."""
    learn, every = (Linear(np.array(truth), seed, rows) for rows in (400, 800))
    return search_models(Hypotheses(learn), Hypotheses(every), lambda what, share: None)


def gain(trial: Trial, name: str) -> float:
    """Return what an effect gains in the sum of squares over the base."""
    return trial.base.cost - next(one.cost for one in trial.tried if one.active[-1] == name)


def test_two_effects_are_both_named():
    found = search([4.0, 5.0, 0.0, 0.0], 3)
    assert set(found.best.active) == {"a", "b"}
    assert {trial.name for trial in found.trials} == {"a", "b"}
    rivals = next(trial for trial in found.trials if trial.name == "b")
    assert 0.8 * gain(rivals, "b") < gain(rivals, "c") < gain(rivals, "b")


def test_the_spread_is_that_of_linear_regression():
    evidence = Linear(np.array([5.0, 0.0, 0.0, 0.0]), 2)
    hypotheses = Hypotheses(evidence)
    best = hypotheses.fit(("a",), hypotheses.fit_null().values)
    sd = float(np.sqrt(hypotheses.covariance(best)[0, 0]))
    alone = 1.0 / np.sqrt(np.sum(evidence.design[:, 0] ** 2))
    assert sd == pytest.approx(alone, rel=0.15)
    assert abs(best.values[0] - 5.0) < 4.0 * sd


def test_what_such_data_say_against_a_rival_is_what_they_say_on_average():
    truth = [0.0, 5.0, 0.0, 0.0]
    expected, found = [], []
    for seed in range(20):
        hypotheses = Hypotheses(Linear(np.array(truth), seed))
        trial = search(truth, seed).trials[0]
        right = next(one for one in trial.tried if one.active == ("b",))
        expected.append(hypotheses.evidence_against(right, "c"))
        found.append(gain(trial, "b") - gain(trial, "c"))
    assert np.mean(found) == pytest.approx(np.mean(expected), rel=0.25)


def test_a_number_that_could_lie_anywhere_in_its_range_is_not_determined():
    """A share between 0 and 1 is never 0.2 with an error of a thousand."""
    blind = Linear(np.array([5.0, 0.0, 0.0, 0.0]), 3)
    blind.design[:, 1] = 1e-3 * blind.design[:, 1]
    hypotheses = Hypotheses(blind)
    item = SimpleNamespace(name="x", neutral=0.0)
    effects = [SimpleNamespace(name=name, parameters=[item]) for name in ("a", "b")]
    discrepancy = SimpleNamespace(law=0.1)
    model = cast("Model", SimpleNamespace(effects=effects, discrepancy=discrepancy))
    one = hypotheses.fit(("a", "b"), np.zeros(4))
    known, unknown = (estimate_parameters(model, hypotheses, one, name)[0] for name in "ab")
    assert known.determined
    assert known.text == f"{known.value:.4g} ± {known.std:.2g}"
    # A tenth of what the effect does, as far as a law may be off, beside what the data leave.
    alone = float(np.sqrt(hypotheses.covariance(one)[0, 0]))
    assert known.std == pytest.approx(np.hypot(alone, 0.1 * known.value))
    assert not unknown.determined
    assert (unknown.low, unknown.high) == (-50.0, 50.0)
    assert unknown.std == pytest.approx(100.0 / np.sqrt(12.0))
    assert unknown.text == "not determined (-50 to 50)"


def test_a_number_at_its_bound_is_not_determined():
    evidence = Linear(np.array([60.0, 0.0, 0.0, 0.0]), 3)
    hypotheses = Hypotheses(evidence)
    item = SimpleNamespace(name="x", neutral=0.0)
    effects = [SimpleNamespace(name="a", parameters=[item])]
    discrepancy = SimpleNamespace(law=0.0)
    model = cast("Model", SimpleNamespace(effects=effects, discrepancy=discrepancy))
    (found,) = estimate_parameters(model, hypotheses, hypotheses.fit(("a",), np.zeros(4)), "a")
    assert found.value == pytest.approx(50.0)
    assert not found.determined
    assert (found.low, found.high) == (-50.0, 50.0)


def test_what_the_data_cannot_show_is_told():
    evidence = Linear(np.array([0.0, 0.0, 0.0, 0.0]), 4)
    evidence.design[:, 0] *= 1e-3
    unseen = Hypotheses(evidence).find_unjudged(Hypotheses(evidence).fit_null())
    assert list(unseen) == ["a"]
    assert unseen["a"] > 50.0


def test_p_values_of_nothing_are_spread_out_and_of_something_small():
    rng, drawn = np.random.default_rng(0), ExplainInputs(bootstrap=60)
    hypotheses = Hypotheses(Linear(np.array([3.0, 0.0, 0.0, 0.0]), 5))
    null = hypotheses.fit_null()
    best = hypotheses.add_candidates(null)[0]
    assert hypotheses.p_value(null, best, ExplainInputs(), rng) < 1e-6
    assert hypotheses.p_value(null, best, drawn, rng) == pytest.approx(1.0 / 61.0)
    nothing = Hypotheses(Linear(np.zeros(4), 6))
    base = nothing.fit_null()
    assert nothing.p_value(base, nothing.add_candidates(base)[0], drawn, rng) > 0.1


def parameter(name: str, effect: str, *, held: bool = False) -> ScaledParameter:
    return ScaledParameter(
        name=name, unit="1", effect=effect, start=0.0, scale=1.0, lower=-50.0, upper=50.0, held=held
    )


PARAMETERS = (
    parameter("a.x", "a"),
    parameter("b.x", "b"),
    parameter("c.x", "c"),
    parameter("inertia", "", held=True),
)


@dataclass
class Linear:
    """Residuals that are linear in four parameters; c looks nearly like b."""

    truth: Array
    seed: int
    rows: int = 400
    parameters: tuple[ScaledParameter, ...] = PARAMETERS

    def __post_init__(self) -> None:
        rng = np.random.default_rng(self.seed)
        self.design = rng.standard_normal((800, 4))[: self.rows]
        self.design[:, 2] = 0.995 * self.design[:, 1] + 0.1 * self.design[:, 2]
        self.noise = rng.standard_normal(800)[: self.rows]

    def residuals(self, scaled: Array) -> Array:
        """Return data minus prediction."""
        data = self.design @ self.truth + self.noise
        rows: Array = data[:, None] - self.design @ scaled.T
        return rows

    def discrepancies(self) -> tuple[Discrepancy, ...]:
        """Return none."""
        return ()

    def varied(self, changes: Array) -> Array:
        """Return none (n_rows, 0): laws are exact."""
        return np.empty((len(changes), 0))

    def groups(self) -> RowGroups:
        """Return one stage of all rows."""
        return RowGroups(stages={"hinge": np.ones(self.rows, bool)}, regimes={})
