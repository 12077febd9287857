"""Which kind of verdict a search comes to, from how likely each explanation of a place is."""

from __future__ import annotations

from dataclasses import replace
from math import log
from types import MappingProxyType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchtool.explain.engine import posterior
from benchtool.explain.engine.hypotheses import SMALL, Hypothesis
from benchtool.explain.engine.judgement import Trial
from benchtool.explain.engine.posterior import (
    Posterior,
    _decided,
    _inseparable,
    _nearest,
    _pruned,
    _trial,
    _unnamed,
    _weights,
    _with_check,
    _with_law,
    prior,
    search_models,
)
from benchtool.explain.engine.shared_errors import AMPLITUDES
from benchtool.explain.engine.verdict import UnnamedEffect
from benchtool.fit.identifiability import UNDETERMINED_HINT

EFFECTS = {"slope": "rpm_to_thrust", "step": "rpm_to_thrust", "lag": "pwm_to_rpm"}
"""Effects and their stages."""


def opening(*names: str) -> Hypothesis:
    at = np.zeros(1)
    return Hypothesis(
        active=names, values=at, linearisation_point=at, cost=0.0, converged=True, amplitudes={}
    )


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
    discrepancies = MappingProxyType({
        "curve": SimpleNamespace(
            stage="sensor", phrase="a curve", shares=np.array([[0.0, 0.0], [0.3, 0.4], [0.6, 0.8]])
        ),
        "wave": SimpleNamespace(
            stage="rpm_to_thrust", phrase="a wave", shares=np.array([[0.5 * SMALL], [0.0], [0.0]])
        ),
    })  # fmt: skip

    def __init__(
        self, against: float = 1e9, shown: float = 1.0, size: float = 1.0, other_law: float = 0.0
    ) -> None:
        self._against, self._shown = against, shown
        self._size, self._other_law = size, other_law

    def size(self, one: Hypothesis) -> float:
        return self._size

    def by_other_law(self, one: Hypothesis) -> float:
        return self.log_evidence(one) + self._other_law

    def estimate_discrepancy(self, one: Hypothesis, name: str) -> tuple[Any, Any]:
        return {
            "curve": (np.array([3.0, 4.0]), np.array([0.0, -3.6, 3.2])),
            "wave": (np.array([6.0]), np.array([2.8, 0.0, 0.0])),
        }[name]

    def contribution(self, best: Hypothesis, names: list[str]) -> Any:
        return np.array([self._shown * len(names)])

    def evidence_against(self, truth: Hypothesis, name: str) -> float:
        assert truth.active[-1] == "slope"
        assert name in EFFECTS
        return self._against

    def log_evidence(self, one: Hypothesis) -> float:
        return {"slope": 3.0, "step": 9.0}.get("".join(one.active[:1]), 0.0) * len(one.active)

    def settled(self, one: Hypothesis) -> Hypothesis:
        return one

    def fitted(self, names: tuple[str, ...], at: Any) -> Hypothesis:
        return opening(*names)

    def without(self, one: Hypothesis, name: str) -> Hypothesis:
        return opening(*(each for each in one.active if each != name))


def unnamed(weight: float, stage: str = "rpm_to_thrust", tolerances: float = 2.0) -> UnnamedEffect:
    return UnnamedEffect(
        name="curve", stage=stage, phrase="a curve", probability=0.9, share=0.1,
        tolerances=tolerances, weight=weight,
    )  # fmt: skip


