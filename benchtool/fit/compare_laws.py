"""Laws of thrust against distance side by side, scored on distances that they were not fitted to.

Every law takes the place of the model's own, the rest of the model as it is, and is fitted to all
distances but one; the one left out scores it by the log density of its points. Laws are set against
the best by the loss at each distance in pairs. Training sets share nearly all their distances, so
that the losses are not independent: the variance of their mean is s^2 (1/J + 1/(J - 1)) for J
distances, the correction of Nadeau and Bengio 2003 (Machine Learning 52, 239) for one in J held
out, and a loss counts where it exceeds Student's t on J - 1 degrees of freedom at 95 %.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit

from benchtool.core.array_type import Array
from benchtool.core.errors import EstimationError, InputError, ModelRejected
from benchtool.core.fit_result import FitResult
from benchtool.fit.compare import predicted
from benchtool.fit.diagnose import refusal, with_diagnosis
from benchtool.fit.law_scores import LawComparison, LawScore, Verdict
from benchtool.fit.least_squares import fit_least_squares
from benchtool.fit.problem import IntArray, Problem
from benchtool.physics.bases import with_blades_of_rig
from benchtool.physics.catalogue import thrust_laws
from benchtool.physics.distance_law import DistanceLaw
from benchtool.physics.effects.effect import Effect
from benchtool.physics.model import Model

SAME_DISTANCE = 0.02  # relative; above the scatter of a stage; assumed
MIN_DISTANCES = 4  # fewer leave no degrees of freedom for a law of two numbers beside k

NO_PLATE_Z_OVER_R = 1e3  # no plate beyond it: such points determine k and are not held out
MAX_KNOTS = 8  # knots of a table through the data, at most two fewer than distances; assumed

UNLIKELY = 0.01  # chance below which losses everywhere are none; small: folds share distances


def compare_laws(
    model: Model, problem_of: Callable[[Model], Problem], z_over_R: Array
) -> LawComparison:
    """Fit every law that applies in place of the model's own, and score it on held-out distances.

    Args:
        model: with what is free beside its law (k, plate offset, K_b).
        problem_of: returns the problem of a model on the data.
        z_over_R: (m,) least distance of each point of the problem.

    Raises:
        InputError: too few distances.
    """
    group = distance_groups(z_over_R)
    places = [float(z_over_R[group == number].mean()) for number in range(group.max() + 1)]
    if len(places) < MIN_DISTANCES:
        raise InputError(
            f"the points lie at {len(places)} distances of the plate, and comparing laws needs "
            f"{MIN_DISTANCES}; measure at more distances, or compare models by name"
        )
    far_known = bool(np.any(group < 0)) or not model.parameters["k"].free
    found = [
        _fitted(one, model, problem_of, places, far_known=far_known)
        for one in candidate_laws(model)
    ]
    left = [tried for tried in found if not tried.refused]
    # Where the data refuse every law, the question is which comes nearest.
    found = [_held_out(one, group, places) if not (one.refused and left) else one for one in found]
    best = max(found, key=lambda tried: (not tried.refused, tried.score))
    scores = [_judged(tried, best, len(places)) for tried in found]
    order = sorted(
        range(len(found)),
        key=lambda i: (scores[i].verdict == "not applied", -found[i].score, scores[i].chi2_per_dof),
    )
    return LawComparison(scores=tuple(scores[i] for i in order), distances=tuple(places))


def distance_groups(z_over_R: Array) -> IntArray:
    """Return the number of each point's distance (m,), nearest first; -1 with the plate gone."""
    group = np.full(len(z_over_R), -1, np.intp)
    number, first = -1, -np.inf
    for i in np.argsort(z_over_R, kind="stable"):
        if z_over_R[i] >= NO_PLATE_Z_OVER_R:
            break
        if z_over_R[i] > first * (1.0 + SAME_DISTANCE) or number < 0:
            number, first = number + 1, z_over_R[i]
        group[i] = number
    return group


