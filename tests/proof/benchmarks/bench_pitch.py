"""Print how fast the pitch bench runs beside MuJoCo; the aims: 5000, 500, 10 times, 3000 runs/s.

The scenario: the two-rotor beam for 10 s with lag, friction, wake torque, all sensor noise and
quantisation on, plant at 1 kHz, control at 500 Hz, float64, logging on, after warm-up. MuJoCo runs
the same hinge, controller and noise through its Python interface, once with the ground-effect
torque from a Python callback and once without ground effect. Single runs are taken in turns, and
the best of each counts, so that what else the machine does falls on all alike.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchtool.core.schedule import PlateVisit, SampledSchedule, Schedule, Signal
from benchtool.physics.model_file import load_model
from benchtool.simulate.controllers.controller import PitchCommand, PitchMeasurement, PitchReference
from benchtool.simulate.controllers.pitch import PitchControl, PulseLaw
from benchtool.simulate.pitch.bench import PitchBench
from benchtool.simulate.pitch.run import PitchJob, PitchLoop
from benchtool.simulate.pitch.simulate import simulate_controller, simulate_many, simulate_pitch

DURATION_S, ROUNDS, RUNS = 10.0, 7, 3000
KP, KI, KD = 350.0, 350.0, 65.0
ARM, RADIUS, GAP, J, K, TAU = 0.25, 0.127, 0.254, 0.03, 1.0030797180591442e-5, 0.02
SLOPE, START, BASE_N = 1.2566370614359172, 1000.0, 1.2 * 9.81 / 2.0


def scenario() -> tuple[PitchJob, SampledSchedule]:
    """Return the beam with all its noise, its own pulse law, steps and a plate."""
    laws = PulseLaw(kp_us_per_rad=KP, ki_us_per_rad_s=KI, kd_us_s_per_rad=KD)
    control = PitchControl(name="pulses", gains=None, rate_Hz=500.0, pulses=laws)
    bench = PitchBench.from_model(load_model("pitch_beam").model, pwm_min_us=1100.0)
    steps = Signal(shape="steps", levels=(0.0, 10.0, -10.0, 5.0), every_s=2.5)
    visit = PlateVisit(z_over_R=2.0, in_s=2.0, out_s=8.0)
    schedule = Schedule(
        name="x", title="x", duration_s=DURATION_S, reference_deg=(steps,), plate=(visit,)
    )
    return PitchJob(bench, control), schedule.sampled(500.0, RADIUS)


class OwnPid:
    """The same law as a user would write it."""

    def __init__(self) -> None:
        self.total = 0.0

    def step(
        self, measurement: PitchMeasurement, reference: PitchReference, dt_s: float
    ) -> PitchCommand:
        """Return the difference of pulses."""
        error = reference.theta_rad - measurement.theta_rad
        self.total = min(max(self.total + error * dt_s, -0.5), 0.5)
        return PitchCommand(0.0, KP * error + KI * self.total - KD * measurement.rate_rad_s)


BEAM = f"""<mujoco><option timestep="0.001" gravity="0 0 0"/><worldbody><body>
<inertial pos="0 0 0" mass="1.2" diaginertia="0.003 {J} {J}"/>
<joint name="hinge" type="hinge" axis="0 1 0" frictionloss="0.001"/></body></worldbody></mujoco>"""


class MujocoBeam:
    """The scenario through MuJoCo's Python interface."""

    def __init__(self, schedule: SampledSchedule, ground_effect: bool) -> None:
        import mujoco

        self.mujoco, self.ground_effect = mujoco, ground_effect
        self.model = mujoco.MjModel.from_xml_string(BEAM)
        self.reference = schedule.reference_rad.tolist()
        self.share = schedule.plate_share.tolist()

    def run(self) -> None:
        """Simulate once."""
        mujoco, model = self.mujoco, self.model
        data = mujoco.MjData(model)
        rng = np.random.default_rng(1)
        kept, kick = np.exp(-0.001 / 0.1), 0.004 * np.sqrt(1.0 - np.exp(-0.02))
        lag = np.exp(-0.001 / TAU)
        base = START + np.sqrt(BASE_N / K) / SLOPE
        state = {"wake": 0.0, "share": 0.0, "w": [np.sqrt(BASE_N / K)] * 2}
        force = data.qfrc_applied

        def push(_model: Any, data: Any) -> None:
            one, two = state["w"]
            factor = 1.0
            if self.ground_effect:
                ratio = RADIUS / (4.0 * (GAP + ARM * np.sin(data.qpos[0])))
                factor = 1.0 + state["share"] * (1.0 / (1.0 - ratio * ratio) - 1.0)
            force[0] = ARM * K * (one * one * factor - two * two) + state["wake"]

        if self.ground_effect:
            mujoco.set_mjcb_passive(push)
        log = np.empty((len(self.reference), 8))
        total = 0.0
        try:
            for tick, reference in enumerate(self.reference):
                noise = rng.standard_normal(6)
                theta = round((data.qpos[0] + 3.5e-4 * noise[0]) / 3.83e-4) * 3.83e-4
                rate = round((data.qvel[0] + 1.75e-3 * noise[1]) / 1.06e-3) * 1.06e-3
                error = reference - theta
                total = min(max(total + 0.002 * error, -0.5), 0.5)
                pulse = KP * error + KI * total - KD * rate
                pulses = [
                    round(min(max(base + sign * pulse, 1100.0), 1950.0)) for sign in (1.0, -1.0)
                ]
                state["share"] = self.share[tick]
                speeds = [w * 9.549 + 15.0 * n for w, n in zip(state["w"], noise[2:], strict=False)]
                log[tick] = (reference, theta, rate, *pulses, *speeds, GAP + 0.001 * noise[5])
                for _ in range(2):
                    state["w"] = [
                        SLOPE * (pwm - START) * (1.0 - lag) + lag * w
                        for pwm, w in zip(pulses, state["w"], strict=True)
                    ]
                    state["wake"] = kept * state["wake"] + kick * rng.standard_normal()
                    if not self.ground_effect:
                        push(model, data)
                    mujoco.mj_step(model, data)
        finally:
            mujoco.set_mjcb_passive(None)


