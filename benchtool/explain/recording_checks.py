"""Look for readings that no bench gave: wrong units, spikes, sensors that hang or end their range.

Each check returns repaired columns of a recording, with a message. A false alarm costs more
than a fault that is missed here, which still shows as a gap: every check needs a second channel, or
a limit that no bench comes near.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from benchtool.core.array_type import Array
from benchtool.core.errors import InputError
from benchtool.core.plural import pluralize
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig, Sensor

Mask = NDArray[np.bool_]
Repair = tuple[Mapping[str, Array], list[str]]  # new values (n,) by column; messages

RPM_PER_RAD_S = 30.0 / np.pi

UNIT_SHARE = 0.15  # of a speed in rad/s from the map or thrust; assumed
SPIKE = 30.0  # sd beside the median of five; a beam thrown about reaches 20
CURVE = np.array([-0.4, 0.9, 0.0, 0.0, 0.0, 0.9, -0.4])  # cubic through rows 2 and 3 away
MIN_SAMPLES = 0.02  # more rows than this share are no spikes but how the sensor is
FROZEN_TIMEOUT_S = 0.2  # a reading that stays exactly the same for so long may hang; assumed
UNUSUAL = 5.0  # times the usual stay of a reading from which it is frozen; assumed


def repair_readings(recording: Recording, rig: Rig, name: str) -> tuple[Recording, list[str]]:
    """Return a repaired recording, and messages about the repairs.

    Raises:
        InputError: plate distances that no unit makes the rig's.
    """
    remarks: list[str] = []
    kinds = PITCH if "theta_rad" in recording else SWEEP
    for check in kinds:
        columns, messages = check(recording, rig, name)
        remarks += messages
        recording = Recording.from_columns(
            [
                (channel, columns.get(channel.name, recording.column(channel.name)))
                for channel in recording.channels
            ],
            recording.provenance,
            recording.simulated,
        )
    return recording, remarks


def rotor_columns(recording: Recording, what: str = "rpm{}") -> list[str]:
    """Return the channels of one kind, by rotor."""
    pattern = re.compile(re.escape(what).replace(r"\{\}", r"\d+"))
    return [name for name in recording.names if pattern.fullmatch(name)]


def speeds_in_rpm(recording: Recording, rig: Rig, name: str) -> Repair:
    """Convert speeds in rad/s, found by the map from pulse width to speed, else by thrust."""
    columns = rotor_columns(recording)
    if not columns:
        return {}, []
    p, speeds = rig.propulsion, np.array([recording.to_si(column) for column in columns])
    pulses = [column.replace("rpm", "pwm") + "_us" for column in columns]
    turning = np.nan_to_num(speeds) > 0.0
    if all(pulse in recording for pulse in pulses):
        sent = np.array([recording.to_si(pulse) for pulse in pulses]) - p.pwm_start_us
        is_valid = turning & (sent > 0.0)
        share = speeds[is_valid] / (p.speed_per_us_rad_s * sent[is_valid])
    else:
        carried = recording.to_si("thrust_N") if "thrust_N" in recording else np.full(
            len(recording), 9.81 * rig.body.mass_kg
        )  # fmt: skip
        is_valid = turning.all(axis=0)
        makes = p.thrust_coefficient_N_s2 * rig.n_rotors * np.mean(speeds[:, is_valid] ** 2, axis=0)
        share = np.sqrt(makes / np.maximum(carried[is_valid], 1e-9))
    if not len(share) or abs(np.median(share) * RPM_PER_RAD_S - 1.0) > UNIT_SHARE:
        return {}, []
    many = [*columns, *rotor_columns(recording, "rpm{}_se")]
    return {column: RPM_PER_RAD_S * recording.column(column) for column in many}, [
        f"{', '.join(columns)}: {float(np.median(share)):.3f} of the speed that rig {rig.name} has "
        f"at these pulses (1 in rpm, {1.0 / RPM_PER_RAD_S:.3f} in rad/s): taken for rad/s; state "
        f'unit = "rad/s" in the model\'s [columns]'
    ]


def plate_in_metres(recording: Recording, rig: Rig, name: str) -> Repair:
    """Convert plate distances in millimetres or centimetres.

    Raises:
        InputError: distances beyond the plate's travel in every unit.
    """
    if "plate_z_m" not in recording:
        return {}, []
    distances = recording.to_si("plate_z_m")
    distances = distances[np.isfinite(distances)]
    if (
        not len(distances)
        or distances.min() < 5.0 * rig.plate.z_max_m
        or distances.min() > 0.6 * distances.max()
    ):
        return {}, []
    nearest = float(distances.min())
    fits = {
        unit: factor
        for unit, factor in (("mm", 1e-3), ("cm", 1e-2))
        if 0.5 * rig.plate.z_min_m <= factor * nearest
        and factor * distances.max() <= 1.3 * rig.plate.z_max_m
    }
    if len(fits) != 1:
        raise InputError(
            f"plate_z_m of {name} is never below {nearest:.4g} m, and the plate of rig {rig.name} "
            f"travels from {rig.plate.z_min_m:g} to {rig.plate.z_max_m:g} m; state the column's "
            f"unit in the model's [columns]"
        )
    ((unit, factor),) = fits.items()
    return {"plate_z_m": factor * recording.column("plate_z_m")}, [
        f"plate_z_m is never below {nearest:.4g} m and the plate travels to {rig.plate.z_max_m:g} "
        f'm: taken for {unit}; state unit = "{unit}" in the model\'s [columns]'
    ]


def remove_beam_spikes(recording: Recording, rig: Rig, name: str) -> Repair:
    """Blank single readings far beside those before and after."""
    columns, messages = {}, []
    for channel in _read_at_moments(recording):
        values, rows = _known(recording, channel)
        if len(values) < 50:
            continue
        # An extreme of a smooth curve lies beside its median, a spike beside its curve, too.
        deviation = np.abs(values - median_filter(values, 5, mode="nearest"))
        deviation = np.minimum(
            deviation, np.abs(values - np.convolve(np.pad(values, 3, mode="edge"), CURVE, "valid"))
        )
        usual = max(1.4826 * float(np.median(deviation)), _noise(recording, rig, channel))
        spike = deviation > SPIKE * usual
        if spike.any() and spike.mean() <= MIN_SAMPLES:
            columns[channel] = _blanked(recording, channel, rows[spike])
            messages.append(
                f"{pluralize(int(spike.sum()), 'spike')} of {channel}, the greatest "
                f"{float(deviation.max()) / usual:.0f} standard deviations beside its neighbours "
                f"(limit {SPIKE:g}): left out"
            )
    return columns, messages


def find_frozen_sensors(recording: Recording, rig: Rig, name: str) -> Repair:
    """Blank readings that stay the same while another channel shows that they cannot."""
    columns, messages = {}, []
    time_s = recording.to_si("time_s")
    for channel in _read_at_moments(recording):
        values, rows_known = _known(recording, channel)
        if len(values) < 50:
            continue
        step_s = float(np.nanmedian(np.diff(time_s[rows_known])))
        starts = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)
        lengths = np.diff([*starts, len(values)])
        usual = float(np.quantile(np.repeat(lengths, lengths), 0.5))
        hung = np.zeros(len(values), bool)
        ends = (values == values.max()) | (values == values.min())
        long = (lengths * step_s > FROZEN_TIMEOUT_S) & (lengths > UNUSUAL * usual)
        clipped = (lengths >= 3) & ends[starts] & (usual < 2.0)
        for first, rows in zip(starts[long | clipped], lengths[long | clipped], strict=True):
            span = slice(first, first + rows)
            hung[span] = _moves(recording, channel, rows_known[span], rig)
        at_end = hung & ends
        if hung.sum() * step_s < FROZEN_TIMEOUT_S / 4.0:
            continue
        columns[channel] = _blanked(recording, channel, rows_known[hung])
        what = "ends its range" if at_end.sum() > 0.5 * hung.sum() else "hangs"
        messages.append(
            f"{channel} {what} at {values[hung][0]:.4g} for {hung.sum() * step_s:.2f} s in all, "
            f"first at {time_s[rows_known[hung][0]]:.3f} s, while the beam or pulses move: left out"
        )
    return columns, messages


def _moves(recording: Recording, channel: str, rows: NDArray[np.intp], rig: Rig) -> bool:
    """Return whether another channel disproves a constant reading in some rows."""
    theta, gyro = (
        recording.to_si(name) if name in recording else np.full(len(recording), np.nan)
        for name in ("theta_rad", "gyro_rad_s")
    )
    time_s = recording.to_si("time_s")
    if channel == "theta_rad":
        turned = gyro[rows][np.isfinite(gyro[rows])]
        if len(turned) < 3:
            return False
        return bool(
            abs(np.median(turned)) > 0.5 * np.nanstd(gyro)
            or np.ptp(_smooth(turned)) > np.nanstd(gyro)
        )
    if channel == "gyro_rad_s":
        seen = np.isfinite(theta[rows])
        if seen.sum() < 3:
            return False
        at, angle = time_s[rows][seen], theta[rows][seen]
        missed = angle - angle[0] - gyro[rows[0]] * (at - at[0])
        limit = 10.0 * _noise(recording, rig, "theta_rad") + 0.1 * abs(gyro[rows[0]]) * (
            at[-1] - at[0]
        )
        return bool(np.abs(missed).max() > limit)
    pulse = channel.replace("rpm", "pwm") + "_us"
    if pulse not in recording:
        return False
    p = rig.propulsion
    sent = recording.to_si(pulse)[rows] - p.pwm_start_us
    sent = _smooth(sent[np.isfinite(sent)])
    return len(sent) > 20 and bool(np.ptp(sent) > 0.05 * np.median(sent))


def _smooth(values: Array) -> Array:
    width = min(len(values), 25)
    return np.convolve(values, np.ones(width) / width, "valid")


def _read_at_moments(recording: Recording) -> Iterable[str]:
    beam = [name for name in ("theta_rad", "gyro_rad_s") if name in recording]
    return [*beam, *rotor_columns(recording)]


def _known(recording: Recording, channel: str) -> tuple[Array, NDArray[np.intp]]:
    """Return the readings of a channel, in its own unit, and their rows."""
    values = recording.column(channel)
    rows = np.flatnonzero(np.isfinite(values))
    return values[rows], rows


def _blanked(recording: Recording, channel: str, rows: NDArray[np.intp]) -> Array:
    values = recording.column(channel).copy()
    values[rows] = np.nan
    return values


def _noise(recording: Recording, rig: Rig, channel: str) -> float:
    """Return the noise of one reading, its quantum included; never quite 0."""
    sensor = rig.sensors.get("rpm" if channel.startswith("rpm") else channel, Sensor())
    return float(max(np.hypot(sensor.noise, sensor.quantum), 1e-6))


SAME = 0.15  # departure of thrust over squared speed at one place: a spike; assumed


def remove_sweep_spikes(recording: Recording, rig: Rig, name: str) -> Repair:
    """Blank points whose thrust no other point of the same place comes near."""
    share, running = _thrust_shares(recording)
    if "plate_z_m" not in recording or running.sum() < 8:
        return {}, []
    columns = [group for group in ("plate_z_m", "plate_x_m", "plate_y_m") if group in recording]
    positions = np.round(np.nan_to_num([recording.to_si(column) for column in columns]), 4)
    number = np.unique(positions, axis=1, return_inverse=True)[1].reshape(-1)
    spike = np.zeros(len(recording), bool)
    for group in np.unique(number[running]):
        rows = np.flatnonzero(running & (number == group))
        middle = np.median(share[rows])
        deviation = np.abs(share[rows] / middle - 1.0)
        if (
            len(rows) >= 4
            and (deviation > SAME).sum() == 1
            and deviation.max() > 5.0 * np.median(deviation)
        ):
            spike[rows[int(np.argmax(deviation))]] = True
    if not spike.any() or spike.sum() > max(1.0, MIN_SAMPLES * running.sum()):
        return {}, []
    at = np.flatnonzero(spike)
    return {"thrust_N": _blanked(recording, "thrust_N", at)}, [
        f"{pluralize(len(at), 'spike')} of thrust_N, more than {100.0 * SAME:g} % beside every "
        f"other point of its place (the first in row {1 + at[0]}): left out"
    ]


def find_frozen_load_cell(recording: Recording, rig: Rig, name: str) -> Repair:
    """Blank thrusts that are exactly alike while speeds are not: a cell that hangs or is full."""
    _, running = _thrust_shares(recording)
    rows = np.flatnonzero(running)
    if len(rows) < 8:
        return {}, []
    thrust = recording.column("thrust_N")[rows]
    squares = np.sum(
        [recording.to_si(column)[rows] ** 2 for column in rotor_columns(recording)], axis=0
    )
    hung = np.zeros(len(rows), bool)
    for value in np.unique(thrust):
        alike = thrust == value
        if alike.sum() >= 3 and np.ptp(squares[alike]) > 0.1 * squares[alike].mean():
            hung |= alike
    if not hung.any():
        return {}, []
    what = "ends its range" if (thrust[hung] == thrust.max()).all() else "hangs"
    return {"thrust_N": _blanked(recording, "thrust_N", rows[hung])}, [
        f"thrust_N {what} at {thrust[hung][0]:.4g} N in {pluralize(int(hung.sum()), 'point')} "
        f"whose speeds differ by more than 5 %: left out"
    ]


def _thrust_shares(recording: Recording) -> tuple[Array, Mask]:
    """Return thrust over the sum of squared speeds (n,), and which rows have both."""
    columns = rotor_columns(recording)
    if not columns or "thrust_N" not in recording:
        return np.zeros(len(recording)), np.zeros(len(recording), bool)
    squares = np.sum([recording.to_si(column) ** 2 for column in columns], axis=0)
    thrust = recording.to_si("thrust_N")
    running = np.isfinite(squares) & np.isfinite(thrust) & (np.nan_to_num(squares) > 0.0)
    return thrust / np.where(running, squares, 1.0), running


Check = Callable[[Recording, Rig, str], Repair]

PITCH: tuple[Check, ...] = (plate_in_metres, speeds_in_rpm, find_frozen_sensors, remove_beam_spikes)
SWEEP: tuple[Check, ...] = (
    plate_in_metres,
    speeds_in_rpm,
    find_frozen_load_cell,
    remove_sweep_spikes,
)
"""Checks in order: units before checks of magnitude."""


OTHER_BENCH_HINT = {"speed over pulse": 1.25}  # never within one bench: full battery over empty
USUALLY = 1.2  # the same of everything else; good pairs of recordings differ by 1 %


def check_bench_kind(benches: Iterable[tuple[str, Mapping[str, float]]]) -> None:
    """Refuse recordings of different benches.

    Raises:
        InputError: a number that differs from that of the first by more than a bench's does.
    """
    (first, own), *others = benches
    for name, numbers in others:
        for what in (one for one in own if one in numbers):
            ratio, most = numbers[what] / own[what], OTHER_BENCH_HINT.get(what, USUALLY)
            if not 1.0 / most < ratio < most:
                raise InputError(
                    f"{what} in {name} is {ratio:.2f} times that in {first}, and on one bench it "
                    f"stays within {1.0 / most:.2f} to {most:.2f} times; name recordings of "
                    f"one bench, with the same rotors and rig"
                )
