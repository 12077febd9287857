"""What breaks its tolerance beside what has no name: one marginal likelihood decides."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchtool.core.units import Array
from benchtool.explain.engine.evidence import Discrepancy, RowGroups, ScaledParameter
from benchtool.explain.engine.hypotheses import Hypotheses
from benchtool.explain.engine.posterior import Posterior, search_models

ROWS = 200
AT = np.linspace(-1.0, 1.0, ROWS)


def names_of(made: Callable[[Array], Array]) -> list[tuple[str, ...]]:
    return [found(made, seed).best.active for seed in range(12)]


def found(made: Callable[[Array], Array], seed: int) -> Posterior:
    """Search one half of what was made; the other half is to check on."""
    every = Smooth(made, seed, np.arange(2 * ROWS) % ROWS)
    learn = Smooth(made, seed, np.arange(ROWS))
    return search_models(Hypotheses(learn), Hypotheses(every), lambda what, share: None)


def test_a_small_departure_from_every_law_is_nothing():
    assert names_of(lambda x: 0.8 * np.sin(3.0 * x)) == [()] * 12


def test_an_effect_beyond_tolerance_is_named_though_its_law_is_off():
    assert names_of(lambda x: 5.0 * x * (1.0 + 0.08 * np.sin(2.0 * x))) == [("slope",)] * 12


def test_of_two_effects_each_is_tried_beside_the_other():
    trials = found(lambda x: 6.0 * (x + np.sign(x)), 1).trials
    places = [(trial.name, trial.base.active) for trial in trials]
    assert places == [("step", ("slope",)), ("slope", ("step",))]
    assert [set(trial.log_odds) for trial in trials] == [
        {"step", "thrust: curve"},
        {"slope", "thrust: curve"},
    ]


def test_what_no_effect_describes_is_the_discrepancy():
    assert names_of(lambda x: 6.0 * np.cos(4.0 * x)) == [("thrust: curve",)] * 12


def test_noise_beyond_the_stated_one_is_found_in_the_rows():
    noisy = Smooth(lambda x: 0.0 * x, 3, np.arange(ROWS), noise=2.0)
    assert np.allclose(Hypotheses(noisy).errors.noise, 2.0, rtol=0.15)


def test_a_check_that_shows_nothing_of_it_takes_a_name_back():
    learn = Smooth(lambda x: 2.5 * x, 2, np.arange(ROWS))
    every = Smooth(lambda x: 2.5 * x, 2, np.arange(2 * ROWS) % ROWS)
    found = search_models(Hypotheses(learn), Hypotheses(every), lambda what, share: None)
    assert found.best.active == ("slope",)
    every.data[ROWS:] -= 2.5 * AT
    found = search_models(Hypotheses(learn), Hypotheses(every), lambda what, share: None)
    assert found.best.active == ()


def parameter(name: str) -> ScaledParameter:
    return ScaledParameter(name=f"{name}.x", unit="1", effect=name, start=0.0, scale=1.0)


class Smooth:
    """Rows that a slope or a step may explain, and a smooth curve that has no name."""

    parameters = (parameter("slope"), parameter("step"))

    def __init__(
        self, made: Callable[[Array], Array], seed: int, rows: Array, noise: float = 1.0
    ) -> None:
        rng = np.random.default_rng(seed)
        at = AT[rows]
        self._design = np.column_stack([at, np.where(at > 0.0, 1.0, -1.0)])
        self.data = made(at) + noise * rng.standard_normal(2 * ROWS)[: len(at)]
        pieces = np.linspace(-1.0, 1.0, 9)
        self._curve = np.exp(-0.5 * ((at[:, None] - pieces) / 0.3) ** 2)

    def residuals(self, scaled: Array) -> Array:
        """Return data minus prediction."""
        rows: Array = self.data[:, None] - self._design @ scaled.T
        return rows

    def discrepancies(self) -> tuple[Discrepancy, ...]:
        """Return the curve."""
        return (
            Discrepancy(
                name="thrust: curve", columns=0.3 * self._curve, shares=self._curve
            ),
        )  # fmt: skip

    def varied(self, changes: Array) -> Array:
        """Return a tenth of what an effect does, smoothly."""
        return 0.1 * changes[:, None] * self._curve

    def groups(self) -> RowGroups:
        """Return one stage."""
        return RowGroups(stages={"rpm_to_thrust": np.ones(len(self.data), bool)}, regimes={})
