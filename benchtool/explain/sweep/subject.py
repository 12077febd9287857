"""Plate sweeps as the subject of an explanation.

Blocks of errors are stays at one plate position. Thrust is predicted point by point, a rotor's
speed from the earlier visits of its level, which fix the scale of the pulse. The floor is simulated
with the model: points with stated noise, predicted with draws from the posterior of the training.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchtool.core.units import Array
from benchtool.explain.engine.subject import Subject, build_overlay
from benchtool.explain.findings import Overlay
from benchtool.explain.sweep.dependences import MAX_Z_OVER_R, summarize_residuals
from benchtool.explain.sweep.evidence import SweepEvidence
from benchtool.explain.sweep.log import SweepLog
from benchtool.explain.sweep.next_experiment import SweepDesigner
from benchtool.physics.effects.effect import Effect
from benchtool.physics.model import Model

RPM = 30.0 / np.pi

STEP = 0.05  # finite difference, in scales of the parameters
LEVEL_WIDTH = 0.02  # of the squared speed within one level, relative; assumed
REFERENCE_Z_OVER_R = 5.0  # eq. (2) adds 0.25 % there; assumed


class SweepSubject(Subject):
    """Plate sweeps, compared with a model.

    Shape errors of a law of a few per cent exceed the noise of good sweeps, so sweeps are not
    rejected by their residuals; shape parameters absorb these errors.
    """

    kind = "sweep"
    gather = SweepEvidence
    summarize = staticmethod(summarize_residuals)
    designer = SweepDesigner
    evidence: SweepEvidence
    check_evidence: SweepEvidence
    all_evidence: SweepEvidence

    def __init__(
        self,
        model: Model,
        training: Sequence[SweepLog],
        validation: Sequence[SweepLog],
        extra: Sequence[Effect] = (),
    ) -> None:
        powers = [log.power for log in training if log.power is not None]
        if powers:  # one load scale for all sweeps
            training, validation = (
                [replace(log, power=log.power and log.power.loaded_as(powers[0])) for log in part]
                for part in (training, validation)
            )
        super().__init__(model, training, validation, extra)

    def errors(self, sets: Array, changes: Array) -> Mapping[str, Array]:
        check = self.check_evidence
        thrust, speed = [], []
        for log, thrust_N, speed_rad_s in self._by_log(changes):
            errors = log.thrust_N[:, None] - check.thrusts(log.conditions, sets) - thrust_N
            thrust.append(_mean_squares(errors, log.stay))
            if log.power is not None:
                readings = log.power.rotor_rad_s[:, :, None] - speed_rad_s
                speed.append(_speed_squares(log, readings - check.predicted(log, sets, readings)))
        return _by_channel(thrust, speed)

    @property
    def free_law(self) -> str:
        model = self.evidence.model
        parameters = [model.parameters[name] for name in ("k", "R_m")]
        is_known = [not k.free or k.prior.kind == "normal" for k in parameters]
        distances = [log.conditions.plate_z_m[~log.tare] for log in self.evidence.logs]
        max_ratio = float(np.max(np.concatenate(distances))) / model.rig.propulsion.radius_m
        if any(is_known) or max_ratio >= REFERENCE_Z_OVER_R:
            return ""
        return (
            f"k and R_m are free and the largest distance is {max_ratio:.2g} R, so an effect near "
            f"the plate looks like another law of distance; record points beyond "
            f"{REFERENCE_Z_OVER_R:g} R, or give k or R_m with its standard error"
        )

    def _by_log(self, changes: Array) -> Iterator[tuple[SweepLog, Array, Array]]:
        """Yield validation sweeps with changes of their thrusts and speeds, (m, n_sets) each."""
        for log, thrusts, speeds in self.check_evidence.rows():
            running = int((~log.tare).sum())
            yield log, changes[thrusts], changes[speeds][:running]

    def floor(
        self, at: Array, changes: Array, rng: np.random.Generator, spread: Array | None = None
    ) -> Mapping[str, Array]:
        check, n, draws = self.check_evidence, len(at), changes.shape[1]
        shifts = np.zeros((n, draws))
        if spread is not None:
            shifts = np.linalg.cholesky(spread) @ rng.standard_normal((n, draws))
        sets = np.vstack([at, at + STEP * np.eye(n)])
        thrust, speed = [], []
        for (log, thrust_N, speed_rad_s), root in zip(
            self._by_log(changes), check.noise_roots, strict=True
        ):
            errors_N = thrust_N + _linear_change(check.thrusts(log.conditions, sets), shifts)
            errors_N += root @ rng.standard_normal((len(log), draws))
            thrust.append(_mean_squares(errors_N, log.stay))
            power = log.power
            if power is not None:
                shape = power.rotor_rad_s.shape
                noise = power.rotor_se[:, :, None] * rng.standard_normal((*shape, draws))
                readings = noise + speed_rad_s
                predicted = check.predicted(log, sets, power.rotor_rad_s[:, :, None])
                errors_rad_s = _linear_change(predicted, shifts) + readings
                errors_rad_s -= power.predicted(check.drive(log, sets[:1]), readings)
                speed.append(_speed_squares(log, errors_rad_s))
        squares = _by_channel(thrust, speed)
        return {name: np.sqrt(np.mean(blocks, axis=0)) for name, blocks in squares.items()}

    def overlays(self, before: Array, after: Array) -> tuple[Overlay, ...]:
        """Return overlays of the first validation sweep: thrust over z/R, speeds over time.

        Rows are sorted by level and distance; lines break between levels.
        """
        evidence = self.check_evidence
        log, sets = evidence.logs[0], np.vstack([before, after])
        running = ~log.tare
        predicted = evidence.thrusts(log.conditions, sets)[running]
        ratio = log.conditions.plate_z_m / evidence.model.rig.propulsion.radius_m
        ratio = np.minimum(ratio, MAX_Z_OVER_R)[running]
        level = _levels(log)[running]
        rows = np.column_stack([ratio, log.thrust_N[running], predicted])
        overlays = [_overlay("thrust_N", "z_over_R", level, rows)]
        power = log.power
        if power is not None:
            predicted = evidence.predicted(log, sets, power.rotor_rad_s[:, :, None]).mean(axis=0)
            rows = np.column_stack([power.time_s, RPM * power.speed_rad_s, RPM * predicted])
            mask = power.is_predicted
            overlays.append(_overlay("rpm", "time_s", power.level[mask], rows[mask]))
        return tuple(overlays)


def _by_channel(thrust: list[Array], speed: list[Array]) -> dict[str, Array]:
    """Return mean squares (n_blocks, n_sets) of all sweeps, without missing speeds."""
    return {"thrust_N": np.concatenate(thrust)} | ({"rpm": np.concatenate(speed)} if speed else {})


def _linear_change(predictions: Array, errors: Array) -> Array:
    """Return linear changes by parameter errors (n_parameters, n).

    From predictions (..., m, 1 + n_parameters), each parameter changed by `STEP` in turn.
    """
    slope: Array = (predictions[..., 1:] - predictions[..., :1]) / STEP
    return slope @ errors


def _mean_squares(errors: Array, stay: NDArray[np.intp]) -> Array:
    """Return mean squares (n_stays, n_sets) of errors (m, n_sets), by stay of the plate."""
    numbers = np.unique(stay)
    return np.array([np.mean(errors[stay == number] ** 2, axis=0) for number in numbers])


def _speed_squares(log: SweepLog, errors: Array) -> Array:
    """Return mean squares (n_stays, n_sets): rpm^2, of errors (n_rotors, m, n_sets): rad/s."""
    assert log.power is not None
    mask = log.power.is_predicted
    squares = np.mean((RPM * errors[:, mask]) ** 2, axis=0)
    return _mean_squares(np.sqrt(squares), log.stay[~log.tare][mask])


def _levels(log: SweepLog) -> NDArray[np.intp]:
    """Return the index of each row's throttle level (m,)."""
    squares = np.sum(log.conditions.speed_rad_s**2, axis=0)
    order = np.argsort(squares)
    steps = np.diff(squares[order]) > LEVEL_WIDTH * squares[order][1:]
    levels = np.empty(len(squares), np.intp)
    levels[order] = np.concatenate([[0], np.cumsum(steps)])
    return levels


def _overlay(channel: str, axis: str, level: NDArray[np.intp], rows: Array) -> Overlay:
    """Return rows (m, 4) of position, measured, before, after, sorted by level and position."""
    levels = [rows[level == index] for index in np.unique(level)]
    return build_overlay(
        channel, axis, [part[np.argsort(part[:, 0], kind="stable")] for part in levels]
    )