def candidate_laws(model: Model) -> Iterator[tuple[Effect, tuple[str, ...]]]:
    """Return the laws that a comparison tries, each with those that it is by another parameter.

    The model's own law stands for all that are one with it. A law of a whole vehicle is another
    one where there are several discs, because neighbours and body then go without a term.
    """
    own = model.law
    laws = {effect.name: effect for effect in thrust_laws(model.rig.plate.surface)}
    if own is not None:
        laws[own.name] = own
    kinds: dict[tuple[str, bool], list[Effect]] = {}
    for effect in laws.values():
        kinds.setdefault(_kind(effect, model.rig.n_discs), []).append(effect)
    for (name, _), members in kinds.items():
        chosen = next((one for one in members if one.name == name), members[0])
        chosen = own if own in members and own is not None else chosen
        yield chosen, tuple(one.name for one in members if one is not chosen)


def _kind(effect: Effect, n_discs: int) -> tuple[str, bool]:
    law = _stated(effect)
    return law.same_as or effect.name, law.whole_vehicle and n_discs > 1


def _stated(effect: Effect) -> DistanceLaw:
    assert effect.distance_law is not None
    return effect.distance_law


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Tried:
    law: str
    one_with: tuple[str, ...]
    refused: str = ""
    applied: bool = True
    problem: Problem | None = None  # starting at the fit to all distances
    whole: FitResult | None = None  # that fit
    density: Array | None = None  # (J,) summed log density of each held-out distance
    rms: float = np.nan

    @property
    def score(self) -> float:
        return -np.inf if self.density is None else float(self.density.sum())


def _fitted(
    one: tuple[Effect, tuple[str, ...]],
    model: Model,
    problem_of: Callable[[Model], Problem],
    places: list[float],
    *,
    far_known: bool,
) -> _Tried:
    """Return a law fitted to all distances, or why it is refused."""
    effect, same = one
    tried = _Tried(law=effect.name, one_with=same)
    nearest = _stated(effect).nearest_z_over_R
    if places[0] < nearest * (1.0 - 1e-9):
        reason = f"points at z/R {places[0]:.3g}, valid from {nearest:g}"
        return replace(tried, refused=reason, applied=False)
    try:
        start = initial_values(with_law(model, effect, places, far_known=far_known), effect, places)
        problem = problem_of(start)
        whole = fit_least_squares(problem)
    except EstimationError as error:
        return replace(tried, refused=str(error))
    judged = refusal((with_diagnosis(problem, whole),))
    refused = "" if judged is None else whole.outcome.message
    if isinstance(judged, ModelRejected):
        refused = f"rejected by chi2/dof {whole.chi2_per_dof:.3g}"
    return replace(tried, refused=refused, problem=problem.at(whole.values), whole=whole)


def initial_values(model: Model, effect: Effect, places: list[float]) -> Model:
    """Return the model with its law as strong as keeps its singular distance off the data.

    From beyond it a search does not come back.
    """
    law = _stated(effect)
    strength = next(item.name for item in effect.parameters if item.neutral is not None)
    name = f"{effect.name}.{strength}"
    item = model.parameters[name]
    if law.singular is None or not item.free:
        return model
    values = {own.name: own.value for own in effect.parameters}
    while law.singular(values) > 0.8 * places[0]:
        values[strength] *= 0.5
    return model.with_values(
        model.parameters.with_replaced(name, item.with_value(values[strength]))
    )


