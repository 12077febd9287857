"""Report page of a motor: constants, thrust curve with residuals, step response, drift."""

from __future__ import annotations

from collections.abc import Mapping
from math import hypot, isfinite, pi
from typing import TYPE_CHECKING

import numpy as np

from benchtool.core.fit_result import Estimate
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.fit.motor.constants import MotorFit
from benchtool.report.figure import figure
from benchtool.report.numbers import align_columns, display_unit, format_number, value_with_sd
from benchtool.report.page import Page, Table
from benchtool.report.palette import BLUE, GREY, ORANGE, VERMILION
from benchtool.report.panels import points, stack_panels

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


PANELS = {"speed [rpm]": "rpm", "power [W]": "power_W"}  # over throttle: labels and values
PANELS_OVER_TIME = {
    "thrust of a\nrotor [N]": "thrust_N",
    "speed\n[rpm]": "rpm",
    "power\n[W]": "power_W",
    "voltage\n[V]": "voltage_V",
    "ESC\n[°C]": "temperature_degC",
}
WAYS = ((1.0, "up", BLUE, "^"), (-1.0, "down", ORANGE, "v"))  # direction, name, colour, marker


def _panels(fit: MotorFit, panels: Mapping[str, str]) -> dict[str, Array]:
    """Return the values (p,) of the panels with data by label."""
    rpm = fit.points.speed_rad_s * 30.0 / np.pi
    values = {k: rpm if name == "rpm" else getattr(fit.points, name) for k, name in panels.items()}
    return {label: column for label, column in values.items() if np.isfinite(column).any()}


def _both_ways(axes: Axes, fit: MotorFit, x: Array, y: Array, error: Array | None = None) -> None:
    """Draw points with rising and with falling throttle as two series."""
    for direction, name, color, marker in WAYS:
        rows = fit.points.way == direction
        if rows.any():
            bars = None if error is None else error[rows]
            points(axes, x[rows], y[rows], bars, color, marker, label=name)


@figure(
    title="Thrust curve and its residuals",
    caption="Thrust of one rotor over throttle at the voltage of T_max (left) and over speed "
    "(right), for rising and falling throttle; lines: fitted laws. Below: residuals; bars: "
    "standard errors of the points.",
    when=lambda fit: bool(np.isfinite(fit.value("T_max"))),
    height_in=5.2,
)
def thrust(figure: Figure, fit: MotorFit) -> None:
    """Draw thrust over throttle and speed with fitted laws and residuals."""
    p, u, rpm = fit.points, fit.throttle, fit.points.speed_rad_s * 30.0 / np.pi
    at_full_N, fitted_N = fit.thrust_at_full_voltage_N, fit.thrust_at_throttle_N(u)
    grid = np.linspace(0.0, 100.0 * u.max(), 200)
    line_N = fit.thrust_at_throttle_N(0.01 * grid)
    columns = [("throttle [%]", 100.0 * u, at_full_N, fitted_N, grid, line_N)]
    if fit.law is not None:
        grid, fitted_N = np.linspace(0.0, rpm.max(), 200), fit.thrust_at_speed_N(p.speed_rad_s)
        line_N = fit.thrust_at_speed_N(grid * np.pi / 30.0)
        columns.append(("speed [rpm]", rpm, p.thrust_N, fitted_N, grid, line_N))
    axes = figure.subplots(2, len(columns), sharex="col", height_ratios=[2.2, 1.0], squeeze=False)
    for (above, below), (label, x, thrust_N, fitted_N, grid, line_N) in zip(
        axes.T, columns, strict=True
    ):
        _both_ways(above, fit, x, thrust_N)
        above.plot(grid, line_N, color=VERMILION, label="fit")
        _both_ways(below, fit, x, 1e3 * (thrust_N - fitted_N), 1e3 * p.thrust_se_N)
        below.axhline(0.0, color=GREY, linewidth=0.9)
        below.set_xlabel(label)
    axes[0, 0].set_ylabel("thrust of a rotor [N]")
    axes[0, 0].legend(loc="upper left")
    axes[1, 0].set_ylabel("residual [mN]")


