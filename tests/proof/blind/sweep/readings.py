"""What a bench truly does at every visit of a sweep, and what its instruments would read.

Everything here is without noise; `table.py` adds it. Rows are visits, tares among them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from tests.proof.blind.sweep.bench import Bench
from tests.proof.blind.sweep.ground import GroundLaw, coefficient, covered_fraction, reynolds_power
from tests.proof.blind.sweep.programme import Programme

Array = NDArray[np.float64]

QUARTER_OF_AN_HOUR_S = 900.0

HOT_RAD_S = 500.0  # speed at which warm blades and motors are as warm as their full loss says


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Columns:
    """Hold what the programme says of each row, (m,) each."""

    turning: NDArray[np.bool_]
    z_m: Array
    x_m: Array
    level_us: Array
    start_s: Array
    middle_s: Array
    tared_s: Array
    still_s: Array
    up_m: Array

    @classmethod
    def of(cls, plan: Programme) -> Columns:
        """Return the columns of a programme."""
        visits = plan.visits
        return cls(
            turning=np.array([visit.kind != "tare" for visit in visits]),
            z_m=np.array([visit.z_m for visit in visits]),
            x_m=np.array([visit.x_m for visit in visits]),
            level_us=np.array([visit.level_us for visit in visits]),
            start_s=np.array([visit.start_s for visit in visits]),
            middle_s=np.array([visit.middle_s for visit in visits]),
            tared_s=np.array([visit.tared_s for visit in visits]),
            still_s=np.array([visit.still_s for visit in visits]),
            up_m=np.array([visit.from_below_m for visit in visits]),
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Drive:
    """Hold what the motors do: speeds (n, m) rad/s, voltage (m,), current (m,)."""

    speed_rad_s: Array
    voltage_V: Array
    current_A: Array


def driven(bench: Bench, rows: Columns) -> Drive:
    """Return what the pulses make of the motors, the supply sagging under them."""
    sheet = bench.layout
    gains = np.array(bench.gain_of_rotor or (1.0,) * sheet.rotors)[:, None]
    late = rows.middle_s / QUARTER_OF_AN_HOUR_S
    loss = bench.sag_per_s * rows.middle_s * (1.0 + bench.sag_curve * (late - 1.0))
    open_V = bench.full_V * (1.0 - loss)
    start_us = sheet.pwm_start_us + bench.pwm_start_off_us
    pulse_us = np.where(rows.turning, np.maximum(rows.level_us - start_us, 0.0), 0.0)
    voltage, current = open_V, np.zeros_like(open_V)
    for _ in range(4):
        speed = gains * sheet.gain_rad_s_us * pulse_us * (voltage / sheet.nominal_V)
        power_W = np.sum(sheet.drag_Nm_s2 * speed**3, axis=0) / sheet.efficiency
        current = power_W / voltage
        voltage = open_V - bench.resistance_ohm * current
    return Drive(speed_rad_s=speed, voltage_V=voltage, current_A=current)


def thrust_N(bench: Bench, rows: Columns, speed_rad_s: Array, scatter_m: Array) -> Array:
    """Return the force on the load cell (m,): N.

    Args:
        bench: the truth.
        rows: of the programme.
        speed_rad_s: true speeds (n, m).
        scatter_m: how far the plate stands off from visit to visit (m,), whatever the cause.
    """
    sheet = bench.layout
    x_m, y_m = sheet.x_m, sheet.y_m
    plate_x = rows.x_m + bench.plate_x0_m
    play = 0.5 * bench.stage_play_m * np.sign(rows.up_m)
    centre = rows.z_m + bench.plate_dz_m - play + scatter_m
    ahead = x_m[:, None] - plate_x
    if bench.plate_yield_m:
        # The dynamic pressure of the wash, which has spread where the plate is far.
        wash = np.sum(speed_rad_s**2, axis=0) * sheet.k_N_s2 / sheet.hover_N
        centre = centre + bench.plate_yield_m * wash / (1.0 + (centre / sheet.radius_m) ** 2)
    height = centre * np.cos(bench.plate_tilt_rad) - ahead * np.sin(bench.plate_tilt_rad)
    height = np.maximum(height, 0.2 * sheet.radius_m)
    half = 0.5 * sheet.plate_m
    area = covered_fraction(x_m[:, None], sheet.radius_m, plate_x - half, plate_x + half)
    law = GroundLaw(
        radius_m=sheet.radius_m * bench.radius_ratio,
        softness=bench.softness,
        near=bench.near,
        neighbours=bench.neighbours,
        K_b=bench.K_b,
    )
    taken = _taken(area, bench.coverage_power)
    factor = 1.0 + taken * (law.factor(height, taken, x_m, y_m) - 1.0)
    # The wake's push on the stand; a near plate takes most of it away.
    recovered = area * 1.2 * np.exp(-((height / sheet.radius_m) ** 1.05))
    factor = factor * (1.0 - bench.blockage * (1.0 - recovered))
    own = np.array(bench.k_of_rotor or (1.0,) * sheet.rotors)[:, None]
    k = sheet.k_N_s2 * bench.k_ratio * own
    k = k * coefficient(speed_rad_s, reynolds_power(bench.exponent_excess))
    if bench.flutter_rad_s:
        # Within a few rpm the blades are in it or not.
        over = 1.0 / (1.0 + np.exp(-(speed_rad_s - bench.flutter_rad_s) / 1.5))
        k = k * (1.0 + bench.flutter_jump * over)
    total = np.sum(k * speed_rad_s**2 * factor, axis=0)
    if bench.warm_loss:
        power = (np.mean(speed_rad_s, axis=0) / HOT_RAD_S) ** 3
        total = total * (1.0 - bench.warm_loss * _followed(rows, power, bench.warm_s))
    total = total * (1.0 - bench.density_loss_per_s * rows.middle_s)
    out: Array = total * (1.0 - bench.room_loss * _come_round(bench, rows, total))
    return out


def _taken(area: Array, power: float) -> Array:
    """Return the share of a disc's image, and of its increment, that a part of the plate makes.

    At quarters of the disc it is a power of the covered fraction, and smooth between them.
    """
    known = np.linspace(0.0, 1.0, 5)
    out: Array = PchipInterpolator(known, known**power)(np.clip(area, 0.0, 1.0))
    return out


def _come_round(bench: Bench, rows: Columns, thrust: Array) -> Array:
    """Return how far the air of a closed room moves with the wake (m,): 0 still, 1 at hover.

    It follows the wake's velocity with a lag, and calms down while the motors stand still.
    """
    if not bench.room_loss:
        return np.zeros(len(thrust))
    wanted = np.sqrt(np.maximum(thrust, 0.0) / bench.layout.hover_N)
    return _followed(rows, wanted, bench.room_s)


def _followed(rows: Columns, wanted: Array, time_s: float) -> Array:
    """Return what follows a quantity (m,) with a lag: 0 at the start, towards 0 while all stands.

    In the middle of each row's samples; a second of the same goes on behind it.
    """
    out, here = np.zeros(len(wanted)), 0.0
    for row, goal in enumerate(wanted):
        here *= np.exp(-rows.still_s[row] / time_s)
        span_s = rows.middle_s[row] - rows.start_s[row]
        here = goal + (here - goal) * np.exp(-span_s / time_s)
        out[row] = here
        here = goal + (here - goal) * np.exp(-1.0 / time_s)
    return out


def cell_N(bench: Bench, rows: Columns, force_N: Array, speed_rad_s: Array) -> Array:
    """Return the load cell's reading (m,): N, of true forces (m,) in the order of the sweep.

    Args:
        speed_rad_s: of the rotors (n, m), which shake the stand.
    """
    sheet = bench.layout
    if bench.shaking_share:
        # Forced by an imbalance, over its value at resonance; the cell's mean goes with the square.
        ratio = speed_rad_s / bench.shaking_rad_s
        twice = 2.0 * bench.shaking_damping
        swing = twice**2 * ratio**4 / ((1.0 - ratio**2) ** 2 + (twice * ratio) ** 2)
        force_N = force_N * (1.0 - bench.shaking_share * np.mean(swing, axis=0))
    if bench.creep_share:
        late = _followed(rows, force_N, bench.creep_s)
        crept = force_N + bench.creep_share * (late - force_N)
        tares = np.maximum.accumulate(np.where(rows.turning, 0, np.arange(len(force_N))))
        force_N = crept - crept[tares]
    half = force_N / sheet.full_scale_N
    strained = force_N + 4.0 * bench.bow_N * half * (1.0 - half)
    if bench.hysteresis_N:
        strained = _behind_play(bench, rows, strained)
    zero_N = bench.tare_N + bench.drift_N_per_s * (rows.middle_s - rows.tared_s)
    reading = strained + zero_N
    if bench.saturation_N:
        # The amplifier rounds its corner over a few per cent.
        corner = 0.02 * bench.saturation_N
        left = np.logaddexp(0.0, (bench.saturation_N - reading) / corner)
        reading = bench.saturation_N - corner * left
    out: Array = reading
    return out


def _behind_play(bench: Bench, rows: Columns, force_N: Array) -> Array:
    """Return what stands behind a play (m,), against what stood there at the tare.

    The cell has been loaded before the sweep begins.
    """

    def half_N(force: float) -> float:
        relative = force / bench.layout.hover_N - 1.0
        return bench.hysteresis_N * (1.0 + bench.hysteresis_slope * relative)

    def dragged(shown: float, force: float) -> float:
        return min(max(shown, force - half_N(force)), force + half_N(force))

    shown = tared = half_N(0.0)
    out = np.empty(len(force_N))
    for row, force in enumerate(force_N):
        if rows.still_s[row] > 0.0:
            shown = dragged(shown, 0.0)
        shown = dragged(shown, float(force))
        if not rows.turning[row]:
            tared = shown
        out[row] = shown - tared
    return out
