"""Pitch bench beside MuJoCo and beside a bare loop under numba, in times real time.

The scenario: the two-rotor beam for 10 s with lag, friction, wake torque, all sensor noise and
quantisation on, plant at 1 kHz, control at 500 Hz, float64, logging on, after warm-up. MuJoCo runs
the same hinge, controller and noise through its Python interface, with the ground-effect torque
from a Python callback. The bare loop is the same law without options, checks or a library.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from benchtool.core.schedule import PlateVisit, SampledSchedule, Schedule, Signal
from benchtool.physics.model_file import load_model
from benchtool.simulate.controllers.controller import PitchCommand, PitchMeasurement, PitchReference
from benchtool.simulate.controllers.pitch import PitchControl, PulseLaw
from benchtool.simulate.pitch.bench import PitchBench
from benchtool.simulate.pitch.run import PitchJob, PitchLoop
from benchtool.simulate.pitch.simulate import simulate_controller, simulate_many, simulate_pitch
from tests.proof.benchmarks.rows import Row, cpu_s, in_turns, wall_s

DURATION_S = 10.0
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

    def __init__(self, schedule: SampledSchedule) -> None:
        import mujoco

        self.mujoco = mujoco
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
            ratio = RADIUS / (4.0 * (GAP + ARM * np.sin(data.qpos[0])))
            factor = 1.0 + state["share"] * (1.0 / (1.0 - ratio * ratio) - 1.0)
            force[0] = ARM * K * (one * one * factor - two * two) + state["wake"]

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
                    mujoco.mj_step(model, data)
        finally:
            mujoco.set_mjcb_passive(None)


@numba.njit(cache=True)
def bare_loop(
    reference: NDArray[np.float64], share: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return the log of the scenario, written for it alone."""
    lag, base = np.exp(-0.001 / TAU), START + np.sqrt(BASE_N / K) / SLOPE
    kept, kick = np.exp(-0.001 / 0.1), 0.004 * np.sqrt(1.0 - np.exp(-0.02))
    one = two = np.sqrt(BASE_N / K)
    angle = velocity = total = wake = 0.0
    log = np.empty((len(reference), 9))
    for tick in range(len(reference)):
        theta = round((angle + 3.5e-4 * rng.standard_normal()) / 3.83e-4) * 3.83e-4
        rate = round((velocity + 1.75e-3 * rng.standard_normal()) / 1.06e-3) * 1.06e-3
        error = reference[tick] - theta
        total = min(max(total + 0.002 * error, -0.5), 0.5)
        pulse = KP * error + KI * total - KD * rate
        pwm1 = round(min(max(base + pulse, 1100.0), 1950.0))
        pwm2 = round(min(max(base - pulse, 1100.0), 1950.0))
        rpm1 = one * 9.549 + 15.0 * rng.standard_normal()
        rpm2 = two * 9.549 + 15.0 * rng.standard_normal()
        gap = GAP + 0.001 * rng.standard_normal()
        log[tick] = np.array((reference[tick], theta, rate, pwm1, pwm2, rpm1, rpm2, gap, angle))
        for _ in range(2):
            one = SLOPE * (pwm1 - START) * (1.0 - lag) + lag * one
            two = SLOPE * (pwm2 - START) * (1.0 - lag) + lag * two
            wake = kept * wake + kick * rng.standard_normal()
            ratio = RADIUS / (4.0 * (GAP + ARM * np.sin(angle)))
            factor = 1.0 + share[tick] * (1.0 / (1.0 - ratio * ratio) - 1.0)
            torque = ARM * K * (one * one * factor - two * two) + wake
            friction = 0.001 * np.tanh(velocity / 1e-3)
            velocity += 0.001 * (torque - friction) / J
            angle += 0.001 * velocity
    return log


def squared(loop: PitchLoop, lane: int, run: int) -> float:
    """Return the mean squared error of a lane."""
    return float(np.mean((loop.log[:, 8, lane] - loop.log[:, 0, lane]) ** 2))


def rows(quick: bool) -> Iterator[Row]:
    """Yield single runs of both controllers beside each peer, and batches."""
    job, schedule = scenario()
    rng = np.random.default_rng(1)
    ours_s, python_s, bare_s = in_turns(
        2 if quick else 15,
        lambda: simulate_pitch(job, schedule),
        lambda: simulate_controller(OwnPid(), job, schedule),
        lambda: bare_loop(schedule.reference_rad, schedule.plate_share, rng),
    )
    ours, unit, bare = DURATION_S / ours_s, "times real time", DURATION_S / bare_s
    yield Row("pitch bench, one core", ours, unit, bare, "bare numba loop", 10_000)
    yield Row("pitch bench, Python controller", DURATION_S / python_s, unit, wanted=1500)
    try:
        mujoco = DURATION_S / cpu_s(MujocoBeam(schedule).run)
    except ImportError:
        mujoco = None  # pip install benchtool[benchmark]
    yield Row("pitch bench beside MuJoCo", ours, unit, mujoco, "MuJoCo", 10.0, mujoco is not None)
    count = 64 if quick else 6000
    list(simulate_many([(job, k) for k in range(64)], schedule, squared))
    for threads, wanted in ((1, None), (2, 10_000)):
        batch = simulate_many(((job, k) for k in range(count)), schedule, squared, threads=threads)
        rate = count / wall_s(lambda: list(batch))  # noqa: B023
        yield Row(
            f"batch of 10 s runs, {threads} threads (wall time)", rate, "runs/s", wanted=wanted
        )
