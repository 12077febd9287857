"""The bench in motion: one control period after the other, driven by pulses."""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from tests.proof.blind.pitch.beam import STEP_S, compiled
from tests.proof.blind.pitch.plant import Plant
from tests.proof.blind.pitch.rotors import Rotors
from tests.proof.blind.pitch.sheet import PARKED_M, SHEET, Sheet

STEPS = round(SHEET.dt / STEP_S)  # physics steps in one control period

LEAST_DENOMINATOR = 0.25
"""Ground effect never does more than quadruple a thrust; `capped` counts where this was needed."""


@dataclass(frozen=True, slots=True)
class State:
    """Hold where everything is at the start of a control period.

    MuJoCo's rates are those half a physics step earlier (it kicks, then drifts); `rate_rad_s` is
    the hinge's rate at the instant itself.
    """

    positions: tuple[float, ...]
    rates: tuple[float, ...]
    speed_rpm: tuple[float, float]
    bend_rad: float
    rate_rad_s: float


def ground_factor(gap_m: float, plant: Plant, sheet: Sheet = SHEET) -> tuple[float, bool]:
    """Return what the plate makes of the covered rotor's thrust, and whether it was capped."""
    h = max(gap_m, 1e-3)
    image = plant.ge_rho * (sheet.R / (4.0 * h)) ** 2
    body = 2.0 * plant.K_b * sheet.R**2 * h / (sheet.b_body**2 + 4.0 * h * h) ** 1.5
    denominator = 1.0 - image - body
    capped = denominator < LEAST_DENOMINATOR
    factor = 1.0 / max(denominator, LEAST_DENOMINATOR)
    factor += plant.near_gain * math.exp(-h / (plant.near_length * sheet.R))
    return 1.0 + plant.coverage_share * (factor - 1.0), capped