SURE = place(slope=1e6, step=1.0)
RIVAL = place(slope=1e6, step=2e5)
LAG = place(lag=1e9)
BESIDE = replace(RIVAL, tried=tuple(opening("curve", *one.active) for one in RIVAL.tried))


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
        (search(RIVAL), [], UNDETERMINED_HINT - 1.0, "class", [(0, "slope"), (0, "step")]),
        (search(BESIDE), [], UNDETERMINED_HINT - 1.0, "class", [(0, "slope"), (0, "step")]),
        (search(RIVAL), [], UNDETERMINED_HINT, "effect", [(0, "slope")]),
        (search(SURE), [], UNDETERMINED_HINT - 1.0, "effect", [(0, "slope")]),
        (search(place(slope=1e6, curve=2e5)), [], 0.0, "effect", [(0, "slope")]),
        # A rival has a twentieth of what all effects of the place have together.
        (search(place(slope=6.0, curve=5.0, step=0.33)), [], 0.0, "class",
         [(0, "slope"), (0, "step")]),
        (search(place(slope=6.0, curve=5.0, step=0.30)), [], 0.0, "effect", [(0, "slope")]),
    ],
)  # fmt: skip
def test_the_kind_of_a_verdict(found, left, against, kind, members):
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
def test_an_effect_and_a_discrepancy_that_may_each_be_all_there_is(found, names):
    both = _inseparable(Made(), found)
    assert (both and (both[1].active[0], both[2].active[0])) == names


def test_what_has_no_name_is_described_where_it_acts():
    found = search(place(curve=9.0, slope=1.0), SURE, place(wave=4.0), best=())
    assert _unnamed(Made(), found) == []
    wave, curve = _unnamed(Made(), replace(found, best=opening("curve", "slope", "wave")))
    assert (wave.name, wave.stage, wave.phrase) == ("wave", "rpm_to_thrust", "a wave")
    assert (wave.share, wave.tolerances, wave.weight) == (2.8, pytest.approx(5.6), 36.0)
    # As large as it becomes anywhere, against what is usual at that reading.
    assert (curve.name, curve.share, curve.weight) == ("curve", 3.6, 25.0)
    assert curve.tolerances == pytest.approx(7.2 * SMALL)
    assert (curve.probability, wave.probability) == pytest.approx((10.0 / 11.0, 0.8))


MODEL = SimpleNamespace(
    model=SimpleNamespace(
        effects=[SimpleNamespace(name=name, subsystem=where) for name, where in EFFECTS.items()]
    )
)


@pytest.mark.parametrize(
    ("found", "left", "kind", "members", "shown", "unknown", "beside"),
    [
        (search(place(slope=0.1), best=()), 2.0, "none", [], (), 0.0, []),
        (search(place(slope=0.1), best=()), 2.1, "unknown", [], (), 0.95, []),
        (search(SURE), 1.5, "effect", [(0, "slope")], ("slope",), 0.0, []),
        # Much is left on the check recordings beside what is named; then most of it is.
        (search(SURE), 1.6, "class", [(0, "slope")], ("slope",), 0.1, []),
        (search(SURE), 2.1, "unknown", [], ("slope",), 0.95, [("slope", 1.0)]),
        (search(place(slope=50.0, curve=40.0)), 1.0, "class", [(0, "slope")], ("slope",),
         40.0 / 91.0, []),
        (search(place(curve=9.0, slope=1.5)), 1.0, "unknown", [], ("slope",), 9.0 / 11.5, []),
        (search(place(curve=9.0, slope=0.5)), 1.0, "unknown", [], (), 9.0 / 10.5, []),
        (search(place(wave=4.0), LAG, SURE), 1.0, "unknown", [], ("slope",), 0.8, [("lag", 1.0)]),
        # A sensor's error leaves the name alone, and is no part of what is predicted.
        (search(place(curve=9.0), SURE), 1.0, "effect", [(1, "slope")], ("slope",), 0.0, []),
    ],
)  # fmt: skip
def test_what_is_shown_of_a_search(monkeypatch, found, left, kind, members, shown, unknown, beside):
    held = SimpleNamespace(left=(left, left))
    monkeypatch.setattr(posterior, "Hypotheses", lambda evidence: None)
    monkeypatch.setattr(posterior, "search_models", lambda hypotheses, held_out, progress: found)
    monkeypatch.setattr(posterior, "ValidationScore", SimpleNamespace(of=lambda *given: held))
    subject = SimpleNamespace(evidence=MODEL, all_evidence=None, free_law="")
    shares: list[float] = []
    said = posterior.judge(subject, Made(), None, 1, lambda what, share: shares.append(share))
    assert all(0.5 < share < 1.0 for share in shares)
    assert (said.kind, said.members, said.shown.active) == (kind, members, shown)
    assert said.unknown == pytest.approx(unknown, abs=1e-5)
    assert [name for name, _ in said.beside] == [name for name, _ in beside]
    assert dict(said.beside) == pytest.approx(dict(beside), abs=1e-5)
    assert [sum(one.values()) for one in said.weights] == pytest.approx([1.0] * len(found.trials))
    assert [one.name for one in said.unnamed] == [
        name for name in ("wave", "curve") if any(name in each.log_odds for each in found.trials)
        and (name in found.best.opened or kind == "class")
    ]  # fmt: skip


