"""Expected log evidence ratios of an experiment between candidates.

Each rival predicts the readings of an experiment from its own numbers and from how uncertain the
recordings so far leave them: a Gaussian whose covariance has the noise, what rows share, and the
discrepancies of all recordings together. The log evidence ratio of one rival over another that the
experiment is expected to bring, were the first one true, is the divergence between two of these
(Kullback and Leibler, Ann. Math. Stat. 22, 1951).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import exp, inf, log, sqrt
from typing import TypeVar

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.schedule import Schedule
from benchtool.explain.engine.evidence import Evidence
from benchtool.explain.engine.hypotheses import Hypotheses, Hypothesis
from benchtool.explain.engine.judgement import CLASS_FROM, CandidateEffect, Judgement
from benchtool.explain.engine.posterior import probabilities
from benchtool.explain.engine.verdict import DECISION_PROBABILITY, NextExperiment
from benchtool.fit.bounded_least_squares import BoundedRegion, Linearisation, slopes
from benchtool.physics.effects.effect import Subsystem

NONE = "nothing beyond tolerance"

ESC_MODE = (  # for what is unknown between pulse and speed
    "speed at a pulse answers to the pulse, the plate and the supply, which pulses near and far "
    "separate; write down the ESC's mode as well: governed, it holds the speed against plate and "
    "supply; else it sets a voltage, and the speed gives"
)

MAX_CANDIDATES = 6  # so many explanations an experiment is designed for at most
MIN_PROBABILITY = 0.01  # what a rival counts as at least, once it is one
CLEAR = 0.01  # prospect confusion at which nothing more is added to a design; assumed
WORTH = 0.01  # least decrease of the log of the expected confusion; assumed
DRAWS = 64  # simulated experiments behind what is stated of the chosen one
SHOWN = 100.0  # a larger expected log evidence ratio is not stated: it rests on few draws far out
MIN_DURATION_S = 20.0  # time that an addition counts as at least; assumed


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CandidatePrediction:
    """Prediction of new rows by one candidate: mean + slopes u, u of a known precision."""

    mean: Array  # (n,) over the noise
    slopes: Array  # (n, q)
    known: Array  # (q, q) precision of u, from the recordings so far
    room: tuple[Array, Array]  # how far the first of u may go, down and up: what bounds leave

    def drawn(self, count: int, rng: np.random.Generator) -> Array:
        """Return rows (n, count) as they may come out, were this rival true."""
        u = np.linalg.solve(
            np.linalg.cholesky(self.known).T, rng.standard_normal((len(self.known), count))
        )
        free = len(self.room[0])
        u[:free] = np.clip(u[:free], *(side[:, None] for side in self.room))
        noise = rng.standard_normal((len(self.mean), count))
        return np.asarray(self.mean[:, None] + self.slopes @ u + noise, float)

    def gains(self, rows: Array) -> Array:
        """Return the log evidence (count,) that rows (n, count) add, less what all rivals share."""
        free = len(self.room[0])
        missed = rows - self.mean[:, None]
        after, seen = self.known + self.slopes.T @ self.slopes, self.slopes.T @ missed
        taken = np.linalg.solve(
            after[free:, free:], np.column_stack([seen, after[:, :free]])[free:]
        )
        curvature = after[:free, :free] - after[:free, free:] @ taken[:, rows.shape[1] :]
        gradient = after[:free, free:] @ taken[:, : rows.shape[1]] - seen[:free]
        cost = np.sum(missed**2, axis=0) - np.sum(seen[free:] * taken[:, : rows.shape[1]], axis=0)
        at, within = (
            np.zeros(free),
            BoundedRegion(lower=self.room[0], upper=self.room[1], penalty=np.zeros(free)),
        )
        costs = [
            Linearisation(at, constant, slope, curvature).step(within)[1]
            for constant, slope in zip(cost, gradient.T, strict=True)
        ]
        return -0.5 * np.array(costs) - 0.5 * self._log_determinant(self.slopes.T @ self.slopes)

    def over(self, other: CandidatePrediction, rng: np.random.Generator | None) -> float:
        """Return the expected log evidence ratio over another one, were this one true."""
        if rng is None:
            return self._divergence(other)
        rows = self.drawn(DRAWS, rng)
        return float(np.mean(self.gains(rows) - other.gains(rows)))

    def _divergence(self, other: CandidatePrediction) -> float:
        missed, a, b = self.mean - other.mean, self.slopes, other.slopes
        after = other.known + b.T @ b
        seen, cross, own = b.T @ missed, b.T @ a, a.T @ a
        spread = np.linalg.inv(self.known)
        square = missed @ missed - seen @ np.linalg.solve(after, seen)
        wider = np.trace(spread @ own) - np.trace(
            np.linalg.solve(after, after - other.known + cross @ spread @ cross.T)
        )
        return float(
            0.5 * (square + wider + other._log_determinant(b.T @ b) - self._log_determinant(own))
        )

    def _log_determinant(self, seen: Array) -> float:
        """Return the log determinant of the covariance of the new rows."""
        return float(np.linalg.slogdet(self.known + seen)[1] - np.linalg.slogdet(self.known)[1])


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedOutcome:
    """Expected outcome between the most probable candidate and each other."""

    ratios: Mapping[str, float]  # log evidence ratios by the other, on average over which is true
    confusion: float  # bound on the probability that the likeliest afterwards is not the true one


D = TypeVar("D")


def select_design(
    first: D,
    more: Callable[[D], Mapping[str, D]],
    weighed: Callable[[D], ExpectedOutcome],
    seconds: Callable[[D], float],
    most_s: float,
) -> D:
    """Return the design that lowers the expected confusion most for its time, step by step."""
    best, expected, rates = first, weighed(first), dict[str, float]()
    while expected.confusion > CLEAR:
        options = {what: option for what, option in more(best).items() if seconds(option) <= most_s}
        fresh = dict[str, ExpectedOutcome]()
        what = ""
        while options and what not in fresh:
            # What a thing gains shrinks with what is there already: old rates bound new ones.
            what = max(options, key=lambda option: rates.get(option, inf))
            if what not in fresh:
                fresh[what] = weighed(options[what])
                gained = log(expected.confusion / fresh[what].confusion)
                taken_s = max(MIN_DURATION_S, seconds(options[what]) - seconds(best))
                rates[what] = gained / taken_s if gained > WORTH else 0.0
                what = max(options, key=lambda option: rates.get(option, inf))
        if not options or rates[what] <= 0.0:
            break
        best, expected = options[what], fresh[what]
    return best


def select_candidates(hypotheses: Hypotheses, judgement: Judgement) -> list[CandidateEffect]:
    """Return the explanations that an experiment should separate, likeliest first.

    Those that leave less than 5 % to others, in the place that is least sure; two at least.
    """
    index = min(
        range(len(judgement.trials)),
        key=lambda trial_index: max(judgement.weights[trial_index].values()),
    )
    trial = judgement.trials[index]
    chances = probabilities(trial) if trial.log_odds else judgement.weights[index]
    phrases = {effect.name: effect.phrase for effect in hypotheses.evidence.model.effects}
    phrases |= {name: part.phrase for name, part in hypotheses.discrepancies.items()}
    rivals = [
        CandidateEffect(name="none", phrase=NONE, fit=trial.base, probability=chances["none"])
    ]
    for fit in trial.tried:
        name = fit.active[-1]
        chance = chances.get(name, 0.0)
        rivals.append(CandidateEffect(name=name, phrase=phrases[name], fit=fit, probability=chance))
    rivals.sort(key=lambda rival: -rival.probability)
    count, left = 0, 1.0
    while count < MAX_CANDIDATES and (count < 2 or left > CLASS_FROM) and count < len(rivals):
        left -= rivals[count].probability
        count += 1
    rivals = [
        replace(rival, probability=max(rival.probability, MIN_PROBABILITY))
        for rival in rivals[:count]
    ]
    named = [rival for rival in rivals if rival.name not in hypotheses.discrepancies]
    if not named:
        return rivals
    return [rival if rival in named else replace(rival, name="unknown") for rival in rivals]


def proposal(
    among: Sequence[CandidateEffect],
    expected: ExpectedOutcome,
    title: str,
    seconds: float,
    refused: Subsystem | None,
    *,
    schedule: Schedule | None = None,
    plan_toml: str = "",
) -> NextExperiment:
    """Return an experiment in words, with what it is expected to say.

    Args:
        refused: the stage in which nothing in the library explains what is there.
    """
    by_name = {rival.name: rival for rival in reversed(among)}
    first = among[0].name
    ratios = expected.ratios
    apart = [name for name, ratio in ratios.items() if ratio >= DECISION_PROBABILITY]
    other = next(iter(apart or ratios))
    size = "above 100" if ratios[other] > SHOWN else f"of {ratios[other]:.1f}"
    reason = (
        f"expected to separate {by_name[first].phrase} from {by_name[other].phrase} by a log "
        f"evidence ratio {size}"
    )
    if apart and (beyond := [by_name[name].phrase for name in ratios if name not in apart]):
        reason = f"{reason}, but not from {', '.join(beyond)}"
    if refused == "pwm_to_rpm":
        reason = f"{ESC_MODE}; {reason}"
    return NextExperiment(
        candidates=tuple(dict.fromkeys(rival.name for rival in among)),
        title=title,
        reason=reason,
        schedule=schedule,
        plan_toml=plan_toml,
        expected=ratios,
        minutes=seconds / 60.0,
    )


class Forecast:
    """Expected outcomes of experiments, given all recordings so far."""

    def __init__(self, evidence: Evidence, rivals: Sequence[CandidateEffect]) -> None:
        self._about = Hypotheses(evidence)
        self._evidence = evidence
        about, self._upper = (
            self._about,
            np.array([parameter.most for parameter in evidence.parameters]),
        )
        fits = [about.near_fit(rival.fit) for rival in rivals]
        fits = [about.fitted(fit.active, fit.values, fit.amplitudes) for fit in fits]
        self.rivals = [replace(rival, fit=fit) for rival, fit in zip(rivals, fits, strict=True)]
        self._before = [slopes(evidence.residuals, fit.values, self._upper) for fit in fits]
        masks = evidence.groups().stages
        self._noise = {stage: float(about.noise[mask][0]) for stage, mask in masks.items()}

    def expected(
        self, new: Evidence, both: Evidence, rng: np.random.Generator | None = None
    ) -> ExpectedOutcome:
        """Return what an experiment is expected to say.

        Args:
            new, both: as of `outlooks`.
            rng: of simulated experiments, each weighed within bounds; without it rivals are taken
                for Gaussians without bounds, which is quick and good enough to compare designs.
        """
        first, *others = zip(self.rivals, self.outlooks(new, both), strict=True)
        a, of_a = first
        ratios, confusion = dict[str, float](), 0.0
        for b, of_b in others:
            if a.name == b.name:  # both without a name
                continue
            ratio = (
                a.probability * of_a.over(of_b, rng) + b.probability * of_b.over(of_a, rng)
            ) / (a.probability + b.probability)
            ratios[b.name] = min(ratio, ratios.get(b.name, inf))
            confusion += sqrt(a.probability * b.probability) * exp(-0.25 * ratio)
        return ExpectedOutcome(ratios, confusion)

    def outlooks(self, new: Evidence, both: Evidence) -> list[CandidatePrediction]:
        """Return what each rival predicts of an experiment.

        Args:
            new: of the experiment, read without noise as any one bench would.
            both: of the recordings so far and, behind them, of the experiment.
        """
        masks = new.groups().stages
        noise = np.ones(len(next(iter(masks.values()))))
        for stage, mask in masks.items():
            noise[mask] = self._noise.get(stage, 1.0)
        noise = np.concatenate([self._about.noise, noise])
        columns = {part.name: part.columns for part in both.discrepancies()}
        return [
            self._outlook(rival.fit, before, slopes(new.residuals, rival.fit.values, self._upper),
                          both, columns, noise)
            for rival, before in zip(self.rivals, self._before, strict=True)
        ]  # fmt: skip

    def _outlook(
        self,
        fit: Hypothesis,
        before: tuple[Array, Array],
        new: tuple[Array, Array],
        both: Evidence,
        columns: Mapping[str, Array],
        noise: Array,
    ) -> CandidatePrediction:
        """Return what a rival predicts, from residuals and their slopes before and in the new."""
        region = self._about.region(fit.active)
        free = (fit.values > region.lower + 1e-9) & (fit.values < region.upper - 1e-9)
        rows, jacobian = (np.concatenate(pair) for pair in zip(before, new, strict=True))
        factors = self._about.errors.factors(fit.amplitudes)
        shared = [factor * columns[name] for name, factor in factors.items()]
        for name in fit.active:
            if name in self._about.effects and columns:
                own = np.array([parameter.effect == name for parameter in both.parameters])
                both_ways = np.vstack([fit.values, np.where(own, 0.0, fit.values)])
                done = both.residuals(both_ways)
                shared.append(both.varied(done[:, 0] - done[:, 1]))
        n_before = len(before[0])
        every = np.hstack([-jacobian[:, free], *shared]) / noise[:, None]
        rows = rows / noise
        prior = np.concatenate([region.penalty[free] ** 2, np.ones(every.shape[1] - free.sum())])
        precision = every[:n_before].T @ every[:n_before] + np.diag(prior + 1e-9)
        # Numbers are at their best; what discrepancies take up follows from what is left of rows.
        taken = slice(int(free.sum()), None)
        weights = np.linalg.solve(
            precision[taken, taken], every[:n_before, taken].T @ rows[:n_before]
        )
        return CandidatePrediction(
            mean=every[n_before:, taken] @ weights - rows[n_before:],
            slopes=every[n_before:],
            known=precision,
            room=((region.lower - fit.values)[free], (region.upper - fit.values)[free]),
        )
