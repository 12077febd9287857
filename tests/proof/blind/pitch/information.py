"""What a part of a record can tell about the true model: its Fisher information.

The data are split into windows of a second. In each, what the instruments show is the true model's
motion, plus what the wake torque makes of it (an Ornstein-Uhlenbeck torque through the linearised
bench), plus sensor noise, plus a start known as well as one reading tells it. Wake and start make
a full covariance; that is why thousands of samples tell no more than some hundreds would. What
links one window to the next is not used, so that the figures are rather too small than too great.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from tests.proof.blind.fisher import evidence_against
from tests.proof.blind.pitch.gap import CHANNELS, WINDOW_S, shown
from tests.proof.blind.pitch.library import NAMED
from tests.proof.blind.pitch.loop import Part
from tests.proof.blind.pitch.moving import ground_factor
from tests.proof.blind.pitch.plant import Plant
from tests.proof.blind.pitch.sheet import PARKED_M, SHEET

Array = NDArray[np.float64]

NUISANCES = ("inertia", "ground_coefficient", "rpm_gain")
"""Not known exactly either: in units of 5 %, 5 % and 0.3 %."""

NAMES = (*NAMED, *NUISANCES)
LOWEST = dict.fromkeys(NUISANCES, -1.0) | {
    name: -1.0 if effect.most_below else -1e-6 for name, effect in NAMED.items()
}
HIGHEST = dict.fromkeys(NUISANCES, 1.0) | {
    name: 1.0 if effect.most_above else 1e-6 for name, effect in NAMED.items()
}
"""What physics allows, in tolerances; a free effect reaches as far as it likes on that side."""

STEP = 0.003  # step of the differences, in tolerances: small, for friction bends the answer early
SMOOTH_RAD_S = 0.02  # width of the friction that is differentiated: one that sticks has no slope


def _with_noise(sd: float, quantum: float) -> float:
    return math.hypot(sd, quantum / math.sqrt(12.0))


NOISE = np.array(
    [
        _with_noise(SHEET.sd_theta, SHEET.q_theta),
        _with_noise(SHEET.sd_gyro, SHEET.q_gyro),
        _with_noise(SHEET.sd_rpm, SHEET.q_rpm),
        _with_noise(SHEET.sd_rpm, SHEET.q_rpm),
    ]
)


@dataclass(frozen=True, slots=True, eq=False)
class Information:
    """Hold what data tell about a true model."""

    matrix: Array  # (k, k) Fisher information about NAMES, each in tolerances of its own
    sizes: Array  # (k,) true values, in tolerances past neutral

    def __add__(self, other: Information) -> Information:
        return Information(self.matrix + other.matrix, self.sizes)

    def evidence(self, rivals: Iterable[str] = ()) -> float:
        """Return how clearly the data speak against a model with other effects than the true ones.

        The figure is twice the log-likelihood ratio that the truth has on average, to second order,
        over the best model in which the rivals are free and everything else, the true effects too,
        lies within its tolerance. Below some units nobody could tell the two apart.
        """
        free = set(rivals)
        low = np.array([LOWEST[name] * (np.inf if name in free else 1.0) for name in NAMES])
        high = np.array([HIGHEST[name] * (np.inf if name in free else 1.0) for name in NAMES])
        return evidence_against(self.matrix, self.sizes, low, high)


def moved(plant: Plant, name: str, by: float) -> Plant:
    """Return a plant with one thing moved by so many of its tolerances."""
    if name == "inertia":
        return replace(plant, inertia_kgm2=plant.inertia_kgm2 * (1.0 + 0.05 * by))
    if name == "ground_coefficient":
        return replace(plant, ge_rho=plant.ge_rho * (1.0 + 0.05 * by))
    if name == "rpm_gain":
        one, two = plant.rpm_per_us
        return replace(plant, rpm_per_us=(one * (1.0 + 0.003 * by), two * (1.0 + 0.003 * by)))
    named = NAMED[name]
    value = getattr(plant, named.field)
    return named.put_into(plant, value + by * named.tolerance)


def information(part: Part, truth: Plant) -> Information:
    """Return what one part tells about the true model."""
    smooth = replace(truth, friction_law="smooth", friction_width_rad_s=SMOOTH_RAD_S)
    base = shown(part, truth, smooth)
    slopes = np.array(
        [(shown(part, truth, moved(smooth, name, STEP)) - base) / STEP for name in NAMES]
    )
    total = np.zeros((len(NAMES), len(NAMES)))
    for rows in windows(len(part.states)):
        white = whitened(slopes[:, :, rows], part, truth, rows)
        total += white @ white.T
    return Information(total, sizes(truth))


def sizes(plant: Plant) -> Array:
    """Return a plant's departures from neutral, in tolerances (k,)."""
    named = [(getattr(plant, one.field) - one.neutral) / one.tolerance for one in NAMED.values()]
    gain = float(np.mean(plant.rpm_per_us)) / SHEET.rpm_per_us
    others = [
        (plant.inertia_kgm2 / SHEET.J - 1.0) / 0.05,
        (plant.ge_rho / SHEET.ge_rho - 1.0) / 0.05,
        (gain - 1.0) / 0.003,
    ]
    return np.array([*named, *others])


