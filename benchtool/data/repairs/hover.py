"""Points from hover flights, where thrust is the vehicle's weight."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from benchtool.core.channel import Channel
from benchtool.core.errors import InputError
from benchtool.core.text import pluralize
from benchtool.core.units import STANDARD_GRAVITY_M_S2, Array
from benchtool.data.repairs.import_result import Finding, ImportResult

MIN_HOVER_S = 1.0  # duration of a point: tens of samples at nearly constant height; assumed
STEADY_M_S = 0.05  # fastest climb of a point, slow enough for the wake to settle; assumed
MIN_SAMPLES = 10  # of a point, to estimate the acceleration; assumed

_SPEED = re.compile(r"rpm\d+|pwm\d+_us")


def extract_hover_points(result: ImportResult, mass_kg: float) -> ImportResult:
    """Return steady hover segments of a flight as points with thrust_N = m (g + a).

    The vertical acceleration a is from a parabola through the heights of a segment. Rotor speeds
    are root mean squares, as thrust is proportional to their square; other channels are means.
    plate_z_m is the height of the tracked point above the floor.

    Args:
        result: a table with time_s, plate_z_m and rotor speeds or pulse widths.

    Raises:
        InputError: a channel is missing, or no segment is steady.
    """
    recording = result.recording
    speeds = [name for name in recording.names if _SPEED.fullmatch(name)]
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
