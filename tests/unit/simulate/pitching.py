"""Benches and schedules that tests of the pitch loop share."""

from __future__ import annotations

from typing import Any

from benchtool.core.rig_file import load_rig_by_name
from benchtool.core.schedule import PlateVisit, SampledSchedule, Schedule, Signal
from benchtool.physics.model import Model
from benchtool.physics.model_file import load_model
from benchtool.simulate.controllers.laws import build_pitch_controller
from benchtool.simulate.controllers.pitch import Feedforward, PitchControl
from benchtool.simulate.gain_file import load_gains
from benchtool.simulate.pitch.bench import PitchBench
from benchtool.simulate.pitch.run import PitchJob


def quiet_bench(rig: str = "beam", **effects: dict[str, float]) -> PitchBench:
    """Return a bench without noise, rounding or friction, with these effects alone."""
    model = Model.single(load_rig_by_name(rig))
    for name, values in effects.items():
        model = model.with_effect(name, **values)
    return PitchBench.from_model(model, sensors={}, pwm_quantum_us=0.0)


def noisy_bench(model: str = "pitch_pquad") -> PitchBench:
    """Return a shipped bench with all its noise."""
    return PitchBench.from_model(load_model(model).model)


def nobody() -> PitchControl:
    """Return a controller that asks for no torque."""
    return PitchControl(name="nobody", gains=None, rate_Hz=500.0)


def soft(name: str = "pid", feedforward: Feedforward | None = None) -> PitchControl:
    """Return a built-in controller with the gains of the paper's baseline."""
    return build_pitch_controller(name, load_gains("s3"), feedforward)


def job(bench: PitchBench, control: PitchControl | None = None) -> PitchJob:
    return PitchJob(bench, nobody() if control is None else control)


def sampled(
    duration_s: float, rate_Hz: float = 500.0, radius_m: float = 0.12, **tracks: Any
) -> SampledSchedule:
    """Return a schedule of these tracks at control ticks."""
    schedule = Schedule(name="test", title="test", duration_s=duration_s, **tracks)
    return schedule.sampled(rate_Hz, radius_m)


STEADY_PLATE = (PlateVisit(z_over_R=2.0, in_s=0.0, out_s=1e6, move_s=0.0),)
SWAY = (Signal(shape="chirp", level=4.0, start_Hz=0.1, end_Hz=1.0),)