class Moving:
    """Carry a plant through time."""

    def __init__(self, plant: Plant, sheet: Sheet = SHEET) -> None:
        self._plant, self._sheet = plant, sheet
        self._model = compiled(plant)
        self._data = mujoco.MjData(self._model)
        self._rotors = Rotors(plant, sheet)
        self._bristle = Bristle(plant) if plant.bristle_static_Nm > 0.0 else None
        self.rate_rad_s = 0.0
        self.capped = 0

    def rest(self, pulse_us: tuple[float, float]) -> None:
        """Start level and at rest, both rotors turning steadily."""
        mujoco.mj_resetData(self._model, self._data)
        self._rotors.rest(pulse_us)
        self.rate_rad_s = 0.0

    @property
    def theta_rad(self) -> float:
        """Angle of the hub."""
        return float(self._data.qpos[0])

    @property
    def speed_rpm(self) -> tuple[float, float]:
        """Speeds of both rotors."""
        return self._rotors.speed_rpm[0], self._rotors.speed_rpm[1]

    def state(self) -> State:
        """Return where everything is."""
        return State(
            tuple(self._data.qpos.tolist()),
            tuple(self._data.qvel.tolist()),
            self.speed_rpm,
            self._bristle.bend_rad if self._bristle else 0.0,
            self.rate_rad_s,
        )

    def restore(
        self, state: State, pulses_us: list[tuple[float, float]], time_s: float, dt_s: float
    ) -> None:
        """Put everything where it was, given the pulses sent before.

        What this plant does not have (arms that flex, bristles) is left out.
        """
        mujoco.mj_resetData(self._model, self._data)
        n = self._model.nv
        self._data.qpos[:] = state.positions[:n]
        self._data.qvel[:] = state.rates[:n]
        self.rate_rad_s = state.rate_rad_s
        if self._bristle:
            self._bristle.bend_rad = state.bend_rad
        self._rotors.remember(pulses_us, dt_s, time_s)
        self._rotors.speed_rpm = list(state.speed_rpm)

    def advance(
        self,
        pulse_us: tuple[float, float],
        plate_m: float,
        wake_Nm: list[float] | NDArray[np.float64],
        time_s: float,
    ) -> None:
        """Go one control period on. `plate_m` is what is read, without its noise.

        wake_Nm (STEPS,): torque of the wake at the start of each physics step.
        """
        plant, sheet = self._plant, self._sheet
        model, data = self._model, self._data
        position, rate, control, applied = data.qpos, data.qvel, data.ctrl, data.qfrc_applied
        thrust1, thrust2 = self._rotors.advance(pulse_us, time_s)
        speed1, speed2 = self._rotors.speed_rpm
        arm, flexible = sheet.L, plant.flexible
        parked = plate_m >= PARKED_M
        gap_level = plate_m + plant.plate_dz_m
        smooth = plant.friction_Nm if plant.friction_law == "smooth" else 0.0
        # Climb speed over tip speed, per rad/s of the beam.
        climb = plant.aero_damping * arm / (sheet.R * 2.0 * math.pi / 60.0)
        load = self._load_torque(time_s)
        for k in range(STEPS):
            theta = position[0]
            turning = rate[0]
            arm_angle, arm_rate = theta, turning
            if flexible:
                arm_angle += position[1]
                arm_rate += rate[1]
            one, two = thrust1[k], thrust2[k]
            if not parked:
                factor, capped = ground_factor(gap_level + arm * math.sin(arm_angle), plant, sheet)
                one *= factor
                self.capped += capped
            if climb:
                one *= 1.0 - climb * arm_rate / max(speed1, 1.0)
                two *= 1.0 + climb * arm_rate / max(speed2, 1.0)
            control[0], control[1] = one, two
            outer = float(wake_Nm[k])
            hinge = -load * math.cos(theta) if load else 0.0
            if smooth:
                hinge -= smooth * math.tanh(turning / plant.friction_width_rad_s)
            if self._bristle:
                hinge += self._bristle.torque(turning, STEP_S)
            hinge -= plant.vane_Nms2 * turning * abs(turning)
            hinge -= plant.bumper_Nm_per_rad * max(theta - plant.bumper_rad, 0.0)
            applied[0] = hinge + outer
            if flexible:
                applied[1] = outer
            mujoco.mj_step(model, data)
        self.rate_rad_s = float(rate[0] + 0.5 * STEP_S * data.qacc[0])

    def _load_torque(self, time_s: float) -> float:
        plant = self._plant
        if not plant.load_shift_Nm:
            return 0.0
        along = (time_s - plant.load_time_s) / plant.load_width_s + 0.5
        along = min(max(along, 0.0), 1.0)
        return plant.load_shift_Nm * 0.5 * (1.0 - math.cos(math.pi * along))


DAMPING_SHARE = 1.0  # bristle damping over the critical damping of beam on bristles; a usual choice


class Bristle:
    """Carry the bend of the bristles through time."""

    def __init__(self, plant: Plant) -> None:
        self._coulomb = plant.bristle_coulomb_Nm
        self._excess = plant.bristle_static_Nm - plant.bristle_coulomb_Nm
        self._rate = plant.bristle_rate_rad_s
        self._stiffness = plant.bristle_static_Nm / plant.bristle_angle_rad
        self._damping = DAMPING_SHARE * 2.0 * math.sqrt(self._stiffness * plant.inertia_kgm2)
        self.bend_rad = 0.0

    def torque(self, rate_rad_s: float, dt_s: float) -> float:
        """Bend for one step at this rate; return the torque on the beam: N m.

        The bend's own equation is linear at a held rate and is solved exactly, so that fast
        slipping cannot make it unstable.
        """
        ratio = rate_rad_s / self._rate
        holds = self._coulomb + self._excess * math.exp(-ratio * ratio)
        settled = holds / self._stiffness
        speed = abs(rate_rad_s)
        before = self.bend_rad
        if speed * dt_s < 1e-9 * settled:
            self.bend_rad = before + rate_rad_s * dt_s
        else:
            goal = math.copysign(settled, rate_rad_s)
            self.bend_rad = goal + (before - goal) * math.exp(-speed * dt_s / settled)
        bending = (self.bend_rad - before) / dt_s
        # Damping of a slipping bristle fades, as is usual, so that it adds nothing in motion.
        damping = self._damping * math.exp(-ratio * ratio)
        return -(self._stiffness * self.bend_rad + damping * bending)
