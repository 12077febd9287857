"""Checks and repairs of recordings: wrong units, spikes, frozen and saturated sensors.

Each check returns repaired columns with messages. A false alarm costs more than a missed fault,
which still appears as a gap, so every check uses a second channel or an implausible limit.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from benchtool.core.errors import InputError
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig, Sensor
from benchtool.core.text import pluralize
from benchtool.core.units import Array

Mask = NDArray[np.bool_]
Repair = tuple[Mapping[str, Array], list[str]]  # new values (n,) by column; messages

RPM_PER_RAD_S = 30.0 / np.pi

MAX_UNIT_DEVIATION = 0.15  # relative, of speeds in rad/s from the map or thrust; assumed
MIN_SPIKE = 30.0  # sd from the median of five; a beam moved by hand reaches 20
CURVE = np.array([-0.4, 0.9, 0.0, 0.0, 0.0, 0.9, -0.4])  # cubic through rows 2 and 3 away
MAX_SPIKE_SHARE = 0.02  # of rows; more are a property of the sensor
MIN_ROWS = 50  # of a beam or rotor channel, to be checked; assumed
FROZEN_TIMEOUT_S = 0.2  # a constant reading may be frozen after this time; assumed
FROZEN_FACTOR = 5.0  # times the median duration of equal readings; longer ones are frozen; assumed


def repair_readings(recording: Recording, rig: Rig, name: str) -> tuple[Recording, list[str]]:
    """Return a repaired recording and messages about the repairs.

    Raises:
        InputError: plate distances beyond the rig's travel range in every unit.
    """
    remarks: list[str] = []
    for check in PITCH_CHECKS if "theta_rad" in recording else SWEEP_CHECKS:
        repaired, messages = check(recording, rig, name)
        remarks += messages
        columns = [(c, repaired.get(c.name, recording.column(c.name))) for c in recording.channels]
        recording = Recording.from_columns(columns, recording.provenance, recording.simulated)
    return recording, remarks


def rotor_columns(recording: Recording, template: str = "rpm{}") -> list[str]:
    """Return the channels of all rotors with names like the template."""
    pattern = re.compile(re.escape(template).replace(r"\{\}", r"\d+"))
    return [name for name in recording.names if pattern.fullmatch(name)]


def speeds_in_rpm(recording: Recording, rig: Rig, name: str) -> Repair:
    """Convert speeds in rad/s, detected from pulse widths, else from thrust."""
    columns = rotor_columns(recording)
    if not columns:
        return {}, []
    p, speeds = rig.propulsion, np.array([recording.to_si(column) for column in columns])
    pulses = [column.replace("rpm", "pwm") + "_us" for column in columns]
    is_turning = np.nan_to_num(speeds) > 0.0
    if all(pulse in recording for pulse in pulses):
        effective_us = np.array([recording.to_si(pulse) for pulse in pulses]) - p.pwm_start_us
        is_valid = is_turning & (effective_us > 0.0)
        ratio = speeds[is_valid] / (p.speed_per_us_rad_s * effective_us[is_valid])
    else:
        thrust = np.full(len(recording), 9.81 * rig.body.mass_kg)
        if "thrust_N" in recording:
            thrust = recording.to_si("thrust_N")
        is_valid = is_turning.all(axis=0)
        k = p.thrust_coefficient_N_s2 * rig.n_rotors
        expected = k * np.mean(speeds[:, is_valid] ** 2, axis=0)
        ratio = np.sqrt(expected / np.maximum(thrust[is_valid], 1e-9))
    if not len(ratio) or abs(np.median(ratio) * RPM_PER_RAD_S - 1.0) > MAX_UNIT_DEVIATION:
        return {}, []
    with_errors = [*columns, *rotor_columns(recording, "rpm{}_se")]
    return {column: RPM_PER_RAD_S * recording.column(column) for column in with_errors}, [
        f"{', '.join(columns)}: {float(np.median(ratio)):.3f} of the speed of rig {rig.name} at "
        f"these pulse widths (1 in rpm, {1.0 / RPM_PER_RAD_S:.3f} in rad/s): converted from rad/s; "
        f'set unit = "rad/s" in the model\'s [columns]'
    ]


def plate_in_metres(recording: Recording, rig: Rig, name: str) -> Repair:
    """Convert plate distances in mm or cm; InputError if beyond the travel range in any unit."""
    if "plate_z_m" not in recording:
        return {}, []
    distances = recording.to_si("plate_z_m")
    distances = distances[np.isfinite(distances)]
    z_min_m, z_max_m = rig.plate.z_min_m, rig.plate.z_max_m
    if not len(distances) or distances.min() < 5.0 * z_max_m:
        return {}, []
    nearest, farthest = float(distances.min()), float(distances.max())
    if nearest > 0.6 * farthest:
        return {}, []
    factors = {
        unit: factor
        for unit, factor in (("mm", 1e-3), ("cm", 1e-2))
        if 0.5 * z_min_m <= factor * nearest and factor * farthest <= 1.3 * z_max_m
    }
    if len(factors) != 1:
        raise InputError(
            f"plate_z_m of {name} is at least {nearest:.4g} m; travel range of the plate of rig "
            f"{rig.name}: {z_min_m:g} to {z_max_m:g} m; set the column's unit in the model's "
            f"[columns]"
        )
    ((unit, factor),) = factors.items()
    return {"plate_z_m": factor * recording.column("plate_z_m")}, [
        f"plate_z_m is at least {nearest:.4g} m, beyond the plate's travel range to {z_max_m:g} m: "
        f'converted from {unit}; set unit = "{unit}" in the model\'s [columns]'
    ]


def remove_beam_spikes(recording: Recording, rig: Rig, name: str) -> Repair:
    """Remove spikes of beam and rotor channels (set to nan)."""
    columns, messages = {}, []
    for channel, values, rows in _checked_channels(recording):
        # A smooth extreme deviates from the median of five, but not from the cubic; a spike does.
        deviation = np.abs(values - median_filter(values, 5, mode="nearest"))
        cubic = np.convolve(np.pad(values, 3, mode="edge"), CURVE, "valid")
        deviation = np.minimum(deviation, np.abs(values - cubic))
        sd = max(1.4826 * float(np.median(deviation)), _noise(recording, rig, channel))
        is_spike = deviation > MIN_SPIKE * sd
        if is_spike.any() and is_spike.mean() <= MAX_SPIKE_SHARE:
            columns[channel] = _with_nan(recording, channel, rows[is_spike])
            messages.append(
                f"{pluralize(int(is_spike.sum()), 'spike')} of {channel}, the largest "
                f"{float(deviation.max()) / sd:.0f} standard deviations from its neighbours "
                f"(limit {MIN_SPIKE:g}): removed"
            )
    return columns, messages


def find_frozen_sensors(recording: Recording, rig: Rig, name: str) -> Repair:
    """Remove frozen readings (set to nan): constant while another channel shows a change."""
    columns, messages = {}, []
    time_s = recording.to_si("time_s")
    for channel, values, rows in _checked_channels(recording):
        step_s = float(np.nanmedian(np.diff(time_s[rows])))
        starts = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)
        lengths = np.diff([*starts, len(values)])
        median = float(np.quantile(np.repeat(lengths, lengths), 0.5))
        is_frozen = np.zeros(len(values), bool)
        is_extreme = (values == values.max()) | (values == values.min())
        is_long = (lengths * step_s > FROZEN_TIMEOUT_S) & (lengths > FROZEN_FACTOR * median)
        is_checked = is_long | ((lengths >= 3) & is_extreme[starts] & (median < 2.0))
        for first, length in zip(starts[is_checked], lengths[is_checked], strict=True):
            span = slice(first, first + length)
            is_frozen[span] = _is_disproved(recording, channel, rows[span], rig)
        duration_s = is_frozen.sum() * step_s
        if duration_s < FROZEN_TIMEOUT_S / 4.0:
            continue
        columns[channel] = _with_nan(recording, channel, rows[is_frozen])
        is_saturated = (is_frozen & is_extreme).sum() > 0.5 * is_frozen.sum()
        messages.append(
            f"{channel} {'saturates' if is_saturated else 'is frozen'} at "
            f"{values[is_frozen][0]:.4g} for a total of {duration_s:.2f} s, first at "
            f"{time_s[rows[is_frozen][0]]:.3f} s, while beam or pulse widths change: removed"
        )
    return columns, messages


def _is_disproved(recording: Recording, channel: str, rows: NDArray[np.intp], rig: Rig) -> bool:
    """Return True if another channel disproves a constant reading in some rows."""
    theta, gyro = (
        recording.to_si(name) if name in recording else np.full(len(recording), np.nan)
        for name in ("theta_rad", "gyro_rad_s")
    )
    time_s = recording.to_si("time_s")
    if channel == "theta_rad":
        rates = gyro[rows][np.isfinite(gyro[rows])]
        if len(rates) < 3:
            return False
        sd = np.nanstd(gyro)
        return bool(abs(np.median(rates)) > 0.5 * sd or np.ptp(_smooth(rates)) > sd)
    if channel == "gyro_rad_s":
        is_finite = np.isfinite(theta[rows])
        if is_finite.sum() < 3:
            return False
        rate, at, angle = gyro[rows[0]], time_s[rows][is_finite], theta[rows][is_finite]
        deviation = angle - angle[0] - rate * (at - at[0])
        limit = 10.0 * _noise(recording, rig, "theta_rad") + 0.1 * abs(rate) * (at[-1] - at[0])
        return bool(np.abs(deviation).max() > limit)
    pulse = channel.replace("rpm", "pwm") + "_us"
    if pulse not in recording:
        return False
    effective_us = recording.to_si(pulse)[rows] - rig.propulsion.pwm_start_us
    smooth_us = _smooth(effective_us[np.isfinite(effective_us)])
    return len(smooth_us) > 20 and bool(np.ptp(smooth_us) > 0.05 * np.median(smooth_us))


def _smooth(values: Array) -> Array:
    width = min(len(values), 25)
    return np.convolve(values, np.ones(width) / width, "valid")


def _checked_channels(recording: Recording) -> Iterator[tuple[str, Array, NDArray[np.intp]]]:
    """Yield beam and rotor channels, their finite values in their own unit, and their rows."""
    beam = [name for name in ("theta_rad", "gyro_rad_s") if name in recording]
    for channel in (*beam, *rotor_columns(recording)):
        values = recording.column(channel)
        rows = np.flatnonzero(np.isfinite(values))
        if len(rows) >= MIN_ROWS:
            yield channel, values[rows], rows


def _with_nan(recording: Recording, channel: str, rows: NDArray[np.intp]) -> Array:
    values = recording.column(channel).copy()
    values[rows] = np.nan
    return values


def _noise(recording: Recording, rig: Rig, channel: str) -> float:
    """Return noise and resolution of one reading, combined; at least 1e-6."""
    sensor = rig.sensors.get("rpm" if channel.startswith("rpm") else channel, Sensor())
    return float(max(np.hypot(sensor.noise, sensor.quantum), 1e-6))


MIN_THRUST_SPIKE = 0.15  # relative deviation of thrust over squared speed at a position; assumed


def remove_sweep_spikes(recording: Recording, rig: Rig, name: str) -> Repair:
    """Remove thrusts far from all others at the same plate position (set to nan)."""
    ratio, is_running = _thrust_over_squares(recording)
    if "plate_z_m" not in recording or is_running.sum() < 8:
        return {}, []
    columns = [name for name in ("plate_z_m", "plate_x_m", "plate_y_m") if name in recording]
    positions = np.round(np.nan_to_num([recording.to_si(column) for column in columns]), 4)
    groups = np.unique(positions, axis=1, return_inverse=True)[1].reshape(-1)
    spikes = list[int]()
    for group in np.unique(groups[is_running]):
        rows = np.flatnonzero(is_running & (groups == group))
        deviation = np.abs(ratio[rows] / np.median(ratio[rows]) - 1.0)
        is_single = len(rows) >= 4 and (deviation > MIN_THRUST_SPIKE).sum() == 1
        if is_single and deviation.max() > 5.0 * np.median(deviation):
            spikes.append(int(rows[int(np.argmax(deviation))]))
    if not spikes or len(spikes) > max(1.0, MAX_SPIKE_SHARE * is_running.sum()):
        return {}, []
    at = np.array(sorted(spikes))
    return {"thrust_N": _with_nan(recording, "thrust_N", at)}, [
        f"{pluralize(len(at), 'spike')} of thrust_N, more than {100.0 * MIN_THRUST_SPIKE:g} % from "
        f"the median at its plate position (the first in row {1 + at[0]}): removed"
    ]


def find_frozen_load_cell(recording: Recording, rig: Rig, name: str) -> Repair:
    """Remove thrusts of a frozen or saturated load cell (set to nan): equal at unequal speeds."""
    _, is_running = _thrust_over_squares(recording)
    rows = np.flatnonzero(is_running)
    if len(rows) < 8:
        return {}, []
    thrust = recording.column("thrust_N")[rows]
    speeds = [recording.to_si(column)[rows] for column in rotor_columns(recording)]
    squares = np.sum([speed**2 for speed in speeds], axis=0)
    is_frozen = np.zeros(len(rows), bool)
    for value in np.unique(thrust):
        is_equal = thrust == value
        if is_equal.sum() >= 3 and np.ptp(squares[is_equal]) > 0.1 * squares[is_equal].mean():
            is_frozen |= is_equal
    if not is_frozen.any():
        return {}, []
    value = thrust[is_frozen][0]
    fault = "saturates" if (thrust[is_frozen] == thrust.max()).all() else "is frozen"
    return {"thrust_N": _with_nan(recording, "thrust_N", rows[is_frozen])}, [
        f"thrust_N {fault} at {value:.4g} N in {pluralize(int(is_frozen.sum()), 'point')} whose "
        f"speeds differ by more than 5 %: removed"
    ]


def _thrust_over_squares(recording: Recording) -> tuple[Array, Mask]:
    """Return thrust over the sum of squared speeds (n,), and the mask of rows with both."""
    columns = rotor_columns(recording)
    if not columns or "thrust_N" not in recording:
        return np.zeros(len(recording)), np.zeros(len(recording), bool)
    squares = np.sum([recording.to_si(column) ** 2 for column in columns], axis=0)
    thrust = recording.to_si("thrust_N")
    is_running = np.isfinite(squares) & np.isfinite(thrust) & (np.nan_to_num(squares) > 0.0)
    return thrust / np.where(is_running, squares, 1.0), is_running


Check = Callable[[Recording, Rig, str], Repair]

UNIT_CHECKS: tuple[Check, ...] = (plate_in_metres, speeds_in_rpm)  # before other checks
PITCH_CHECKS = (*UNIT_CHECKS, find_frozen_sensors, remove_beam_spikes)
SWEEP_CHECKS = (*UNIT_CHECKS, find_frozen_load_cell, remove_sweep_spikes)


MAX_RATIOS = {"speed over pulse": 1.25}  # on one bench, from full to empty battery
DEFAULT_MAX_RATIO = 1.2  # of other properties; good pairs of recordings differ by 1 %


def check_bench_kind(benches: Iterable[tuple[str, Mapping[str, float]]]) -> None:
    """Raise an InputError if properties of recordings differ by more than those of one bench.

    `benches` contains the name of each recording and its properties by name.
    """
    (first_name, first), *others = benches
    for name, properties in others:
        for key in (key for key in first if key in properties):
            ratio, limit = properties[key] / first[key], MAX_RATIOS.get(key, DEFAULT_MAX_RATIO)
            if not 1.0 / limit < ratio < limit:
                raise InputError(
                    f"{key} in {name} is {ratio:.2f} times that in {first_name}; allowed on one "
                    f"bench: {1.0 / limit:.2f} to {limit:.2f}; use recordings of one bench with "
                    f"the same rotors and rig"
                )
