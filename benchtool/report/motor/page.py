"""The page of a motor: constants, curves with residuals, up against down, autopilot numbers."""

from __future__ import annotations

from collections.abc import Iterator
from math import hypot, isfinite, pi

import numpy as np

from benchtool.core.array import Array
from benchtool.core.counted import counted
from benchtool.core.fit_result import Estimate
from benchtool.fit.motor.constants import MotorFit
from benchtool.report.figure import Page
from benchtool.report.numbers import numeral, unit_for_people, value_with_sd
from benchtool.report.page import Paragraph, Table

MEANS = {
    "T_measured": "highest measured thrust of a rotor",
    "k": "thrust over squared speed: T = k ω²",
    "k_error": "largest error of k ω² over thrust",
    "n": "exponent of thrust over speed, free",
    "T_0": "thrust that T = k ω² + T₀ has beside k ω²",
    "speed_per_us": "speed per pulse at nominal voltage",
    "pulse_zero": "pulse at which the speed line crosses zero",
    "voltage_exponent": "speed goes with voltage to this power",
    "T_max": "thrust of a rotor at full throttle",
    "expo": "T = T_max ((1 − e) u + e u²) over throttle u",
    "hover_throttle": "throttle that carries the mass",
    "hover_thrust_share": "thrust that carries the mass over T_max",
    "hover_rpm": "speed that carries the mass",
    "lag_up": "time constant of speed, throttle rising",
    "delay_up": "dead time before it",
    "lag_down": "time constant of speed, throttle falling",
    "delay_down": "dead time before it",
}


def constants_table(fit: MotorFit) -> Table:
    """Return the constants with their 95 % intervals."""
    return Table(
        "Constants of one rotor; ± standard uncertainty, 95 %: interval by Student's t.",
        ("constant", "is", "value", "95 %", "unit"),
        [_row(one) for one in fit.estimates],
        text_columns=2,
    )


def _row(one: Estimate) -> tuple[str, ...]:
    if one.open:
        return one.name, f"not determined: {one.open}", "–", "–", unit_for_people(one.unit)
    means = f"{MEANS[one.name]}, {one.bound}" if one.bound else MEANS[one.name]
    low, high = (numeral(each, ".5g") for each in one.interval_95)
    interval = f"{low} to {high}"
    if one.sd == 0.0:
        return one.name, means, numeral(one.value, ".2g"), "–", unit_for_people(one.unit)
    value = value_with_sd(one.value, one.sd)
    return one.name, means, value, interval, unit_for_people(one.unit)


def hysteresis(fit: MotorFit) -> Iterator[tuple[float, float, float, float]]:
    """Give pulse (us), mean thrust up (N), down minus up and its standard error (N) of levels."""
    p = fit.points
    for pulse_us in np.unique(p.pulse_us):
        up, down = ((p.pulse_us == pulse_us) & (p.way == way) for way in (1.0, -1.0))
        if up.any() and down.any():
            error = hypot(_error(p.thrust_se_N[up]), _error(p.thrust_se_N[down]))
            mean = float(p.thrust_N[up].mean())
            yield float(pulse_us), mean, float(p.thrust_N[down].mean()) - mean, error


def _error(errors: Array) -> float:
    return float(np.sqrt(np.sum(errors**2)) / len(errors))


def _ways_table(fit: MotorFit) -> Table | None:
    rows = [
        (f"{pulse_us:g}", f"{up:.4g}", value_with_sd(1e3 * change, 1e3 * error),
         numeral(100.0 * change / up, "+.2f"))
        for pulse_us, up, change, error in hysteresis(fit)
    ]  # fmt: skip
    if not rows:
        return None
    return Table(
        "Thrust of a rotor with throttle falling against rising, as measured (voltage and heat "
        "differ).",
        ("pulse [µs]", "rising [N]", "falling − rising [mN]", "[%]"),
        rows,
    )


EXPORT = (
    "benchtool export RUN --motor RUN --to all writes them for ArduPilot, PX4, Betaflight, Gazebo, "
    "MuJoCo and firmware, counted from the pulse at which motors idle."
)


def motor_sentence(fit: MotorFit) -> str:
    """Say in a sentence or two what was found."""
    said = []
    if isfinite(fit.value("T_measured")):
        for name, words in (("T_measured", "a rotor gave at most"), ("T_max", "T_max is")):
            said.append(f"{words} {fit.value(name):.3g} N ({fit[name].bound})")
        if isfinite(hover := 100.0 * fit.value("hover_throttle")):
            said.append(f"{fit.mass_kg:g} kg hover at {hover:.3g} % throttle")
    if fit.law is not None:
        (_, zero_N, n), k = fit.law.values, fit.value("k")
        law = f"{fit.law.coefficient:.4g} ω^{n:.4g}{f' {zero_N:+.3g}' if zero_N else ''}"
        said.append(f"held-out levels support T = {law} (N, rad/s)")
        said.append(
            f"k is {k:.4g} N/(rad/s)² ({k * (pi / 30.0) ** 2:.4g} N/rpm²), {fit['k'].bound}, where "
            f"k ω² is off by {100.0 * fit.value('k_error'):.2g} % at most"
        )
    if isfinite(fit.value("lag_up")):
        up, down = (f"{1e3 * fit.value(name):.3g}" for name in ("lag_up", "lag_down"))
        said.append(f"speed follows with {up} ms up and {down} ms down")
    words = "; ".join(said) + "."
    points, runs = counted(len(fit.points.time_s), "point"), counted(len(fit.names), "run")
    return f"{points} of {runs} on rig {fit.rig.name}: {words}"


def motor_lines(found: MotorFit) -> str:
    """Return sentence, constants and autopilot numbers as lines of text."""
    rows = constants_table(found).rows
    widths = [max(len(row[place]) for row in rows) for place in (0, 2, 4)]
    lines = [
        f"{row[0]:<{widths[0]}}  {row[2]:<{widths[1]}}  {row[4]:<{widths[2]}}  {row[1]}"
        for row in rows
    ]
    return "\n".join([motor_sentence(found), "", *lines])


MOTOR = Page(
    "motor",
    [
        ("Constants", [constants_table, "thrust"]),
        ("Throttle up and down", [_ways_table, "throttle"]),
        ("Response", ["response"]),
        ("Over time", ["time"]),
        ("For autopilots and simulators", [lambda _: Paragraph(EXPORT)]),
    ],
    title=lambda fit: f"Motor: {', '.join(fit.names)}",
    summary=motor_sentence,
)
