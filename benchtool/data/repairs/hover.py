"""Points of a hover flight: what the rotors lift is the vehicle's own weight."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.channel import Channel
from benchtool.core.errors import InputError
from benchtool.core.plural import pluralize
from benchtool.core.units import STANDARD_GRAVITY_M_S2
from benchtool.data.repairs.import_result import Finding, ImportResult

MIN_HOVER_S = 1.0  # of a point: tens of samples, heights hardly change; assumed
STEADY_M_S = 0.05  # faster climbs make no point: the wake has no time to settle; assumed
MIN_SAMPLES = 10  # Samples that a stay needs for its acceleration. A choice

_SPEED = re.compile(r"rpm\d+|pwm\d+_us")


def extract_hover_points(result: ImportResult, mass_kg: float) -> ImportResult:
    """Return steady stays of a flight as points with thrust_N = m (g + a).

    The vertical acceleration a is that of a parabola through the heights of a stay. Speeds of
    rotors are root mean squares, as thrust goes with their square; pulses and all else are means.
    Height is plate_z_m: that of whatever was tracked above the floor.

    Args:
        read: a table with time_s, plate_z_m and rotor speeds or pulses.
        mass_kg: of the vehicle in flight.

    Raises:
        InputError: a channel is missing, or no stay is steady.
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
        if np.ptp(since_s) < 0.8 * MIN_HOVER_S:  # the parabola of a piece says little
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
            f"no {MIN_HOVER_S:g} s of the flight climb slower than {STEADY_M_S:g} m/s with every "
            f"rotor turning; check the units of time_s and plate_z_m"
        )
    points = replace(recording, values=np.array(rows))
    if "thrust_N" in points:
        raise InputError("--hover makes thrust_N, which the table has already; leave one out")
    text = (
        f"thrust is {mass_kg:g} kg times gravity and vertical acceleration; "
        f"{pluralize(len(rows), 'steady stay')} of {MIN_HOVER_S:g} s are points"
    )
    return replace(
        result,
        recording=points.with_column(Channel("thrust_N", "N"), np.array(thrust_N)),
        findings=(*result.findings, Finding("read as", "hover", text, "thrust_N", len(rows))),
        sources={**result.sources, "thrust_N": "m (g + a)"},
        lines=None,
    )
