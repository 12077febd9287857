"""Tare: motors signalled at zero, rotors standing, and a rest small enough to go on with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import nan

import numpy as np

from benchtool.acquire.average import Average, average, estimate_quantum
from benchtool.acquire.motors import Motors
from benchtool.acquire.plan import TarePart
from benchtool.acquire.record import Recorder
from benchtool.core.errors import BenchError
from benchtool.core.rig import Rig
from benchtool.data.run.points import Point

MAX_ATTEMPTS = (
    3  # tares before the sweep gives up; a choice: a gust fails one, a loose cell fails all
)


@dataclass(frozen=True, slots=True)
class TareResult:
    """Say how the last tare went.

    Attributes:
        time_s: middle of the span averaged after it, since the run began.
        rest_N: what the load cell still showed.
        zero_counts: mean raw reading with nothing on the load cell; nan without raw counts.
        rates_Hz: how often each channel brought a value.
    """

    time_s: float
    rest_N: Average
    zero_counts: float
    rates_Hz: Mapping[str, float] = field(default_factory=dict)


def tare(recorder: Recorder, motors: Motors, plan: TarePart, rig: Rig) -> TareResult:
    """Stand still, tare, and check what is left.

    Raises:
        BenchError: a rotor turns, no thrust comes, or the rest stays above the gate.
    """
    assert plan.residual_N is not None
    motors.stand_still(plan.stop_timeout_s, "tare")
    rest = Average(nan, nan, nan, 0)
    for attempt in range(1, MAX_ATTEMPTS + 1):
        recorder.bench.tare()
        # Samples that were on their way when the device tared belong to before.
        recorder.collect("tare", 0.2)
        seen = recorder.collect("tare", plan.seconds)
        rest = average(seen.column("thrust_N"), estimate_quantum("thrust_N", rig.sensors))
        if text := rest.rejection("thrust_N"):
            recorder.note("suspect" if rest.suspect else "outliers", f"tare: {text}")
        if rest.n == 0:
            raise BenchError(
                f"the load cell gave no value for {plan.seconds:g} s after the tare; check its "
                f"wiring"
            )
        if abs(rest.mean) <= plan.residual_N:
            counts = average(seen.column("thrust_raw")).mean if "thrust_raw" in seen else nan
            middle_s = float(seen.column("time_s").mean())
            recorder.note("tare", f"tared; {rest.mean * 1000.0:+.1f} mN are left")
            came = np.isfinite(seen.values).sum(axis=0) / plan.seconds
            rates_Hz = dict(zip(seen.names, came.tolist(), strict=True))
            return TareResult(middle_s, rest, counts, rates_Hz)
        recorder.note(
            "tare_residual",
            f"after tare {attempt} of {MAX_ATTEMPTS} {rest.mean:+.4g} N are left, limit "
            f"{plan.residual_N:.4g} N",
        )
    raise BenchError(
        f"after {MAX_ATTEMPTS} tares {rest.mean:+.4g} N are left on the load cell, limit "
        f"{plan.residual_N:.4g} N; let it warm up, shield it from draught, or raise tare.residual_N"
    )


def tare_point(tared: TareResult, n_rotors: int) -> Point:
    """Return the row of points.csv that stores a tare."""
    return Point(
        point=0,
        kind="tare",
        setting=0,
        repeat=0,
        time_s=tared.time_s,
        elapsed_s=0.0,
        pwm_us=(nan,) * n_rotors,
        rpm=(0.0,) * n_rotors,
        rpm_se=(0.0,) * n_rotors,
        thrust_N=tared.rest_N.mean,
        thrust_sd_N=tared.rest_N.sd,
        thrust_se_N=tared.rest_N.se,
        n_samples=tared.rest_N.n,
        plate_z_m=nan,
        plate_x_m=nan,
        plate_tilt_deg=nan,
        rejected={"thrust_N": tared.rest_N.n_rejected},
        suspect=tared.rest_N.suspect,
    )


def format_drift(first: Point | None, anchor: Point, limit_N: float | None) -> str:
    """Return why a tare is due after this anchor; empty when none is.

    Thrust is brought to the first anchor's summed squared speed before, so that a battery that
    sags is not taken for a load cell that drifts.
    """
    if limit_N is None or first is None:
        return ""
    scale = 1.0
    if first.sum_rpm2 > 0.0 and anchor.sum_rpm2 > 0.0:
        scale = first.sum_rpm2 / anchor.sum_rpm2
    change_N = anchor.thrust_N * scale - first.thrust_N
    if abs(change_N) <= limit_N:
        return ""
    return (
        f"anchor {anchor.repeat} has moved by {change_N:+.4g} N since the first, limit "
        f"{limit_N:g} N; the load cell is tared again"
    )
