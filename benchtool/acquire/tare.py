"""Tare at standstill, repeated until the remaining offset is small."""

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

MAX_ATTEMPTS = 3  # a gust fails one tare, a loose cell all; assumed


@dataclass(frozen=True, slots=True)
class TareResult:
    """Result of a tare.

    Attributes:
        time_s: middle of the averaging time after it, run time.
        zero_counts: mean raw reading of the unloaded cell; nan without raw counts.
        rates_Hz: rate of values of each channel.
    """

    time_s: float
    zero_counts: float
    rates_Hz: Mapping[str, float] = field(default_factory=dict)


def tare(recorder: Recorder, motors: Motors, plan: TarePart, rig: Rig) -> TareResult:
    """Wait for standstill, tare, check the remaining offset and append it to the points.

    Raises:
        BenchError: a rotor turns, no thrust values, or the offset stays above the limit.
    """
    assert plan.residual_N is not None
    motors.stand_still(plan.stop_timeout_s, "tare")
    offset = Average(nan, nan, nan, 0)
    for attempt in range(1, MAX_ATTEMPTS + 1):
        recorder.bench.tare()
        # Discard samples that were in transit during the tare.
        recorder.collect("tare", 0.2)
        samples = recorder.collect("tare", plan.seconds)
        offset = average(samples.column("thrust_N"), estimate_quantum("thrust_N", rig.sensors))
        if text := offset.rejection("thrust_N"):
            recorder.record_event("suspect" if offset.suspect else "outliers", f"tare: {text}")
        if offset.n == 0:
            raise BenchError(
                f"no load cell value within {plan.seconds:g} s after the tare; check the wiring"
            )
        if abs(offset.mean) <= plan.residual_N:
            counts = average(samples.column("thrust_raw")).mean if "thrust_raw" in samples else nan
            middle_s = float(samples.column("time_s").mean())
            recorder.record_event("tare", f"tared; remaining offset {offset.mean * 1000.0:+.1f} mN")
            values_Hz = np.isfinite(samples.values).sum(axis=0) / plan.seconds
            rates_Hz = dict(zip(samples.names, values_Hz.tolist(), strict=True))
            recorder.append_point(tare_point(middle_s, offset, rig.n_rotors))
            return TareResult(middle_s, counts, rates_Hz)
        recorder.record_event(
            "tare_residual",
            f"tare {attempt} of {MAX_ATTEMPTS}: remaining offset {offset.mean:+.4g} N, limit "
            f"{plan.residual_N:.4g} N",
        )
    raise BenchError(
        f"load cell offset {offset.mean:+.4g} N after {MAX_ATTEMPTS} tares, limit "
        f"{plan.residual_N:.4g} N; warm up the cell, shield it from draught, or raise "
        f"tare.residual_N"
    )


def tare_point(time_s: float, offset: Average, n_rotors: int) -> Point:
    """Return the row of points.csv that stores the remaining offset of a tare."""
    return Point(
        point=0,
        kind="tare",
        setting=0,
        repeat=0,
        time_s=time_s,
        elapsed_s=0.0,
        pwm_us=(nan,) * n_rotors,
        rpm=(0.0,) * n_rotors,
        rpm_se=(0.0,) * n_rotors,
        thrust_N=offset.mean,
        thrust_sd_N=offset.sd,
        thrust_se_N=offset.se,
        n_samples=offset.n,
        plate_z_m=nan,
        plate_x_m=nan,
        plate_tilt_deg=nan,
        rejected={"thrust_N": offset.n_rejected},
        suspect=offset.suspect,
    )


def format_drift(first: Point | None, anchor: Point, limit_N: float | None) -> str:
    """Return the reason for a tare after this anchor; "" if none is due.

    Thrust is scaled to the squared speeds of the first anchor, so that voltage sag is not mistaken
    for drift of the load cell.
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
        f"anchor {anchor.repeat} has changed by {change_N:+.4g} N since the first, limit "
        f"{limit_N:g} N; tare is repeated"
    )
