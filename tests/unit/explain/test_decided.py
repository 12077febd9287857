"""Which kind of verdict a search comes to, from how likely each explanation of a place is."""

from __future__ import annotations

from math import log
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchtool.explain.engine.hypotheses import Hypothesis
from benchtool.explain.engine.judgement import Trial
from benchtool.explain.engine.posterior import (
    Posterior,
    _decided,
    _inseparable,
    _nearest,
    _pruned,
    _refused,
    _weights,
    prior,
    probabilities,
)
from benchtool.explain.engine.shared_errors import AMPLITUDES
from benchtool.explain.engine.verdict import Unnamed
from benchtool.fit.identifiability import CANNOT_TELL

EFFECTS = {"slope": "rpm_to_thrust", "step": "rpm_to_thrust", "lag": "pwm_to_rpm"}
"""Effects and their stages."""


def opening(*names: str) -> Hypothesis:
    at = np.zeros(1)
    return Hypothesis(opened=names, at=at, about=at, cost=0.0, converged=True, widened={})


def place(**odds: float) -> Trial:
    """Return a place with names as so much likelier than nothing, the likeliest first."""
    ordered = sorted(odds, key=lambda name: -odds[name])
    return Trial(
        base=opening(),
        tried=tuple(opening(name) for name in ordered),
        log_odds={name: log(odds[name]) for name in ordered},
    )


def search(*trials: Trial, best: tuple[str, ...] | None = None) -> Posterior:
    names = tuple(trial.name for trial in trials) if best is None else best
    return Posterior(null=opening(), best=opening(*names), trials=trials)


class Made:
    """Hypotheses of which is known what they would say."""

    effects = tuple(EFFECTS)
    discrepancies = ("curve", "wave")

    def __init__(self, against: float = 1e9, shown: float = 1.0) -> None:
        self._against, self._shown = against, shown

    def contribution(self, best: Hypothesis, names: list[str]) -> Any:
        return np.array([self._shown * len(names)])

    def evidence_against(self, truth: Hypothesis, name: str) -> float:
        assert truth.opened == ("slope",)
        return self._against

    def log_evidence(self, one: Hypothesis) -> float:
        return {"slope": 3.0, "step": 9.0}.get(one.opened[0], 0.0) * len(one.opened)

    def without(self, one: Hypothesis, name: str) -> Hypothesis:
        return opening(*(each for each in one.opened if each != name))


def unnamed(weight: float, stage: str = "rpm_to_thrust", tolerances: float = 2.0) -> Unnamed:
    return Unnamed(
        name="curve", stage=stage, phrase="a curve", probability=0.9, share=0.1,
        tolerances=tolerances, weight=weight,
    )  # fmt: skip


SURE = place(slope=1e6, step=1.0)
RIVAL = place(slope=1e6, step=2e5)
LAG = place(lag=1e9)


@pytest.mark.parametrize(
    ("found", "left", "against", "kind", "members"),
    [
        (search(place(slope=0.1), best=()), [], 1e9, "none", []),
        (search(place(slope=0.1), best=()), [unnamed(1.0)], 1e9, "unknown", []),
        (search(place(slope=0.1), best=()), [unnamed(1.0, tolerances=1.0)], 1e9, "none", []),
        (search(place(curve=9.0)), [unnamed(1.0)], 1e9, "unknown", []),
        (search(SURE), [], 1e9, "effect", [(0, "slope")]),
        (search(place(curve=9.0), SURE), [], 1e9, "effect", [(1, "slope")]),
        # What has no name goes first from a fifth of the squares of what is named.
        (search(SURE), [unnamed(0.21)], 1e9, "unknown", []),
        (search(SURE), [unnamed(0.2)], 1e9, "effect", [(0, "slope")]),
        (search(SURE), [unnamed(0.11), unnamed(0.1)], 1e9, "unknown", []),
        (search(SURE), [unnamed(9.0, tolerances=1.0)], 1e9, "effect", [(0, "slope")]),
        (search(SURE), [unnamed(9.0, "sensor"), unnamed(9.0, "pwm_to_rpm")], 1e9, "effect",
         [(0, "slope")]),
        (search(SURE, LAG), [], 1e9, "several", [(1, "lag"), (0, "slope")]),
        # A class: likely, and such data could not be expected to tell them apart.
        (search(RIVAL), [], CANNOT_TELL - 1.0, "class", [(0, "slope"), (0, "step")]),
        (search(RIVAL), [], CANNOT_TELL, "effect", [(0, "slope")]),
        (search(SURE), [], CANNOT_TELL - 1.0, "effect", [(0, "slope")]),
        (search(place(slope=1e6, curve=2e5)), [], 0.0, "effect", [(0, "slope")]),
    ],
)  # fmt: skip
def test_the_kind_of_a_verdict(
    found: Posterior, left: list[Unnamed], against: float, kind: str, members: list[Any]
) -> None:
    assert _decided(Made(against), found, left) == (kind, members)