def test_effects_that_contend_are_tried_with_a_law_that_is_off():
    base = opening()
    evidence = {(): 2.0, ("slope",): 30.0, ("curve",): 29.0, ("lag",): 25.0, ("step",): 18.0}
    tried = [opening(*names) for names in list(evidence)[1:]]
    tried[1] = replace(tried[1], amplitudes={"curve": 3.0}, cost=5.0, values=np.ones(1))
    tried[3] = replace(tried[3], cost=5.0, values=np.ones(1))
    with_law, secured = [], []

    def with_laws(likely: list[Hypothesis]) -> list[Hypothesis]:
        with_law.extend(one.active[-1] for one in likely)
        return [replace(one, amplitudes={"law": 1.0}) for one in likely]

    def refitted(base: Hypothesis, others: list[Hypothesis]) -> Hypothesis:
        secured.extend(one.active[-1] for one in others)
        return base

    def gained(one: Hypothesis) -> float:
        return {"slope": -1.0, "lag": 9.0}[one.active[-1]] if "law" in one.amplitudes else 0.0

    made = SimpleNamespace(
        effects=EFFECTS, discrepancies=Made.discrepancies, with_one_more=lambda base: tried,
        secured=refitted, with_laws=with_laws,
        log_evidence=lambda one: evidence[one.opened] + gained(one),
    )  # fmt: skip
    trial = _trial(made, base)
    assert (with_law, secured) == (["slope", "lag"], ["slope", "lag"])
    assert trial.log_odds == pytest.approx(
        {name: by + prior(made, name) for name, by in
         {"slope": 28.0, "curve": 27.0, "lag": 32.0, "step": 16.0}.items()}
    )  # fmt: skip
    assert [one.active[-1] for one in trial.tried] == ["lag", "slope", "curve", "step"]
    assert [one.amplitudes for one in trial.tried] == [{"law": 1.0}, {}, {"curve": 3.0}, {}]
    # A candidate above its base is the base; one beside a wider discrepancy may be above it.
    assert [float(one.values[0]) for one in trial.tried] == [0.0, 0.0, 1.0, 0.0]


@pytest.mark.parametrize(
    ("size", "ahead", "free_law", "unknown"),
    [
        (3.9, 9.0, "", 0.0),
        (4.0, -4.7, "", 0.0),
        # Less than decisive evidence does not count, and what is ahead does.
        (4.0, -4.5, "", 0.5),
        (4.0, log(9.0), "", 0.9),
        (1.0, -4.5, "k and R_m are free", 0.5),
    ],
)
def test_a_large_effect_competes_with_one_like_it_by_another_law(size, ahead, free_law, unknown):
    made = Made(size=size, other_law=ahead)
    subject = SimpleNamespace(evidence=MODEL, free_law=free_law)
    trial = _with_law(subject, made, SURE)
    assert trial.name == "slope"
    assert _weights(made, trial)["unknown"] == pytest.approx(unknown, abs=1e-5)