@figure(
    title="Speed and power over throttle",
    caption="Measured speed and electrical power over throttle, for rising and falling throttle; "
    "a gap indicates hysteresis, heating or battery discharge.",
    when=lambda fit: len(np.unique(fit.points.pulse_us)) > 1
    and bool(_panels(fit, PANELS)),
    height_in=lambda fit: 1.0 + 1.7 * len(_panels(fit, PANELS)),
)  # fmt: skip
def throttle(figure: Figure, fit: MotorFit) -> None:
    """Draw speed and electrical power over throttle, rising and falling."""
    panels = _panels(fit, PANELS)
    rows = stack_panels(figure, [1.0] * len(panels), xlabel="throttle [%]")
    for axes, (label, values) in zip(rows, panels.items(), strict=True):
        _both_ways(axes, fit, 100.0 * fit.throttle, values)
        axes.set_ylabel(label)
    figure.axes[0].legend(loc="upper left")


@figure(
    title="Speed after a throttle step",
    caption="Speed of each step, normalised from initial (0) to final (1), and mean first-order "
    "lag with delay per direction.",
    when=lambda fit: bool(fit.steps),
    height_in=3.8,
)
def response(figure: Figure, fit: MotorFit) -> None:
    """Draw the normalised speed after each step with the mean lags."""
    panels = figure.subplots(1, 2, sharey=True)
    for axes, (direction, name, color, _) in zip(panels, WAYS, strict=True):
        steps = [step for step in fit.steps if step.up is (direction > 0.0)]
        for step in steps:
            share = (step.speed_rad_s - step.before_rad_s) / (step.after_rad_s - step.before_rad_s)
            axes.plot(1e3 * step.time_s, share, ".", color=color, ms=2.0, alpha=0.5)
        if steps:
            lag_s = float(np.mean([step.seen_lag_s for step in steps]))
            delay_s = float(np.mean([step.delay_s for step in steps]))
            time_s = np.linspace(0.0, max(step.time_s[-1] for step in steps), 300)
            law = 1.0 - np.exp(-np.maximum(time_s - delay_s, 0.0) / lag_s)
            axes.plot(1e3 * time_s, law, color=VERMILION)
        axes.set(xlabel="time since the step [ms]", title=name)
    panels[0].set_ylabel("share of the change [–]")


