"""Design of the next pitch experiment, to separate rival explanations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from benchtool.core.rig import Rig
from benchtool.core.schedule import PlateVisit, Schedule, Signal
from benchtool.explain.engine.design import CandidateEffect, Designer
from benchtool.explain.engine.evidence import parameters_at
from benchtool.explain.pitch.evidence import PitchEvidence
from benchtool.explain.pitch.log import pitch_log
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


@dataclass(frozen=True, slots=True, kw_only=True)
class PitchDesign:
    """Design of a pitch experiment: motions in turn, one plate visit per distance."""

    plan_toml: ClassVar[str] = ""
    motions: tuple[str, ...] = ()
    collective: str = ""
    dither: bool = False
    z_over_R: tuple[float, ...] = ()
    duration_s: float = LENGTHS_S[0]
    rig: Rig

    @property
    def schedule(self) -> Schedule:
        turn_s = self.duration_s / max(1, len(self.motions))
        visit_s = self.duration_s / (len(self.z_over_R) + 1)
        return Schedule(
            name="next_schedule",
            title=self.title,
            duration_s=self.duration_s,
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

    @property
    def title(self) -> str:
        parts = [*self.motions, self.collective, "dither on the pulses" if self.dither else ""]
        motions = ", ".join(part for part in parts if part)
        ratios = ", ".join(f"{ratio:g}" for ratio in self.z_over_R)
        plate = f"the plate parked, then at z/R {ratios}" if ratios else "no plate"
        return f"{motions[:1].upper()}{motions[1:]}; {plate}; {self.duration_s:g} s"

    def extend(self) -> dict[str, PitchDesign]:
        designs = {}
        for name in MOTIONS.keys() - set(self.motions):
            designs[name] = replace(self, motions=(*self.motions, name))
        for name in COLLECTIVES.keys() - {self.collective}:
            designs[name] = replace(self, collective=name)
        if not self.dither:
            designs["dither"] = replace(self, dither=True)
        for ratio in set(Z_OVER_R) - set(self.z_over_R):
            if ratio * self.rig.propulsion.radius_m >= self.rig.plate.z_min_m:
                ratios = tuple(sorted((*self.z_over_R, ratio), reverse=True))
                designs[f"z/R {ratio}"] = replace(self, z_over_R=ratios)
        for length_s in LENGTHS_S:
            if length_s > self.duration_s:
                designs["length"] = replace(self, duration_s=length_s)
                break
        return designs


class PitchDesigner(Designer[PitchDesign]):
    """Search for the next pitch experiment, flown by a PID controller."""

    max_minutes = LENGTHS_S[-1] / 60.0
    evidence: PitchEvidence

    def __init__(
        self,
        evidence: PitchEvidence,
        candidates: Sequence[CandidateEffect],
        rng: np.random.Generator,
    ) -> None:
        self._logs = [log.logged for log in evidence.logs]
        self._n_averaged = max(MIN_AVERAGED, evidence.n_averaged)
        super().__init__(evidence.of(self._logs, self._n_averaged), candidates, rng)
        model = evidence.model
        parameters = parameters_at(model.parameters, evidence.parameters, self.values)
        bench = PitchBench.from_model(model.with_values(parameters))
        control = PitchControl(name="pid", gains=load_gains("s3"), rate_Hz=RATE_HZ)
        self._job, self._seed = PitchJob(bench, control), int(rng.integers(2**31))

    def initial(self, *, ladder: bool) -> PitchDesign:
        rig = self.evidence.model.rig
        if ladder:
            return PitchDesign(collective="a ladder of the collective", z_over_R=(1.3,), rig=rig)
        return PitchDesign(motions=("slow reversals",), rig=rig)

    def simulate(self, design: PitchDesign) -> tuple[PitchEvidence, PitchEvidence]:
        rig, evidence = design.rig, self.evidence
        sampled = design.schedule.sampled(RATE_HZ, rig.propulsion.radius_m)
        run = simulate_pitch(self._job, sampled, self._seed, neutral_too=True)
        recording = run.recording(rig)
        log = pitch_log(recording, rig, checked=False).logged
        new, both = (evidence.of(logs, self._n_averaged) for logs in ([log], [*self._logs, log]))
        return new, both
