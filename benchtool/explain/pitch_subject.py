"""Pitch recordings as the subject of an explanation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchtool.effects.effect import BenchKind, Effect
from benchtool.effects.model import Model
from benchtool.explain.pitch_evidence import SETTLING_S, PitchEvidence
from benchtool.explain.pitch_gap import errors, floor, predicted, windows_of
from benchtool.explain.pitch_log import PitchLog
from benchtool.explain.subject import ChannelErrors, RowGroups
from benchtool.explain.verdict import NextExperiment
from benchtool.simulate.pitch_bench import rig_sensors

Array = NDArray[np.float64]

WINDOW_S = 1.0
"""Length of a prediction. The beam over a near plate falls away from a prediction within one to
two seconds whatever the model, so that longer windows would measure luck."""

UNITS = {"theta_rad": "rad", "gyro_rad_s": "rad/s", "rpm": "rpm"}


class PitchSubject:
    """Hold pitch recordings against a model.

    Args:
        model: as given by the user.
        learn: recordings to learn from.
        check: recordings to verify on.
        extra: effects of the user's own.
    """

    kind: BenchKind = "pitch"
    window_s = WINDOW_S

    def __init__(
        self,
        model: Model,
        learn: Sequence[PitchLog],
        check: Sequence[PitchLog],
        extra: Sequence[Effect] = (),
    ) -> None:
        self.learn, self.check = tuple(learn), tuple(check)
        self.evidence = PitchEvidence(model, [log.logged for log in learn], extra)
        self._check = PitchEvidence(model, [log.logged for log in check], extra)
        self.model = self.evidence.model

    @property
    def remarks(self) -> tuple[str, ...]:
        """What was mended in the recordings, and what they lack."""
        found = [
            f"{log.name}: {remark}" for log in (*self.learn, *self.check) for remark in log.remarks
        ]
        return tuple(dict.fromkeys(found))

    def model_at(self, at: Array) -> Model:
        """Return the model with the knobs turned (n_knobs,)."""
        return self.evidence.model.at(self.evidence.parameters(at))

    def groups(self) -> RowGroups:
        """Return labels of the evidence's rows."""
        return self.evidence.groups()

    def errors(self, sets: Array) -> Mapping[str, ChannelErrors]:
        """Return errors in each window of the check recordings, by channel."""
        found: dict[str, list[Array]] = {}
        for log in self._check.logs:
            windows = windows_of(log.logged, WINDOW_S, SETTLING_S)
            benches = [self._check.bench(one, log.logged.rate_Hz) for one in sets]
            runs = predicted(benches, log.logged, log.filter, windows)
            for name, squares in errors(log.logged, windows, runs).items():
                found.setdefault(name, []).append(squares)
        return {
            name: ChannelErrors(unit=UNITS[name], squares=np.concatenate(squares))
            for name, squares in found.items()
        }

    def floor(self, at: Array, rng: np.random.Generator, draws: int) -> Mapping[str, Array]:
        """Return errors of a true model with knobs `at` (draws,), by channel."""
        total: dict[str, Array] = {}
        count = 0
        for log in self._check.logs:
            windows = windows_of(log.logged, WINDOW_S, SETTLING_S)
            bench = self._check.bench(at, log.logged.rate_Hz)
            noisy = replace(bench, sensors=rig_sensors(bench.model.rig))
            found = floor(bench, noisy, log.logged, log.filter, windows, rng, draws)
            for name, roots in found.items():
                total[name] = total.get(name, 0.0) + len(windows.starts) * roots**2
            count += len(windows.starts)
        return {name: np.sqrt(squares / max(count, 1)) for name, squares in total.items()}

    def next_experiment(
        self, rivals: Sequence[tuple[str, Array]], rng: np.random.Generator
    ) -> NextExperiment | None:
        """Return the experiment that separates hypotheses best."""
        return None
