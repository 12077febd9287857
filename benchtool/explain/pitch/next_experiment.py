"""Choose the next pitch experiment: the one in which rival explanations differ most.

Each option is simulated in closed loop with one rival taken for true, and the other is fitted to
what comes out with everything within its tolerance free. What remains in the sum of squares is
what the experiment is expected to show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from benchtool.core.array import Array
from benchtool.core.schedule import PlateVisit, Schedule, Signal
from benchtool.explain.engine.hypotheses import ratio_of
from benchtool.explain.engine.parameters import parameters_at
from benchtool.explain.engine.verdict import NextExperiment
from benchtool.explain.pitch.evidence import PitchEvidence
from benchtool.explain.pitch.log import pitch_log
from benchtool.simulate.controllers.pitch import PitchControl
from benchtool.simulate.gain_file import gains_named
from benchtool.simulate.pitch.bench import PitchBench
from benchtool.simulate.pitch.run import PitchJob
from benchtool.simulate.pitch.simulate import simulate_pitch

RATE_HZ = 250.0
LENGTH_S = 30.0

STEPS = Signal(shape="steps", levels=(0.0, 10.0, -10.0, 5.0, -12.0, 12.0), every_s=2.5)
SLOW = Signal(shape="triangle", level=8.0, period_s=10.0)
QUICK = Signal(shape="chirp", level=5.0, start_Hz=0.2, end_Hz=2.5)
COLLECTIVES = Signal(shape="steps", levels=(0.0, 0.15, -0.15), every_s=5.0)
DITHER = Signal(shape="prbs", level=15.0, bit_s=0.04, seed=1)
DISTANCES = (
    PlateVisit(z_over_R=2.0, in_s=3.0, out_s=9.0),
    PlateVisit(z_over_R=1.3, in_s=11.0, out_s=18.0),
    PlateVisit(z_over_R=0.9, in_s=20.0, out_s=28.0),
)

OPTIONS: tuple[tuple[Schedule, str], ...] = (
    (
        Schedule(
            name="next_slow_reversals", title="Slow triangle with steps of the collective",
            duration_s=LENGTH_S, reference_deg=(SLOW,), collective=(COLLECTIVES,),
        ),
        "slow reversals show what the hinge holds, at several collectives",
    ),
    (
        Schedule(
            name="next_quick_motion", title="Chirp with dither and steps of the collective",
            duration_s=LENGTH_S, reference_deg=(QUICK,), collective=(COLLECTIVES,),
            dither_us=(DITHER,),
        ),
        "quick motion shows lag against delay and damping against friction",
    ),
    (
        Schedule(
            name="next_collectives", title="Attitude steps at three collectives, no plate",
            duration_s=LENGTH_S, reference_deg=(STEPS,), collective=(COLLECTIVES,),
            dither_us=(DITHER,),
        ),
        "a torque that grows with the collective comes from the rotors, one that does not from "
        "the hinge or the weight",
    ),
    (
        Schedule(
            name="next_distances", title="Attitude steps over a plate at three distances",
            duration_s=LENGTH_S, reference_deg=(STEPS,), collective=(COLLECTIVES,),
            dither_us=(DITHER,), plate=DISTANCES,
        ),
        "plate offset, coverage, body lift and the coefficient grow differently towards the plate",
    ),
)  # fmt: skip
"""What is weighed, with why it helps."""


def next_pitch_experiment(
    rivals: Sequence[tuple[str, Array]], evidence: PitchEvidence, seed: int
) -> NextExperiment | None:
    """Return the option in which the two likeliest rivals differ most.

    Args:
        rivals: effects with the parameters (n_parameters,) of their best fits, likeliest first.
        evidence: that the parameters belong to.
        seed: of the simulated noise.
    """
    if len(rivals) < 2:
        return None
    expected = {
        schedule.name: ratio_of(_evidence(evidence, rivals[0][1], schedule, seed), rivals)
        for schedule, _ in OPTIONS
    }
    chosen, reason = max(OPTIONS, key=lambda option: expected[option[0].name])
    names = " from ".join(name for name, _ in rivals)
    schedule = replace(chosen, title=f"{chosen.title}: to tell {names}")
    title = f"{chosen.title}, {chosen.duration_s:g} s"
    return NextExperiment.between(rivals, expected, title, reason, schedule=schedule)


def _evidence(evidence: PitchEvidence, at: Array, schedule: Schedule, seed: int) -> PitchEvidence:
    """Return what a bench at those parameters (n_parameters,) would log along a schedule."""
    model = evidence.model
    truth = model.at(parameters_at(model.parameters, evidence.parameters, at))
    control = PitchControl(name="pid", gains=gains_named("s3"), rate_Hz=RATE_HZ)
    sampled = schedule.sampled(RATE_HZ, model.rig.propulsion.radius_m)
    run = simulate_pitch(PitchJob(PitchBench.of(truth), control), sampled, seed)
    log = pitch_log(run.recording(model.rig), model.rig, schedule.name)
    return PitchEvidence(model, [log.logged])