def best_s(run: Callable[[], object], rounds: int = 1) -> float:
    """Return the least duration of some rounds."""
    out = []
    for _ in range(rounds):
        start = time.perf_counter()
        run()
        out.append(time.perf_counter() - start)
    return min(out)


def squared(loop: PitchLoop, lane: int, run: int) -> float:
    """Return the mean squared error of a lane."""
    return float(np.mean((loop.log[:, 8, lane] - loop.log[:, 0, lane]) ** 2))


def main() -> None:
    """Measure and print."""
    job, schedule = scenario()
    contestants: dict[str, Callable[[], object]] = {
        "benchtool, built-in controller": lambda: simulate_pitch(job, schedule),
        "benchtool, controller in Python": lambda: simulate_controller(OwnPid(), job, schedule),
    }
    try:
        for label, effect in (("without ground effect", False), ("with a callback", True)):
            contestants[f"MuJoCo, {label}"] = MujocoBeam(schedule, effect).run
    except ImportError:
        print("MuJoCo is not installed: pip install benchtool[benchmark]")
    best = dict.fromkeys(contestants, float("inf"))
    for run in contestants.values():
        run()
    for _ in range(ROUNDS):
        for label, run in contestants.items():
            best[label] = min(best[label], best_s(run))
    for label, seconds in best.items():
        print(f"{label:<34} {DURATION_S / seconds:>8.0f} times real time")
    if "MuJoCo, with a callback" in best:
        ratio = best["MuJoCo, with a callback"] / best["benchtool, built-in controller"]
        print(f"{'benchtool over MuJoCo, callback':<34} {ratio:>8.1f} times (aim 10)")
    list(simulate_many([(job, k) for k in range(64)], schedule, squared))
    for threads in (1, os.cpu_count() or 1):
        for count in (RUNS, 2 * RUNS):
            seconds = best_s(
                lambda n=count, t=threads: list(  # type: ignore[misc]
                    simulate_many(((job, k) for k in range(n)), schedule, squared, threads=t)
                )
            )
            print(
                f"batch of {count} runs of {DURATION_S:g} s on {threads} threads: "
                f"{count / seconds:.0f} runs/s"
            )
    command = [sys.executable, "-m", "benchtool", "simulate", "pitch"]
    subprocess.run(command, check=True, capture_output=True)
    seconds = best_s(lambda: subprocess.run(command, check=True, capture_output=True), 5)
    print(f"benchtool simulate pitch, warm: {seconds:.2f} s (aim 2.5)")


if __name__ == "__main__":
    main()
