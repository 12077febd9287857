"""Pitch recordings as the subject of an explanation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from benchtool.core.rig import Rig
from benchtool.core.schedule import PlateVisit, Schedule, Signal
from benchtool.core.units import Array
from benchtool.explain.engine.design import ExpectedOutcome, Forecast, build_proposal, select_design
from benchtool.explain.engine.evidence import ChannelErrors, Overlay, Subject
from benchtool.explain.engine.judgement import CandidateEffect
from benchtool.explain.engine.parameters import parameters_at
from benchtool.explain.engine.verdict import NextExperiment
from benchtool.explain.pitch.dependences import summarize_residuals
from benchtool.explain.pitch.evidence import PitchEvidence
from benchtool.explain.pitch.gap import OVERLAP, UNITS, Windows, predicted_channels, read_channels
from benchtool.explain.pitch.log import PitchLog, pitch_log
from benchtool.explain.pitch.timing import bench_numbers
from benchtool.explain.recording_checks import check_bench_kind
from benchtool.physics.effects.effect import Effect, Subsystem
from benchtool.physics.model import Model
from benchtool.simulate.controllers.pitch import PitchControl
from benchtool.simulate.gain_file import load_gains
from benchtool.simulate.pitch.bench import PitchBench
from benchtool.simulate.pitch.run import PitchJob
from benchtool.simulate.pitch.simulate import simulate_pitch

MIN_AVERAGED = 5  # rows averaged into one to compare experiments

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
LENGTHS_S = (20.0, 30.0, 45.0, 60.0)  # candidate durations of a design; assumed
SLIDE_S = 1.0  # between visits of the plate; assumed
# Candidate prediction windows, ascending. Over a near plate the beam diverges from any prediction
# within a second, so that errors of a few long windows are dominated by chance.
WINDOWS_S = (0.25, 0.5, 1.0)

# 95 % quantile of a true model's error above its mean, relative, at which a window is predictable.
# Half of the 10 % allowed for a gap above its floor; the rest is for the wake torque; assumed.
MAX_FLOOR_SPREAD = 0.05
FLOOR_DRAWS = 32  # simulated recordings for that quantile
ONE_SIDED_95 = 1.645  # normal quantile
BREAK = np.full((1, 4), np.nan)  # between windows, to break lines


@dataclass(frozen=True, slots=True, kw_only=True)
class PitchDesign:
    """Design of a pitch experiment: motions in turn, one plate visit per distance."""

    motions: tuple[str, ...]
    collective: str = ""
    dither: bool = False
    z_over_R: tuple[float, ...] = ()
    length_s: float = LENGTHS_S[0]

    def schedule(self) -> Schedule:
        """Return the schedule of its commands."""
        turn_s = self.length_s / max(1, len(self.motions))
        visit_s = self.length_s / (len(self.z_over_R) + 1)
        return Schedule(
            name="next_schedule",
            title=self.text(),
            duration_s=self.length_s,
            reference_deg=tuple(
                replace(MOTIONS[name], from_s=index * turn_s, to_s=(index + 1) * turn_s)
                for index, name in enumerate(self.motions)
            ),
            collective=(COLLECTIVES[self.collective],) if self.collective else (),
            dither_us=(DITHER,) if self.dither else (),
            plate=tuple(
                PlateVisit(
                    z_over_R=ratio, in_s=index * visit_s, out_s=(index + 1) * visit_s - SLIDE_S
                )
                for index, ratio in enumerate(self.z_over_R, 1)
            ),
        )

    def text(self) -> str:
        """Return the design as a phrase."""
        parts = [*self.motions, self.collective, "dither on the pulses" if self.dither else ""]
        motions = ", ".join(part for part in parts if part)
        ratios = ", ".join(f"{ratio:g}" for ratio in self.z_over_R)
        plate = f"the plate parked, then at z/R {ratios}" if ratios else "no plate"
        return f"{motions[:1].upper()}{motions[1:]}; {plate}; {self.length_s:g} s"

    def more(self, rig: Rig) -> dict[str, PitchDesign]:
        """Return designs with one addition each, by its name."""
        designs = {}
        for name in MOTIONS.keys() - set(self.motions):
            designs[name] = replace(self, motions=(*self.motions, name))
        for name in COLLECTIVES.keys() - {self.collective}:
            designs[name] = replace(self, collective=name)
        if not self.dither:
            designs["dither"] = replace(self, dither=True)
        for ratio in set(Z_OVER_R) - set(self.z_over_R):
            if ratio * rig.propulsion.radius_m >= rig.plate.z_min_m:
                ratios = tuple(sorted((*self.z_over_R, ratio), reverse=True))
                designs[f"z/R {ratio}"] = replace(self, z_over_R=ratios)
        for length_s in LENGTHS_S:
            if length_s > self.length_s:
                designs["length"] = replace(self, length_s=length_s)
                break
        return designs


def next_pitch(
    evidence: PitchEvidence,
    rivals: Sequence[CandidateEffect],
    rng: np.random.Generator,
    refused: Subsystem | None = None,
    minutes: float | None = None,
) -> NextExperiment:
    """Return the experiment with the best expected separation of the rivals."""
    model, logs = evidence.model, [log.logged for log in evidence.logs]
    n_averaged = max(MIN_AVERAGED, evidence.n_averaged)
    forecast = Forecast(evidence.of(logs, n_averaged), rivals)
    values = forecast.rivals[0].fit.values
    parameters = parameters_at(model.parameters, evidence.parameters, values)
    bench = PitchBench.from_model(model.with_values(parameters))
    job = PitchJob(bench, PitchControl(name="pid", gains=load_gains("s3"), rate_Hz=RATE_HZ))

    seed = int(rng.integers(2**31))

    def expect(design: PitchDesign, drawn: np.random.Generator | None = None) -> ExpectedOutcome:
        sampled = design.schedule().sampled(RATE_HZ, model.rig.propulsion.radius_m)
        recording = simulate_pitch(job, sampled, seed).recording(model.rig)
        log = pitch_log(recording, model.rig, checked=False).logged
        new, combined = (evidence.of(data, n_averaged) for data in ([log], [*logs, log]))
        return forecast.expected(new, combined, drawn)

    ladder = PitchDesign(motions=(), collective="a ladder of the collective", z_over_R=(1.3,))
    first = PitchDesign(motions=("slow reversals",))
    best = select_design(
        ladder if refused == "pwm_to_rpm" else first,
        lambda design: design.more(model.rig),
        expect,
        lambda design: design.length_s,
        60.0 * minutes if minutes else LENGTHS_S[-1],
    )
    outcome, schedule = expect(best, rng), best.schedule()
    return build_proposal(
        forecast.rivals, outcome, best.text(), best.length_s, refused, schedule=schedule
    )


class PitchSubject(Subject):
    """Pitch recordings, compared with a model."""

    kind = "pitch"
    missed_by = staticmethod(summarize_residuals)
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
        logs = (*learn, *check)
        check_bench_kind([(log.name, bench_numbers(log.logged, model.rig)) for log in logs])
        self.evidence = PitchEvidence(model, [log.logged for log in learn], extra)
        self._validation = PitchEvidence(model, [log.logged for log in check], extra)
        self.all_evidence = PitchEvidence(model, [log.logged for log in logs], extra)

    @cached_property
    def window_s(self) -> float:
        """Longest window over which the plant is predictable: s.

        Judged by simulated validation recordings of the model as given, with the stated noise.
        """
        as_given = np.zeros(len(self.evidence.parameters))
        predictable = WINDOWS_S[0]
        for window_s in WINDOWS_S[1:]:
            floors = self._floor(window_s, as_given, np.random.default_rng(0), FLOOR_DRAWS)
            relative_sd = max(np.std(roots) / np.mean(roots) for roots in floors.values())
            if ONE_SIDED_95 * relative_sd > MAX_FLOOR_SPREAD:
                break
            predictable = window_s
        return predictable

    def errors(self, sets: Array, changes: Array) -> Mapping[str, ChannelErrors]:
        """Return errors in each block of the check recordings, by channel."""
        errors: dict[str, list[Array]] = {}
        for log in self._validation.logs:
            benches = [self._validation.bench(scaled, log.logged.rate_Hz) for scaled in sets]
            windows = Windows.of(log, self.window_s, OVERLAP)
            for name, squares in windows.errors(benches).items():
                errors.setdefault(name, []).append(squares)
        return {
            name: ChannelErrors(unit=UNITS[name], squares=np.concatenate(squares))
            for name, squares in errors.items()
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
        for log in self._validation.logs:
            windows = Windows.of(log, window_s, OVERLAP)
            bench = self._validation.bench(at, log.logged.rate_Hz)
            truths = [bench] * draws
            if spread is not None:
                scaled = rng.multivariate_normal(at, spread, draws, method="eigh")
                truths = [self._validation.bench(x, log.logged.rate_Hz) for x in scaled]
            for name, roots in windows.floor(bench, truths, rng).items():
                total[name] = total.get(name, 0.0) + len(windows.starts) * roots**2
            count += len(windows.starts)
        return {name: np.sqrt(squares / max(count, 1)) for name, squares in total.items()}

    def overlays(self, before: Array, after: Array) -> tuple[Overlay, ...]:
        """Return the first check recording with the predictions of each window, by channel."""
        log = self._validation.logs[0]
        rate_Hz = log.logged.rate_Hz
        windows = Windows.of(log, self.window_s)
        runs = windows.predicted([self._validation.bench(x, rate_Hz) for x in (before, after)])
        overlays = []
        for name, read in read_channels(log.logged).items():
            values = read if read.ndim == 1 else read[:, 0]
            if not np.isfinite(values).any():
                continue
            pieces = []
            for start, run in zip(windows.starts, runs, strict=True):
                rows = np.arange(start, start + windows.rows)
                prediction = predicted_channels(run)[name]
                prediction = prediction if read.ndim == 1 else prediction[:, 0]
                pieces += [np.column_stack([rows / rate_Hz, values[rows], prediction]), BREAK]
            at, measured, line, other = np.concatenate(pieces).T
            overlays.append(
                Overlay(
                    channel=name if name != "rpm" else "rpm1", unit=UNITS[name], axis="time_s",
                    at=at, measured=measured, before=line, after=other,
                )
            )  # fmt: skip
        return tuple(overlays)