def _held_out(tried: _Tried, group: IntArray, places: list[float]) -> _Tried:
    """Return the law with its scores at distances that it was not fitted to."""
    problem = tried.problem
    if problem is None:
        return tried
    density, squares = np.zeros(len(places)), 0.0
    for number, place in enumerate(places):
        test = np.flatnonzero(group == number)
        training = problem.subset(np.flatnonzero(group != number))
        try:
            result = fit_least_squares(training)
            logs, left = predicted(problem.subset(test), training, result)
        except EstimationError as error:
            return replace(tried, refused=f"without z/R {place:.3g}: {error}")
        density[number] = logs.sum()
        squares += float(left @ left)
    rms = float(np.sqrt(squares / np.count_nonzero(group >= 0)))
    return replace(tried, density=density, rms=rms)


def with_law(
    model: Model, effect: Effect, places: list[float], *, far_known: bool = False
) -> Model:
    """Return the model with another law in place of its own and that law's numbers free.

    The model's own law stays as it is. Under another one R is the rotor's, because a law's numbers
    hold what an effective radius would; a table gets its knots from the distances.

    Args:
        model: with the law that it came with.
        effect: the other law.
        places: z/R of the distances, increasing.
        far_known: whether the thrust far away is known, so that a table may reach beyond the
            farthest distance; where k follows from the same points it ends there.
    """
    if effect is model.law:
        return model
    law = _stated(effect)
    if effect.knots_setting and effect.configure is not None:
        n = int(np.clip(len(places) - 2, 2, MAX_KNOTS))
        inner = np.unique(np.linspace(0, len(places) - 1, n).round().astype(int))
        knots = [*(places[i] for i in inner), *([1.5 * places[-1]] if far_known else [])]
        effect = effect.configure({effect.knots_setting: knots})
        law = _stated(effect)
    if law.whole_vehicle and model.rig.n_discs > 1:
        for other in model.effects:
            if other.hooks.denominator is not None and other.distance_law is None:
                model = model.without(other.name)
    commanded = law.basis == "equal commanded thrust"
    for other in model.effects if commanded else ():
        if other.hooks.response is not None:  # blades answer to a law at equal power
            model = model.without(other.name)
    model = model.with_fixed("R_m", model.rig.propulsion.radius_m).with_law(effect)
    model = with_blades_of_rig(model)
    return model.with_free(*(f"{effect.name}.{name}" for name in law.compared))


def _judged(tried: _Tried, best: _Tried, distances: int) -> LawScore:
    behind, se, lost = np.nan, np.nan, np.empty(0)
    if tried.density is not None and best.density is not None:
        lost = best.density - tried.density
        behind = float(lost.mean())
        se = float(lost.std(ddof=1) * np.sqrt(1.0 / distances + 1.0 / (distances - 1)))
    verdict: Verdict = "indistinguishable"
    if not tried.applied:
        verdict = "not applied"
    elif tried.refused or tried.density is None:
        verdict = "refused"
    elif tried is best:
        verdict = "best"
    elif behind > stdtrit(distances - 1, 0.975) * se or _lost_everywhere(tried, best):
        verdict = "behind"
    whole, own = tried.whole, f"{tried.law}."
    return LawScore(
        law=tried.law,
        verdict=verdict,
        reason=tried.refused,
        one_with=tried.one_with,
        parameters=0 if whole is None else len(whole.estimates),
        values=", ".join(
            f"{item.name.rpartition('.')[2]} {item.value:.4g}"
            for item in (() if whole is None else whole.estimates)
            if item.name.startswith((own, "R_m"))
        ),
        chi2_per_dof=np.nan if whole is None else whole.chi2_per_dof,
        behind=behind,
        behind_se=se,
        losses=tuple(lost.tolist()),
        held_out_rms=tried.rms,
    )


def _lost_everywhere(tried: _Tried, best: _Tried) -> bool:
    """Whether a law loses at so many distances that chance seldom does it (Wilcoxon's test).

    One distance that a law misses by far makes the standard error as large as the mean loss.
    """
    from scipy.stats import wilcoxon

    assert tried.density is not None
    assert best.density is not None
    lost = best.density - tried.density
    return bool(wilcoxon(lost, alternative="greater").pvalue < UNLIKELY) if lost.any() else False
