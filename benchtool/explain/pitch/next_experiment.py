"""Design the next pitch experiment: the one that is expected to say most between rivals.

Motions of the beam, steps of the collective, dither, plate distances and length are added one after
the other. Each design is simulated with the likeliest rival for true.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchtool.core.rig import Rig
from benchtool.core.schedule import PlateVisit, Schedule, Signal
from benchtool.explain.engine.design import Forecast, Prospect, chosen, proposal
from benchtool.explain.engine.judgement import Rival
from benchtool.explain.engine.parameters import parameters_at
from benchtool.explain.engine.verdict import NextExperiment
from benchtool.explain.pitch.evidence import PitchEvidence
from benchtool.explain.pitch.log import pitch_log
from benchtool.physics.effects.effect import Subsystem
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
    rivals: Sequence[Rival],
    rng: np.random.Generator,
    refused: Subsystem | None = None,
    minutes: float | None = None,
) -> NextExperiment | None:
    """Return the experiment that is expected to separate rivals; None where there is but one."""
    if len({one.name for one in rivals}) < 2:
        return None
    model, known = evidence.model, [log.logged for log in evidence.logs]
    together = max(COARSE, evidence.together)
    forecast = Forecast(evidence.of(known, together), rivals)
    at = forecast.rivals[0].fit.at
    bench = PitchBench.of(model.at(parameters_at(model.parameters, evidence.parameters, at)))
    job = PitchJob(bench, PitchControl(name="pid", gains=gains_named("s3"), rate_Hz=RATE_HZ))

    seed = int(rng.integers(2**31))

    def weighed(design: PitchDesign, drawn: np.random.Generator | None = None) -> Prospect:
        sampled = design.schedule().sampled(RATE_HZ, model.rig.propulsion.radius_m)
        recording = simulate_pitch(job, sampled, seed).recording(model.rig)
        log = pitch_log(recording, model.rig, checked=False).logged
        new, both = (evidence.of(some, together) for some in ([log], [*known, log]))
        return forecast.expected(new, both, drawn)

    ladder = PitchDesign(motions=(), collective="a ladder of the collective", z_over_R=(1.3,))
    first = PitchDesign(motions=("slow reversals",))
    best = chosen(
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
