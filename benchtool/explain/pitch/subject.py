"""Pitch recordings as the subject of an explanation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.rig import Rig
from benchtool.core.schedule import PlateVisit, Schedule, Signal
from benchtool.explain.engine.design import ExpectedOutcome, Forecast, proposal, select_design
from benchtool.explain.engine.evidence import ChannelErrors, Overlay, Subject
from benchtool.explain.engine.judgement import CandidateEffect
from benchtool.explain.engine.parameters import parameters_at
from benchtool.explain.engine.verdict import NextExperiment
from benchtool.explain.pitch.dependences import missed_torques
from benchtool.explain.pitch.evidence import PitchEvidence
from benchtool.explain.pitch.gap import OVERLAP, UNITS, Windows, predicted_channels, read_channels
from benchtool.explain.pitch.log import PitchLog, pitch_log
from benchtool.explain.pitch.timing import bench_numbers
from benchtool.explain.recording_checks import check_bench_kind
from benchtool.physics.effects.effect import Effect, Subsystem
from benchtool.physics.model import Model
from benchtool.simulate.controllers.pitch import PitchControl
from benchtool.simulate.gain_file import gains_named
from benchtool.simulate.pitch.bench import PitchBench
from benchtool.simulate.pitch.run import PitchJob
from benchtool.simulate.pitch.simulate import simulate_pitch

COARSE = 5  # rows averaged into one where experiments are compared

RATE_HZ = 250.0

MOTIONS = {
    "slow reversals": Signal(shape="triangle", level=8.0, period_s=10.0),
    "steps": Signal(shape="steps", levels=(0.0, 10.0, -10.0, 5.0, -12.0, 12.0), every_s=2.5),
    "a chirp": Signal(shape="chirp", level=5.0, start_Hz=0.2, end_Hz=2.5),
}
COLLECTIVES = {
    "steps of the collective": Signal(shape="steps", levels=(0.0, 0.15, -0.15), every_s=5.0),
    "a ladder of the collective": Signal(
        shape="steps", every_s=2.0, levels=(-0.2, -0.1, 0.0, 0.1, 0.2, 0.1, 0.0, -0.1)
    ),
}
DITHER = Signal(shape="prbs", level=15.0, bit_s=0.04, seed=1)
Z_OVER_R = (0.9, 1.3, 2.0, 3.0)
LENGTHS_S = (20.0, 30.0, 45.0, 60.0)  # what a design is chosen from; assumed
SLIDE_S = 1.0  # between visits of the plate, for it to go; assumed
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


@dataclass(frozen=True, slots=True, kw_only=True)
class PitchDesign:
    """Describe a pitch experiment: motions take turns, the plate comes once to each distance."""

    motions: tuple[str, ...]
    collective: str = ""
    dither: bool = False
    z_over_R: tuple[float, ...] = ()
    length_s: float = LENGTHS_S[0]

    def schedule(self) -> Schedule:
        """Return its commands."""
        turn_s = self.length_s / max(1, len(self.motions))
        visit_s = self.length_s / (len(self.z_over_R) + 1)
        return Schedule(
            name="next_schedule",
            title=self.text(),
            duration_s=self.length_s,
            reference_deg=tuple(
                replace(MOTIONS[name], from_s=number * turn_s, to_s=(number + 1) * turn_s)
                for number, name in enumerate(self.motions)
            ),
            collective=(COLLECTIVES[self.collective],) if self.collective else (),
            dither_us=(DITHER,) if self.dither else (),
            plate=tuple(
                PlateVisit(
                    z_over_R=ratio, in_s=number * visit_s, out_s=(number + 1) * visit_s - SLIDE_S
                )
                for number, ratio in enumerate(self.z_over_R, 1)
            ),
        )

    def text(self) -> str:
        """Say what is done."""
        parts = [*self.motions, self.collective, "dither on the pulses" if self.dither else ""]
        done = ", ".join(part for part in parts if part)
        ratios = ", ".join(f"{ratio:g}" for ratio in self.z_over_R)
        plate = f"the plate away, then at z/R {ratios}" if ratios else "no plate"
        return f"{done[:1].upper()}{done[1:]}; {plate}; {self.length_s:g} s"

    def more(self, rig: Rig) -> dict[str, PitchDesign]:
        """Return every design with one thing more, by that thing."""
        found = {}
        for name in MOTIONS.keys() - set(self.motions):
            found[name] = replace(self, motions=(*self.motions, name))
        for name in COLLECTIVES.keys() - {self.collective}:
            found[name] = replace(self, collective=name)
        if not self.dither:
            found["dither"] = replace(self, dither=True)
        for ratio in set(Z_OVER_R) - set(self.z_over_R):
            if ratio * rig.propulsion.radius_m >= rig.plate.z_min_m:
                ratios = tuple(sorted((*self.z_over_R, ratio), reverse=True))
                found[f"z/R {ratio}"] = replace(self, z_over_R=ratios)
        for length_s in LENGTHS_S:
            if length_s > self.length_s:
                found["length"] = replace(self, length_s=length_s)
                break
        return found


def next_pitch(
    evidence: PitchEvidence,
    rivals: Sequence[CandidateEffect],
    rng: np.random.Generator,
    refused: Subsystem | None = None,
    minutes: float | None = None,
) -> NextExperiment:
    """Return the experiment that is expected to separate two rivals or more."""
    model, known = evidence.model, [log.logged for log in evidence.logs]
    together = max(COARSE, evidence.together)
    forecast = Forecast(evidence.of(known, together), rivals)
    at = forecast.rivals[0].fit.values
    bench = PitchBench.of(
        model.with_values(parameters_at(model.parameters, evidence.parameters, at))
    )
    job = PitchJob(bench, PitchControl(name="pid", gains=gains_named("s3"), rate_Hz=RATE_HZ))

    seed = int(rng.integers(2**31))

    def weighed(design: PitchDesign, drawn: np.random.Generator | None = None) -> ExpectedOutcome:
        sampled = design.schedule().sampled(RATE_HZ, model.rig.propulsion.radius_m)
        recording = simulate_pitch(job, sampled, seed).recording(model.rig)
        log = pitch_log(recording, model.rig, checked=False).logged
        new, both = (evidence.of(some, together) for some in ([log], [*known, log]))
        return forecast.expected(new, both, drawn)

    ladder = PitchDesign(motions=(), collective="a ladder of the collective", z_over_R=(1.3,))
    first = PitchDesign(motions=("slow reversals",))
    best = select_design(
        ladder if refused == "pwm_to_rpm" else first,
        lambda design: design.more(model.rig),
        weighed,
        lambda design: design.length_s,
        60.0 * minutes if minutes else LENGTHS_S[-1],
    )
    return proposal(
        forecast.rivals,
        weighed(best, rng),
        best.text(),
        best.length_s,
        refused,
        schedule=best.schedule(),
    )


class PitchSubject(Subject):
    """Hold pitch recordings against a model."""

    kind = "pitch"
    missed_by = staticmethod(missed_torques)
    next_by = staticmethod(next_pitch)
    evidence: PitchEvidence
    all_evidence: PitchEvidence

    def __init__(
        self,
        model: Model,
        learn: Sequence[PitchLog],
        check: Sequence[PitchLog],
        extra: Sequence[Effect] = (),
    ) -> None:
        self.training, self.validation = tuple(learn), tuple(check)
        check_bench_kind(
            [(log.name, bench_numbers(log.logged, model.rig)) for log in (*learn, *check)]
        )
        self.evidence = PitchEvidence(model, [log.logged for log in learn], extra)
        self._check = PitchEvidence(model, [log.logged for log in check], extra)
        self.all_evidence = PitchEvidence(model, [log.logged for log in (*learn, *check)], extra)

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
