"""How far a model misses the check sweeps, and by how much a true one would.

Blocks are stays at one place of the plate. Thrust is predicted point by point, a rotor's speed from
the earlier visits of its level, which give the scale that belongs to the pulse. The floor is made
by the model itself: its points with stated noise, predicted with parameters drawn from what the
sweeps to learn from leave of them.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array import Array
from benchtool.explain.engine.subject import ChannelErrors
from benchtool.explain.sweep.evidence import SweepEvidence
from benchtool.explain.sweep.log import SweepLog

RPM = 30.0 / np.pi
STEP = 0.05
"""Finite difference, in scales of the parameters."""


def errors(check: SweepEvidence, sets: Array) -> Mapping[str, ChannelErrors]:
    """Return mean squared errors of each stay, for sets of parameters (n_sets, n_parameters)."""
    thrust, speed = [], []
    for log in check.logs:
        missed = log.thrust_N[:, None] - check.thrusts(log.conditions, sets)
        thrust.append(_by_stay(missed, log.stay))
        if log.power is not None:
            read = log.power.rotor_rad_s[:, :, None]
            speed.append(_of_speeds(log, read - check.predicted(log, sets)))
    out = {"thrust_N": ChannelErrors(unit="N", squares=np.concatenate(thrust))}
    if speed:
        out["rpm"] = ChannelErrors(unit="rpm", squares=np.concatenate(speed))
    return out


def floor(
    check: SweepEvidence,
    at: Array,
    spread: Array | None,
    rng: np.random.Generator,
    draws: int,
) -> Mapping[str, Array]:
    """Return errors of a true model (draws,), by channel, root mean square.

    Args:
        check: the sweeps to be predicted.
        at: parameters of the model that is taken for true (n_parameters,).
        spread: their covariance (n_parameters, n_parameters); None: known exactly.
        rng: of noise and parameters.
        draws: how many.
    """
    n = len(at)
    off = np.zeros((n, draws))
    if spread is not None:
        off = np.linalg.cholesky(spread) @ rng.standard_normal((n, draws))
    sets = np.vstack([at, at + STEP * np.eye(n)])
    thrust, speed = [], []
    for log, root in zip(check.logs, check.noise_roots, strict=True):
        missed = _moved(check.thrusts(log.conditions, sets), off)
        missed += root @ rng.standard_normal((len(log), draws))
        thrust.append(_by_stay(missed, log.stay))
        power = log.power
        if power is not None:
            shape = power.rotor_rad_s.shape
            read = power.rotor_se[:, :, None] * rng.standard_normal((*shape, draws))
            wrong = _moved(check.predicted(log, sets), off) + read
            wrong -= power.predicted(check.supply(log, sets[:1]), read)
            speed.append(_of_speeds(log, wrong))
    out = {"thrust_N": np.sqrt(np.mean(np.concatenate(thrust), axis=0))}
    if speed:
        out["rpm"] = np.sqrt(np.mean(np.concatenate(speed), axis=0))
    return out


def _moved(shown: Array, off: Array) -> Array:
    """Return what parameters that are off (n_parameters, n) change.

    From predictions (..., m, 1 + n_parameters), each parameter moved by `STEP` in turn.
    """
    slope: Array = (shown[..., 1:] - shown[..., :1]) / STEP
    return slope @ off


def _by_stay(missed: Array, stay: NDArray[np.intp]) -> Array:
    """Return the mean square (n_stays, n_sets) of misses (m, n_sets)."""
    numbers = np.unique(stay)
    return np.array([np.mean(missed[stay == number] ** 2, axis=0) for number in numbers])


def _of_speeds(log: SweepLog, wrong: Array) -> Array:
    """Return the mean square (n_stays, n_sets) in rpm of misses (n, m, n_sets) in rad/s.

    Of the visits that are predicted, over the rotors.
    """
    assert log.power is not None
    late = log.power.late
    squares = np.mean((RPM * wrong[:, late]) ** 2, axis=0)
    return _by_stay(np.sqrt(squares), log.stay[~log.tare][late])
