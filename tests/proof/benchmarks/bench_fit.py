"""Print what a fit costs beside the bare library doing the same fit; the aims: 1.3 and 3.

Both sides fit 100 settled points of a quadrotor with thrust k w^2 / (1 - D), D of eq. (4), and
are run in turns, so that what else the machine does falls on both alike. The bare side has its
formula written out by hand with everything constant folded; ours goes through rig, model and
effects. emcee: 64 walkers by 5000 steps, bare with its own stretch move and vectorize=True. Least
squares: scipy's defaults on the bare side; ours adds the covariance, intervals and outcome.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import emcee
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from benchtool.core.rig_file import load_rig_by_name
from benchtool.fit.ensemble import fit_ensemble
from benchtool.fit.least_squares import fit_least_squares
from benchtool.fit.model_problem import problem_from_model
from benchtool.fit.problem import Problem
from benchtool.fit.sampling import IslandDifference, log_probability
from benchtool.physics.conditions import Conditions
from benchtool.physics.model import Model

Array = NDArray[np.float64]
WALKERS, STEPS, ROUNDS, REPEATS = 64, 5000, 3, 200
SIGMA_N = 0.02


def problem(*free: str) -> Problem:
    """State the fit of 100 points at ten distances and ten speeds."""
    rig = load_rig_by_name("pquad")
    model = Model.single(rig, "quad").with_effect("neighbour_images").with_effect("body_lift")
    model = model.with_effect("plate_offset").with_free(*free)
    z_m = np.repeat(rig.propulsion.radius_m * np.geomspace(0.5, 8.0, 10), 10)
    conditions = Conditions.build(
        rig, speed_rad_s=np.tile(np.linspace(300.0, 700.0, 10), (4, 10)), plate_z_m=z_m
    )
    noise = np.random.default_rng(1).standard_normal(100)
    observed = model.thrust_N(conditions) + SIGMA_N * noise
    return problem_from_model(model, conditions, observed, np.full(100, SIGMA_N))


def image(z: Any, distance: float) -> Any:
    """Return the image velocity per R^2 as somebody would write it."""
    s = distance * distance + 4.0 * z * z
    return 0.5 * z / (s * np.sqrt(s))


def bare_model(stated: Problem, moving: bool) -> Callable[[Any], Any]:
    """Return the prediction by hand: k, R, K_b and, when it moves, the plate offset."""
    rig = load_rig_by_name("pquad")
    z = np.repeat(rig.propulsion.radius_m * np.geomspace(0.5, 8.0, 10), 10)
    thrust = 4.0 * np.tile(np.linspace(300.0, 700.0, 10), 10) ** 2
    near, far, arm = (
        float(rig.disc_distances_m[0, 1]),
        float(rig.disc_distances_m[0].max()),
        float(np.hypot(*rig.disc_positions_m[0])),
    )
    neighbours = 0.0625 / (z * z) + 2.0 * image(z, near) + image(z, far)
    body = 4.0 * image(z, arm)

    def still(v: Any) -> Any:
        k, r, kb = v
        return k * thrust / (1.0 - r * r * (neighbours + kb * body))

    def moved(v: Any) -> Any:
        k, r, kb, dz = v
        h = z + dz
        images = 0.0625 / (h * h) + 2.0 * image(h, near) + image(h, far)
        return k * thrust / (1.0 - r * r * (images + kb * 4.0 * image(h, arm)))

    found = moved if moving else still
    start = stated.start
    np.testing.assert_allclose(found(start), stated.predict(start), rtol=1e-9)
    return found


def bare_log_probability(stated: Problem, predict: Callable[[Any], Any]) -> Any:
    """Return the log probability by hand."""
    lower, upper = stated.parameters.bounds()
    observed, weight = stated.observed, 1.0 / SIGMA_N

    def log_prob(walkers: Array) -> Array:
        inside = np.all((walkers >= lower) & (walkers <= upper), axis=1)
        r = (predict(walkers.T[:, :, None]) - observed) * weight
        return np.where(inside, -0.5 * np.einsum("wm,wm->w", r, r), -np.inf)

    return log_prob


def in_turns(rounds: int, *calls: Callable[[], object]) -> list[float]:
    """Time each call in turn and return the medians: s."""
    for call in calls:
        call()
    times: list[list[float]] = [[] for _ in calls]
    for _ in range(rounds):
        for call, own in zip(calls, times, strict=True):
            start_s = time.perf_counter()
            call()
            own.append(time.perf_counter() - start_s)
    return [statistics.median(own) for own in times]


def bench(name: str, *free: str) -> None:
    """Print one model's lines."""
    stated = problem(*free)
    predict = bare_model(stated, moving="plate_offset.dz_m" in free)
    n = len(free)
    result = fit_least_squares(stated)
    root = np.linalg.cholesky(result.covariance)
    start = result.values + np.random.default_rng(2).standard_normal((WALKERS, n)) @ root.T
    by_hand = bare_log_probability(stated, predict)

    def bare_emcee() -> None:
        sampler = emcee.EnsembleSampler(WALKERS, n, by_hand, vectorize=True)
        sampler.run_mcmc(start, STEPS)

    def our_emcee() -> None:
        sampler = emcee.EnsembleSampler(
            WALKERS, n, log_probability(stated), moves=IslandDifference(1), vectorize=True
        )
        sampler.run_mcmc(start, STEPS, skip_initial_state_check=True)

    bare_s, ours_s = in_turns(ROUNDS, bare_emcee, our_emcee)
    print(
        f"{name}: emcee {WALKERS} x {STEPS}: ours {ours_s:.3f} s, bare {bare_s:.3f} s, "
        f"ratio {ours_s / bare_s:.2f}"
    )
    lower, upper = stated.shape_bounds
    begin = 1.05 * stated.start + (0.001 if n > 3 else 0.0)
    moved = stated.at(begin)

    def bare_least_squares() -> None:
        least_squares(
            lambda v: (predict(v) - stated.observed) / SIGMA_N,
            begin,
            bounds=(lower, upper),
            x_scale="jac",
        )

    bare_s, ours_s = in_turns(REPEATS, bare_least_squares, lambda: fit_least_squares(moved))
    print(
        f"{name}: least squares: ours {ours_s * 1e3:.2f} ms, bare {bare_s * 1e3:.2f} ms, "
        f"ratio {ours_s / bare_s:.2f}"
    )
    (whole_s,) = in_turns(1, lambda: fit_ensemble(stated))
    facts = fit_ensemble(stated).facts
    print(
        f"{name}: whole emcee fit to convergence, 4 ensembles of {facts['walkers']} walkers, "
        f"{facts['steps']} steps: {whole_s:.2f} s"
    )


def main() -> None:
    """Time a fit with the geometry known and one with the plate's distance free."""
    bench("k, R, K_b", "k", "R_m", "body_lift.K_b")
    bench("k, R, K_b, plate offset", "k", "R_m", "body_lift.K_b", "plate_offset.dz_m")


if __name__ == "__main__":
    main()
