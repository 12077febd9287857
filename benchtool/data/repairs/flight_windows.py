"""Parts of a flight: windows with a rotor over a surface, and points from steady hover."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from math import isfinite

import numpy as np

from benchtool.core.channel import Channel
from benchtool.core.errors import InputError
from benchtool.core.text import pluralize
from benchtool.core.units import STANDARD_GRAVITY_M_S2, Array
from benchtool.data.columns import speed_columns
from benchtool.data.repairs.import_result import Finding, ImportResult, Window

_ROTOR = re.compile(r"(?:pwm|rpm|motor)(\d+)(?:_us|_share)?")

MAX_GAP_S = 1.0  # a longer dropout of the sensor ends a window (10 Hz is usual); assumed


def parse_window(text: str) -> Window:
    """Parse a window START:END:ROTOR, for example `12.5:18:1`; rotor `all` or 0 means all."""
    parts = text.split(":")
    wrong = ""
    try:
        start_s, end_s = (float(part) for part in parts[:2])
        rotor = 0 if parts[2].strip().lower() == "all" else int(parts[2])
    except (ValueError, IndexError):
        start_s = end_s = rotor = -1
    if len(parts) != 3 or rotor < 0 or not (isfinite(start_s) and isfinite(end_s)):
        wrong = "write it as START:END:ROTOR in seconds"
    elif start_s < 0.0:
        wrong = f"START is {start_s:g} s; allowed: from 0 s; write START:END:ROTOR"
    elif end_s <= start_s:
        wrong = f"END {end_s:g} s is not after START {start_s:g} s; write START:END:ROTOR"
    if wrong:
        raise InputError(f"--over {text!r}: {wrong}, for example 12.5:18:1")
    return Window(start_s=start_s, end_s=end_s, rotor=rotor, source="user")


def mark_windows(
    result: ImportResult, user_windows: Sequence[Window], near_m: float | None
) -> ImportResult:
    """Return the import with its windows, and with them as channels coverage1, ...

    coverage is 1 where the rotor is over the surface, else 0; the share of the disc over it is
    unknown.
    """
    recording = result.recording
    if not user_windows and near_m is None:
        return result
    if "time_s" not in recording:
        raise InputError(
            f"{recording.provenance.get('file', 'the file')} has no time, needed for --over and "
            f"--near-m; remove these options"
        )
    time_s, windows, findings = recording.column("time_s"), list(user_windows), []
    if near_m is not None:
        if "distance_m" not in recording:
            text = "--near-m needs a distance sensor, missing in the file"
            findings.append(Finding("lacks", "distance sensor", text))
        else:
            sensed = _find_near_windows(time_s, recording.column("distance_m"), near_m)
            windows += sensed
            text = (
                f"{pluralize(len(sensed), 'window')} with a distance below {near_m:g} m from the "
                f"body, applied to all rotors"
            )
            findings.append(Finding("read as", "over a surface", text, "distance_m", len(sensed)))
    rotors = sorted(
        {int(match[1]) for name in recording.names if (match := _ROTOR.fullmatch(name))}
    )
    end_s = float(np.nanmax(time_s))
    for window in windows:
        if window.rotor and rotors and window.rotor not in rotors:
            raise InputError(
                f"--over rotor {window.rotor} is unknown; the file has rotors "
                f"{', '.join(map(str, rotors))}"
            )
        if window.start_s > end_s:
            raise InputError(
                f"--over start {window.start_s:g} s is out of range; allowed: up to {end_s:.6g} s, "
                f"the end of the recording"
            )
    for rotor in rotors or [1]:
        over = [window for window in windows if window.rotor in (0, rotor)]
        if over and (name := f"coverage{rotor}") not in recording:
            covered = [(time_s >= part.start_s) & (time_s <= part.end_s) for part in over]
            recording = recording.with_column(Channel(name, "1"), np.any(covered, axis=0))
    return replace(
        result,
        recording=recording,
        windows=tuple(sorted(windows, key=lambda window: (window.start_s, window.rotor))),
        findings=(*result.findings, *findings),
    )


def _find_near_windows(time_s: Array, distance_m: Array, near_m: float) -> list[Window]:
    rows = np.flatnonzero(np.isfinite(distance_m) & np.isfinite(time_s))
    if not rows.size:
        return []
    t_s, is_near = time_s[rows], distance_m[rows] < near_m
    breaks = np.flatnonzero(np.diff(is_near) | (np.diff(t_s) > MAX_GAP_S)) + 1
    return [
        Window(
            start_s=float(t_s[part[0]]),
            end_s=float(t_s[part[-1]]),
            rotor=0,
            source="distance sensor",
        )
        for part in np.split(np.arange(rows.size), breaks)
        if is_near[part[0]]
    ]


MIN_HOVER_S = 1.0  # duration of a point: tens of samples at nearly constant height; assumed
STEADY_M_S = 0.05  # fastest climb of a point, slow enough for the wake to settle; assumed
MIN_SAMPLES = 10  # of a point, to estimate the acceleration; assumed


def extract_hover_points(result: ImportResult, mass_kg: float) -> ImportResult:
    """Return steady hover segments of a flight as points with thrust_N = m (g + a).

    The vertical acceleration a is from a parabola through the heights of a segment. Rotor speeds
    are root mean squares, as thrust is proportional to their square; other channels are means.
    plate_z_m is the height of the tracked point above the floor.
    """
    recording = result.recording
    speeds = speed_columns(recording.names)
    if not {"time_s", "plate_z_m"}.issubset(recording.names) or not speeds:
        raise InputError(
            f"--hover needs time_s, plate_z_m and rpm1, ... or pwm1_us, ...; the table has "
            f"{', '.join(recording.names)}; map them with --columns MAP.toml"
        )
    turning = np.all([recording.column(name) > 0.0 for name in speeds], axis=0)
    recording = recording.select(turning & np.isfinite(recording.column("plate_z_m")))
    time_s, height_m = recording.column("time_s"), recording.column("plate_z_m")
    breaks = np.flatnonzero(np.diff(np.floor(time_s / MIN_HOVER_S))) + 1
    rows: list[Array] = []
    thrust_N: list[float] = []
    stays = [
        stay for stay in np.split(np.arange(len(recording)), breaks) if stay.size >= MIN_SAMPLES
    ]
    for stay in stays:
        since_s = time_s[stay] - time_s[stay].mean()
        if np.ptp(since_s) < 0.8 * MIN_HOVER_S:  # too short to estimate the acceleration
            continue
        half_a, climb, _ = np.polyfit(since_s, height_m[stay], 2)
        if abs(climb) > STEADY_M_S:
            continue
        means = recording.values[stay].mean(axis=0)
        for name in (name for name in speeds if name.startswith("rpm")):
            means[recording.index(name)] = np.sqrt(np.mean(recording.column(name)[stay] ** 2))
        rows.append(means)
        thrust_N.append(mass_kg * (STANDARD_GRAVITY_M_S2 + 2.0 * half_a))
    if not rows:
        raise InputError(
            f"no {MIN_HOVER_S:g} s of the flight with all rotors turning and a climb below "
            f"{STEADY_M_S:g} m/s; check the units of time_s and plate_z_m"
        )
    points = replace(recording, values=np.array(rows))
    if "thrust_N" in points:
        raise InputError("--hover computes thrust_N, but the table has it; remove one of them")
    text = (
        f"thrust is {mass_kg:g} kg times gravity and vertical acceleration; "
        f"{pluralize(len(rows), 'steady segment')} of {MIN_HOVER_S:g} s are points"
    )
    return replace(
        result,
        recording=points.with_column(Channel("thrust_N", "N"), np.array(thrust_N)),
        findings=(*result.findings, Finding("read as", "hover", text, "thrust_N", len(rows))),
        sources={**result.sources, "thrust_N": "m (g + a)"},
        lines=None,
    )