def test_names_share_what_a_bench_is_expected_to_lack():
    assert 3.0 * np.exp(prior(Made(), "slope")) == pytest.approx(0.3)
    assert 2.0 * len(AMPLITUDES) * np.exp(prior(Made(), "curve")) == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("stage", "trial", "name"),
    [
        ("rpm_to_thrust", place(slope=9.0, lag=4.0), "slope"),
        ("rpm_to_thrust", BESIDE, "slope"),
        ("sensor", place(lag=9.0, step=4.0), "step"),
        ("pwm_to_rpm", place(slope=9.0, curve=5.0, lag=4.0), "lag"),
        ("pwm_to_rpm", place(slope=9.0, lag=0.9), None),
        ("pwm_to_rpm", place(slope=9.0, lag=1.0), None),
    ],
)
def test_the_nearest_is_the_likeliest_effect_of_that_side_of_the_speed(stage, trial, name):
    found = _nearest(SimpleNamespace(evidence=MODEL), search(trial), [unnamed(1.0, stage)])
    assert (found and found.active[-1]) == name


@pytest.mark.parametrize(("more", "left"), [(-0.5, ("slope",)), (0.5, ("step", "slope"))])
def test_members_that_later_ones_made_unnecessary_go(more, left):
    made = Made()
    # The first gains less than its prior costs, the second as much and a little more or less.
    gain = more - prior(made, "step")
    made.log_evidence = lambda one: gain * ("step" in one.active)
    assert _pruned(made, opening("lag", "step", "slope")).active == left


@pytest.mark.parametrize(
    ("before", "counted"),
    [
        ({"slope": 0.5}, ["slope"]),
        ({"slope": -0.1}, []),
        ({"slope": 8.0, "step": 0.1, "lag": -0.1}, ["slope", "step"]),
        # Not further behind than 12, and the first four.
        ({"slope": 30.0, "step": 18.1, "lag": 17.9}, ["slope", "step"]),
        ({"slope": 9.0, "curve": 8.0, "wave": 7.0, "step": 6.0, "lag": 5.0},
         ["slope", "curve", "wave", "step"]),
    ],
)  # fmt: skip
def test_contenders_count_what_they_gain_on_the_check(before, counted):
    gains = {"slope": 3.0, "step": 50.0, "curve": 4.0, "wave": 5.0, "lag": 99.0}
    held_out = SimpleNamespace(
        near_fit=lambda one: one,
        log_evidence=lambda one: 7.0 * len(one.opened) + gains.get("".join(one.opened), 2.0),
    )
    made = SimpleNamespace(log_evidence=lambda one: 7.0 * len(one.opened))
    trial = Trial(base=opening(), tried=tuple(map(opening, before)), log_odds=before)
    after = _with_check(made, held_out, trial)
    want = {name: odds + (name in counted) * (gains[name] - 2.0) for name, odds in before.items()}
    assert after.log_odds == pytest.approx(want)
    assert [one.active[0] for one in after.tried] == sorted(want, key=lambda name: -want[name])


@pytest.mark.parametrize(
    ("places", "opened"),
    [
        ({(): ("step", -0.1)}, ()),
        ({(): ("step", 0.5), ("step",): ("slope", -0.1)}, ("step",)),
        ({(): ("step", 5.0), ("step",): ("slope", 0.5), ("step", "slope"): ("lag", -0.1),
          ("slope",): ("step", 0.5)}, ("step", "slope")),
        # What the others have made unlikely goes again.
        ({(): ("step", 5.0), ("step",): ("slope", 0.5), ("step", "slope"): ("lag", -0.1),
          ("slope",): ("step", -0.1)}, ("step",)),
    ],
)  # fmt: skip
def test_names_are_opened_while_they_are_likelier_than_not(monkeypatch, places, opened):
    def tried(hypotheses: Any, base: Hypothesis) -> Trial:
        name, odds = places[base.active]
        return Trial(base=base, tried=(opening(*base.active, name),), log_odds={name: odds})

    made = Made()
    made.null, made.near_fit = opening, lambda one: one
    monkeypatch.setattr(posterior, "_trial", tried)
    shares: list[float] = []
    assert search_models(made, made, lambda what, share: shares.append(share)).best.active == opened
    assert shares == sorted(shares)
    assert 0.0 <= shares[0] < shares[-1] < 1.0
