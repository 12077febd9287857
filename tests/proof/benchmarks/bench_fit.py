"""Fits beside the bare library doing the same fit.

Both sides fit 100 settled points of a quadrotor with thrust k w^2 / (1 - D), D of eq. (4). The bare
side has its formula written out by hand with everything constant folded; ours goes through rig,
model and effects. emcee: 64 walkers by 5000 steps, bare with its own stretch move and
vectorize=True. Least squares: scipy's defaults on the bare side; ours adds the covariance,
intervals and outcome.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
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
from tests.proof.benchmarks.rows import Row, cpu_s, in_turns

Array = NDArray[np.float64]
WALKERS = 64
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


def model_rows(name: str, quick: bool, *free: str) -> Iterator[Row]:
    """Yield the rows of one model."""
    steps = 100 if quick else 5000
    stated = problem(*free)
    predict = bare_model(stated, moving="plate_offset.dz_m" in free)
    n = len(free)
    result = fit_least_squares(stated)
    root = np.linalg.cholesky(result.covariance)
    start = result.values + np.random.default_rng(2).standard_normal((WALKERS, n)) @ root.T
    by_hand = bare_log_probability(stated, predict)

    def bare_emcee() -> None:
        sampler = emcee.EnsembleSampler(WALKERS, n, by_hand, vectorize=True)
        sampler.run_mcmc(start, steps)

    def our_emcee() -> None:
        sampler = emcee.EnsembleSampler(
            WALKERS, n, log_probability(stated), moves=IslandDifference(1), vectorize=True
        )
        sampler.run_mcmc(start, steps, skip_initial_state_check=True)

    ours, bare = in_turns(1, our_emcee, bare_emcee)
    work = f"emcee {WALKERS} x {steps}: {name}"
    yield Row(work, ours, "s", bare, "bare emcee", 0.7, of_peer=True)
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

    rounds = 2 if quick else 200
    ours, bare = in_turns(rounds, lambda: fit_least_squares(moved), bare_least_squares)
    yield Row(f"least squares: {name}", ours, "s", bare, "bare scipy", 1.2, of_peer=True)
    if not quick:
        whole_s = cpu_s(lambda: fit_ensemble(stated))
        yield Row(f"emcee to convergence, 4 ensembles: {name}", whole_s, "s")


def rows(quick: bool) -> Iterator[Row]:
    """Yield a fit with the geometry known and one with the plate's distance free."""
    yield from model_rows("k, R, K_b", quick, "k", "R_m", "body_lift.K_b")
    free = ("k", "R_m", "body_lift.K_b", "plate_offset.dz_m")
    yield from model_rows("k, R, K_b, plate offset", quick, *free)