@figure(
    title="Points over time",
    caption="Point means against run time; drift indicates heating or battery discharge.",
    height_in=lambda fit: 1.0 + 1.3 * len(_panels(fit, PANELS_OVER_TIME)),
)
def time(figure: Figure, fit: MotorFit) -> None:
    """Draw thrust, speed, power, voltage and temperature of points over time."""
    panels = _panels(fit, PANELS_OVER_TIME)
    rows = stack_panels(figure, [1.0] * len(panels), xlabel="time of the run [min]")
    for axes, (label, values) in zip(rows, panels.items(), strict=True):
        for number, name in enumerate(fit.names):
            in_run = fit.points.run == number
            color = (BLUE, ORANGE, VERMILION, GREY)[number % 4]
            axes.plot(
                fit.points.time_s[in_run] / 60.0, values[in_run], ".-",
                color=color, linewidth=0.7, label=name,
            )  # fmt: skip
        axes.set_ylabel(label)
    if len(fit.names) > 1:
        figure.legend(*rows[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)


MEANS = {
    "T_measured": "highest measured thrust of a rotor",
    "k": "thrust over squared speed: T = k ω²",
    "k_error": "largest error of k ω² over thrust",
    "n": "free exponent of thrust over speed",
    "T_0": "constant term T₀ of T = k ω² + T₀",
    "speed_per_us": "speed per pulse width at nominal voltage",
    "pulse_zero": "pulse width at which the speed line crosses zero",
    "voltage_exponent": "exponent of speed over voltage",
    "T_max": "thrust of a rotor at full throttle",
    "expo": "T = T_max ((1 − e) u + e u²) over throttle u",
    "hover_throttle": "throttle at hover",
    "hover_thrust_share": "thrust at hover over T_max",
    "hover_rpm": "speed at hover",
    "lag_up": "time constant of speed, throttle rising",
    "delay_up": "delay before lag_up",
    "lag_down": "time constant of speed, throttle falling",
    "delay_down": "delay before lag_down",
}


def constants_table(fit: MotorFit) -> Table:
    """Return a table of the constants with 95 % intervals."""
    return Table(
        "Constants of one rotor; ± standard uncertainty, 95 %: interval by Student's t.",
        ("constant", "meaning", "value", "95 %", "unit"),
        [_row(estimate) for estimate in fit.estimates],
        text_columns=2,
    )


def _row(estimate: Estimate) -> tuple[str, ...]:
    name, unit = estimate.name, display_unit(estimate.unit)
    if estimate.open:
        return name, f"not determined: {estimate.open}", "–", "–", unit
    means = ", ".join(filter(None, (MEANS[name], estimate.bound)))
    if estimate.sd == 0.0:
        return name, means, format_number(estimate.value, ".2g"), "–", unit
    interval = " to ".join(format_number(bound, ".5g") for bound in estimate.interval_95)
    return name, means, value_with_sd(estimate.value, estimate.sd), interval, unit


def _ways_table(fit: MotorFit) -> Table | None:
    p, rows = fit.points, []
    for pulse_us in np.unique(p.pulse_us):
        ways = [(p.pulse_us == pulse_us) & (p.way == direction) for direction in (1.0, -1.0)]
        if not all(way.any() for way in ways):
            continue
        up, down = (float(p.thrust_N[way].mean()) for way in ways)
        errors = [np.sqrt(np.sum(p.thrust_se_N[way] ** 2)) / way.sum() for way in ways]
        rows.append((
            f"{pulse_us:g}", f"{up:.4g}", value_with_sd(1e3 * (down - up), 1e3 * hypot(*errors)),
            format_number(100.0 * (down - up) / up, "+.2f"),
        ))  # fmt: skip
    if not rows:
        return None
    return Table(
        "Measured thrust of a rotor with falling and rising throttle (voltage and temperature "
        "differ).",
        ("pulse [µs]", "rising [N]", "falling − rising [mN]", "[%]"),
        rows,
    )


EXPORT = (
    "benchtool export DATA --to all (with --propeller SIZE for a log that names none) writes "
    "parameters for ArduPilot, PX4, Betaflight, Gazebo, MuJoCo and firmware, relative to the pulse "
    "width at idle."
)


def motor_sentence(fit: MotorFit) -> str:
    """Return a summary of the motor constants."""
    statements = []
    if isfinite(fit.value("T_measured")):
        maxima = {"T_measured": "maximum measured thrust of a rotor", "T_max": "T_max"}
        for name, text in maxima.items():
            statements.append(f"{text} {fit.value(name):.3g} N ({fit[name].bound})")
        if isfinite(hover := 100.0 * fit.value("hover_throttle")):
            statements.append(f"hover throttle at {fit.mass_kg:g} kg is {hover:.3g} %")
    if fit.law is not None:
        (_, zero_N, n), k = fit.law.values, fit.value("k")
        law = f"{fit.law.coefficient:.4g} ω^{n:.4g}{f' {zero_N:+.3g}' if zero_N else ''}"
        statements.append(f"held-out levels support T = {law} (N, rad/s)")
        statements.append(
            f"k is {k:.4g} N/(rad/s)² ({k * (pi / 30.0) ** 2:.4g} N/rpm²), {fit['k'].bound}, with "
            f"a maximum error of k ω² of {100.0 * fit.value('k_error'):.2g} %"
        )
    torque = "propulsion.drag_coefficient_Nm_s2"
    if torque not in fit.rig.not_stated and fit.rig.sources.get(torque, "").startswith("the log"):
        text = "torque is not fitted; the median of |torque|/ω² is"
        statements.append(f"{text} {fit.rig.propulsion.drag_coefficient_Nm_s2:.4g} N m/(rad/s)²")
    if "propulsion.radius_m" in fit.rig.not_stated:
        statements.append("the log names no propeller, which C_T and an export need (--propeller)")
    lags = {way: 1e3 * fit.value(f"lag_{way}") for way in ("up", "down")}
    if known := [f"{lag_ms:.3g} ms {way}" for way, lag_ms in lags.items() if isfinite(lag_ms)]:
        statements.append(f"time constant of speed is {' and '.join(known)}")
    text = "; ".join(statements) + "."
    points, runs = pluralize(len(fit.points.time_s), "point"), pluralize(len(fit.names), "run")
    return f"{points} of {runs} on rig {fit.rig.name}: {text}"


def motor_lines(motor_fit: MotorFit) -> str:
    """Return the summary and the constants as lines of text."""
    rows = constants_table(motor_fit).select_columns((0, 2, 4, 1)).rows
    return "\n".join([motor_sentence(motor_fit), "", *align_columns(rows, left=range(4))])


MOTOR = Page(
    "motor",
    [
        ("Constants", [constants_table, "thrust"]),
        ("Throttle up and down", [_ways_table, "throttle"]),
        ("Response", ["response"]),
        ("Over time", ["time"]),
        ("For autopilots and simulators", [lambda _: EXPORT]),
    ],
    title=lambda fit: f"Motor: {', '.join(fit.names)}",
    summary=motor_sentence,
)
