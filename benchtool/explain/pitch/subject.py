"""Pitch recordings as the subject of an explanation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from benchtool.core.array import Array
from benchtool.explain.engine.judgement import Rival
from benchtool.explain.engine.subject import ChannelErrors, Overlay, Subject
from benchtool.explain.engine.verdict import NextExperiment
from benchtool.explain.found.search import Missed
from benchtool.explain.pitch.dependences import missed_torques
from benchtool.explain.pitch.evidence import PitchEvidence
from benchtool.explain.pitch.gap import OVERLAP, UNITS, Windows, predicted_channels, read_channels
from benchtool.explain.pitch.log import PitchLog
from benchtool.explain.pitch.next_experiment import next_pitch
from benchtool.explain.pitch.timing import bench_numbers
from benchtool.explain.recording_checks import refuse_other_bench
from benchtool.physics.effects.effect import Effect, Subsystem
from benchtool.physics.model import Model

WINDOWS_S = (0.25, 0.5, 1.0)
"""Lengths that a prediction may have, the shortest first. The plant is predictable over a window
where a true model's error comes out alike each time; over a near plate the beam falls away from
any prediction within a second, and few long windows then measure luck."""

ALIKE = 0.05
"""How far above its mean a true model's error over a recording may be, 95 times in 100, for a
window to count as predictable. Half of the tenth by which a gap may stand above its floor; the
other half is left to the wake, whose size nobody states to better than that. A choice."""

ALIKE_DRAWS = 32  # simulated recordings behind that choice
ONE_SIDED_95 = 1.645  # normal quantile
BREAK = np.full((1, 4), np.nan)  # put between windows, so that lines break there


class PitchSubject(Subject):
    """Hold pitch recordings against a model."""

    kind = "pitch"
    evidence: PitchEvidence
    all_evidence: PitchEvidence

    def __init__(
        self,
        model: Model,
        learn: Sequence[PitchLog],
        check: Sequence[PitchLog],
        extra: Sequence[Effect] = (),
    ) -> None:
        self.learn, self.check = tuple(learn), tuple(check)
        refuse_other_bench(
            [(log.name, bench_numbers(log.logged, model.rig)) for log in (*learn, *check)]
        )
        self.evidence = PitchEvidence(model, [log.logged for log in learn], extra)
        self._check = PitchEvidence(model, [log.logged for log in check], extra)
        self.all_evidence = PitchEvidence(model, [log.logged for log in (*learn, *check)], extra)

    def missed(self, at: Array, opened: Sequence[str]) -> list[Missed]:
        return missed_torques(self.all_evidence, at, opened)

    @cached_property
    def window_s(self) -> float:
        """The longest prediction over which the plant is predictable, judged by simulation alone.

        The model as given simulates its own check recordings with the stated noise.
        """
        as_given = np.zeros(len(self.evidence.parameters))
        predictable = WINDOWS_S[0]
        for window_s in WINDOWS_S[1:]:
            found = self._floor(window_s, as_given, np.random.default_rng(0), ALIKE_DRAWS)
            spread = max(np.std(roots) / np.mean(roots) for roots in found.values())
            if ONE_SIDED_95 * spread > ALIKE:
                break
            predictable = window_s
        return predictable

    def errors(self, sets: Array, changes: Array) -> Mapping[str, ChannelErrors]:
        """Return errors in each block of the check recordings, by channel."""
        found: dict[str, list[Array]] = {}
        for log in self._check.logs:
            benches = [self._check.bench(one, log.logged.rate_Hz) for one in sets]
            windows = Windows.of(log, self.window_s, OVERLAP)
            for name, squares in windows.errors(benches).items():
                found.setdefault(name, []).append(squares)
        return {
            name: ChannelErrors(unit=UNITS[name], squares=np.concatenate(squares))
            for name, squares in found.items()
        }

    def floor(
        self, at: Array, changes: Array, rng: np.random.Generator, spread: Array | None = None
    ) -> Mapping[str, Array]:
        return self._floor(self.window_s, at, rng, changes.shape[1], spread)

    def _floor(
        self,
        window_s: float,
        at: Array,
        rng: np.random.Generator,
        draws: int,
        spread: Array | None = None,
    ) -> Mapping[str, Array]:
        total: dict[str, Array] = {}
        count = 0
        for log in self._check.logs:
            windows = Windows.of(log, window_s, OVERLAP)
            bench = self._check.bench(at, log.logged.rate_Hz)
            truths = [bench] * draws
            if spread is not None:
                scaled = rng.multivariate_normal(at, spread, draws, method="eigh")
                truths = [self._check.bench(one, log.logged.rate_Hz) for one in scaled]
            for name, roots in windows.floor(bench, truths, rng).items():
                total[name] = total.get(name, 0.0) + len(windows.starts) * roots**2
            count += len(windows.starts)
        return {name: np.sqrt(squares / max(count, 1)) for name, squares in total.items()}

    def overlays(self, before: Array, after: Array) -> tuple[Overlay, ...]:
        """Return the first check recording with the predictions of each window, by channel."""
        log = self._check.logs[0]
        rate_Hz = log.logged.rate_Hz
        windows = Windows.of(log, self.window_s)
        runs = windows.predicted([self._check.bench(one, rate_Hz) for one in (before, after)])
        out = []
        for name, read in read_channels(log.logged).items():
            values = read if read.ndim == 1 else read[:, 0]
            if not np.isfinite(values).any():
                continue
            pieces = []
            for start, run in zip(windows.starts, runs, strict=True):
                rows = np.arange(start, start + windows.rows)
                shown = predicted_channels(run)[name]
                shown = shown if read.ndim == 1 else shown[:, 0]
                pieces += [np.column_stack([rows / rate_Hz, values[rows], shown]), BREAK]
            at, measured, line, other = np.concatenate(pieces).T
            out.append(
                Overlay(
                    channel=name if name != "rpm" else "rpm1", unit=UNITS[name], axis="time_s",
                    at=at, measured=measured, before=line, after=other,
                )
            )  # fmt: skip
        return tuple(out)

    def next_experiment(
        self,
        rivals: Sequence[Rival],
        rng: np.random.Generator,
        refused: Subsystem | None = None,
        minutes: float | None = None,
    ) -> NextExperiment | None:
        return next_pitch(self.all_evidence, rivals, rng, refused, minutes)