@pytest.mark.parametrize(
    ("found", "names"),
    [
        (search(place(slope=50.0, curve=40.0)), ("slope", "curve")),
        (search(place(curve=50.0, wave=45.0, step=40.0)), ("step", "curve")),
        (search(place(slope=100.0, curve=10.0)), None),
        (search(place(slope=100.0, step=90.0)), None),
        (search(place(slope=50.0, curve=40.0), best=()), None),
        (search(place(slope=50.0, curve=40.0), LAG), None),
    ],
)
def test_an_effect_and_a_discrepancy_that_may_each_be_all_there_is(
    found: Posterior, names: tuple[str, str] | None
) -> None:
    both = _inseparable(Made(), found)
    assert (both and (both[0].opened[0], both[1].opened[0])) == names


def test_probabilities_are_those_of_the_odds() -> None:
    trial = place(slope=6.0, step=2.0, curve=1.0)
    assert probabilities(trial) == pytest.approx(
        {"slope": 0.6, "step": 0.2, "curve": 0.1, "none": 0.1}
    )
    assert probabilities(place(slope=0.25)) == pytest.approx({"slope": 0.2, "none": 0.8})
    assert probabilities(Trial(base=opening(), tried=(), log_odds={"slope": -9e3}))["none"] == 1.0
    assert _weights(Made(), trial) == pytest.approx(
        {"slope": 0.6, "step": 0.2, "none": 0.1, "unknown": 0.1}
    )


def test_what_larger_things_are_left_of_keeps_a_twentieth() -> None:
    left = _refused({"slope": 0.6, "none": 0.1, "unknown": 0.3})
    assert left == pytest.approx({"slope": 0.03, "none": 0.005, "unknown": 0.965})


def test_names_share_what_a_bench_is_expected_to_lack() -> None:
    assert 3.0 * np.exp(prior(Made(), "slope")) == pytest.approx(0.3)
    assert 2.0 * len(AMPLITUDES) * np.exp(prior(Made(), "curve")) == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("stage", "trial", "name"),
    [
        ("rpm_to_thrust", place(slope=9.0, lag=4.0), "slope"),
        ("sensor", place(lag=9.0, step=4.0), "step"),
        ("pwm_to_rpm", place(slope=9.0, curve=5.0, lag=4.0), "lag"),
        ("pwm_to_rpm", place(slope=9.0, lag=0.9), None),
        ("pwm_to_rpm", place(slope=9.0, lag=1.0), None),
    ],
)
def test_the_nearest_is_the_likeliest_effect_of_that_side_of_the_speed(
    stage: str, trial: Trial, name: str | None
) -> None:
    effects = [SimpleNamespace(name=name, subsystem=where) for name, where in EFFECTS.items()]
    model = SimpleNamespace(model=SimpleNamespace(effects=effects))
    found = _nearest(SimpleNamespace(evidence=model), search(trial), [unnamed(1.0, stage)])
    assert (found and found.opened[-1]) == name


def test_members_that_later_ones_made_unnecessary_go() -> None:
    # The first gains less than its prior costs, the second more.
    assert _pruned(Made(), opening("lag", "step", "slope")).opened == ("step", "slope")
    assert _pruned(Made(), opening("step", "slope")).opened == ("step", "slope")