def windows(n: int) -> list[slice]:
    """Return the windows of a part of n rows."""
    span = round(WINDOW_S / SHEET.dt)
    return [slice(start, min(start + span, n)) for start in range(0, n, span)]


def whitened(values: Array, part: Part, truth: Plant, rows: slice) -> Array:
    """Return departures (k, channels, m) of a window as white ones of unit variance (k, 4 m).

    A Kalman filter of the linearised bench does it: what it did not expect, in its own deviations.
    """
    k, _, m = values.shape
    system = _linearised(part, truth, rows)
    moving = expm(system * SHEET.dt)
    kick = _wake_kick(system, truth)
    seen = np.array([[1.0, 0.0, 0.0], [0.0, truth.gyro_scale, 0.0]])
    noise = np.diag(NOISE[:2] ** 2)
    doubt = np.diag([NOISE[0] ** 2, NOISE[1] ** 2, truth.wake_sd_Nm**2])
    state = np.zeros((3, k))
    out = np.empty((4, m, k))
    for row in range(m):
        shared = doubt @ seen.T
        spread = seen @ shared + noise
        unexpected = values[:, :2, row].T - seen @ state
        first = math.sqrt(spread[0, 0])
        across = spread[0, 1] / first
        second = math.sqrt(spread[1, 1] - across * across)
        out[0, row] = unexpected[0] / first
        out[1, row] = (unexpected[1] - across * out[0, row]) / second
        gain = np.linalg.solve(spread, shared.T).T
        state = moving @ (state + gain @ unexpected)
        doubt = moving @ (doubt - gain @ shared.T) @ moving.T + kick
    out[2:] = np.transpose(values[:, 2:] / NOISE[2:, None], (1, 2, 0))
    return out.reshape(4 * m, k).T


def _wake_kick(system: Array, truth: Plant) -> Array:
    """Return what the wake torque adds in one sample to the state's covariance (Van Loan 1978)."""
    drive = np.zeros((3, 3))
    drive[2, 2] = 2.0 * truth.wake_sd_Nm**2 / truth.wake_tau_s
    block = np.block([[-system, drive], [np.zeros((3, 3)), system.T]])
    whole = expm(block * SHEET.dt)
    kick: Array = whole[3:, 3:].T @ whole[:3, 3:]
    return kick


def _linearised(part: Part, truth: Plant, rows: slice) -> Array:
    """Return d/dt of (angle, rate, wake torque) about a window's mean motion."""
    middle = part.states[rows]
    theta = float(np.mean([state.positions[0] for state in middle]))
    rpm = float(np.mean([state.speed_rpm for state in middle]))
    thrust_N = SHEET.kT * rpm**2
    stiffness = truth.stiffness_Nm_per_rad + SHEET.m * SHEET.g * truth.cog_below_m
    plates = part.plate_m[rows]
    inside = float(np.mean(plates < PARKED_M))
    if inside:
        gap_m = float(plates[plates < PARKED_M].mean()) + truth.plate_dz_m
        gap_m += SHEET.L * math.sin(theta)
        nearer, farther = (ground_factor(gap_m + d, truth)[0] for d in (-1e-4, 1e-4))
        slope = (farther - nearer) / 2e-4
        stiffness -= inside * SHEET.L**2 * thrust_N * slope
    tip_m_s = rpm * 2.0 * math.pi / 60.0 * SHEET.R
    damping = truth.damping_Nms + truth.aero_damping * 2.0 * SHEET.L**2 * thrust_N / tip_m_s
    inertia = truth.inertia_kgm2
    return np.array(
        [
            [0.0, 1.0, 0.0],
            [-stiffness / inertia, -damping / inertia, 1.0 / inertia],
            [0.0, 0.0, -1.0 / truth.wake_tau_s],
        ]
    )


def surprise(part: Part, truth: Plant) -> float:
    """Return chi-squared per reading of the true model's misses; near 1 if all this is right."""
    misses = part.table[list(CHANNELS)].to_numpy().T - shown(part, truth, truth)
    found = [
        whitened(misses[None, :, rows], part, truth, rows) for rows in windows(misses.shape[1])
    ]
    return float(np.mean(np.concatenate(found, axis=1) ** 2))
