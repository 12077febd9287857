"""Report page of a motor: constants, thrust curve with residuals, step response, drift."""

from __future__ import annotations

from collections.abc import Iterator
from math import hypot, isfinite, pi

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchtool.core.fit_result import Estimate
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.fit.motor.constants import MotorFit
from benchtool.report.figure import figure
from benchtool.report.numbers import display_unit, format_number, value_with_sd
from benchtool.report.page import Page, Paragraph, Table
from benchtool.report.palette import BLUE, GREY, ORANGE, VERMILION
from benchtool.report.panels import points, stack_panels

WAYS = ((1.0, "up", BLUE, "^"), (-1.0, "down", ORANGE, "v"))  # direction, name, colour, marker


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
    has_speed = fit.law is not None
    axes = figure.subplots(
        2, 2 if has_speed else 1, sharex="col", height_ratios=[2.2, 1.0], squeeze=False
    )
    p, error_mN = fit.points, 1e3 * fit.points.thrust_se_N
    u, at_full = 100.0 * fit.throttle, fit.thrust_at_full_voltage_N
    throttle_grid = np.linspace(0.0, u.max(), 200)
    _both_ways(axes[0, 0], fit, u, at_full)
    axes[0, 0].plot(
        throttle_grid, fit.thrust_at_throttle_N(0.01 * throttle_grid), color=VERMILION, label="fit"
    )
    axes[0, 0].set_ylabel("thrust of a rotor [N]")
    axes[0, 0].legend(loc="upper left")
    throttle_residual_mN = 1e3 * (at_full - fit.thrust_at_throttle_N(fit.throttle))
    _both_ways(axes[1, 0], fit, u, throttle_residual_mN, error_mN)
    axes[1, 0].set(xlabel="throttle [%]", ylabel="residual [mN]")
    if has_speed:
        rpm = p.speed_rad_s * 30.0 / np.pi
        rpm_grid = np.linspace(0.0, rpm.max(), 200)
        _both_ways(axes[0, 1], fit, rpm, p.thrust_N)
        axes[0, 1].plot(rpm_grid, fit.thrust_at_speed_N(rpm_grid * np.pi / 30.0), color=VERMILION)
        residual_mN = 1e3 * (p.thrust_N - fit.thrust_at_speed_N(p.speed_rad_s))
        _both_ways(axes[1, 1], fit, rpm, residual_mN, error_mN)
        axes[1, 1].set_xlabel("speed [rpm]")
    for below in axes[1]:
        below.axhline(0.0, color=GREY, linewidth=0.9)


@figure(
    title="Speed and power over throttle",
    caption="Measured speed and electrical power over throttle, for rising and falling throttle; "
    "a gap indicates hysteresis, heating or battery discharge.",
    when=lambda fit: len(np.unique(fit.points.pulse_us)) > 1
    and bool(_panels_over_throttle(fit)),
    height_in=lambda fit: 1.0 + 1.7 * len(_panels_over_throttle(fit)),
)  # fmt: skip
def throttle(figure: Figure, fit: MotorFit) -> None:
    """Draw speed and electrical power over throttle, rising and falling."""
    panels = _panels_over_throttle(fit)
    rows = stack_panels(figure, [1.0] * len(panels), xlabel="throttle [%]")
    for axes, (label, values) in zip(rows, panels, strict=True):
        _both_ways(axes, fit, 100.0 * fit.throttle, values)
        axes.set_ylabel(label)
    figure.axes[0].legend(loc="upper left")


def _panels_over_throttle(fit: MotorFit) -> list[tuple[str, Array]]:
    p = fit.points
    panels = [("speed [rpm]", p.speed_rad_s * 30.0 / np.pi), ("power [W]", p.power_W)]
    return [panel for panel in panels if np.isfinite(panel[1]).any()]


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
    height_in=lambda fit: 1.0 + 1.3 * len(_panels_over_time(fit)),
)
def time(figure: Figure, fit: MotorFit) -> None:
    """Draw thrust, speed, power, voltage and temperature of points over time."""
    panels = _panels_over_time(fit)
    rows = stack_panels(figure, [1.0] * len(panels), xlabel="time of the run [min]")
    for axes, (label, values) in zip(rows, panels, strict=True):
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


def _panels_over_time(fit: MotorFit) -> list[tuple[str, Array]]:
    p = fit.points
    panels = [
        ("thrust of a\nrotor [N]", p.thrust_N),
        ("speed\n[rpm]", p.speed_rad_s * 30.0 / np.pi),
        ("power\n[W]", p.power_W),
        ("voltage\n[V]", p.voltage_V),
        ("ESC\n[°C]", p.temperature_degC),
    ]
    return [panel for panel in panels if np.isfinite(panel[1]).any()]


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


def hysteresis(fit: MotorFit) -> Iterator[tuple[float, float, float, float]]:
    """Yield pulse width (us), mean thrust up (N), down minus up and its error (N) per level."""
    p = fit.points
    for pulse_us in np.unique(p.pulse_us):
        up, down = ((p.pulse_us == pulse_us) & (p.way == direction) for direction in (1.0, -1.0))
        if up.any() and down.any():
            error = hypot(_error(p.thrust_se_N[up]), _error(p.thrust_se_N[down]))
            mean = float(p.thrust_N[up].mean())
            yield float(pulse_us), mean, float(p.thrust_N[down].mean()) - mean, error


def _error(errors: Array) -> float:
    return float(np.sqrt(np.sum(errors**2)) / len(errors))


def _ways_table(fit: MotorFit) -> Table | None:
    rows = [
        (f"{pulse_us:g}", f"{up:.4g}", value_with_sd(1e3 * change, 1e3 * error),
         format_number(100.0 * change / up, "+.2f"))
        for pulse_us, up, change, error in hysteresis(fit)
    ]  # fmt: skip
    if not rows:
        return None
    return Table(
        "Measured thrust of a rotor with falling and rising throttle (voltage and temperature "
        "differ).",
        ("pulse [µs]", "rising [N]", "falling − rising [mN]", "[%]"),
        rows,
    )


EXPORT = (
    "benchtool export RUN --motor RUN --to all writes parameters for ArduPilot, PX4, Betaflight, "
    "Gazebo, MuJoCo and firmware, relative to the pulse width at idle."
)


def motor_sentence(fit: MotorFit) -> str:
    """Return a summary of the motor constants."""
    statements = []
    if isfinite(fit.value("T_measured")):
        for name, text in (
            ("T_measured", "maximum measured thrust of a rotor"),
            ("T_max", "T_max"),
        ):
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
    if isfinite(fit.value("lag_up")):
        up, down = (f"{1e3 * fit.value(name):.3g}" for name in ("lag_up", "lag_down"))
        statements.append(f"time constant of speed is {up} ms up and {down} ms down")
    text = "; ".join(statements) + "."
    points, runs = pluralize(len(fit.points.time_s), "point"), pluralize(len(fit.names), "run")
    return f"{points} of {runs} on rig {fit.rig.name}: {text}"


def motor_lines(motor_fit: MotorFit) -> str:
    """Return the summary and the constants as lines of text."""
    rows = constants_table(motor_fit).rows
    widths = [max(len(row[column]) for row in rows) for column in (0, 2, 4)]
    lines = [
        f"{row[0]:<{widths[0]}}  {row[2]:<{widths[1]}}  {row[4]:<{widths[2]}}  {row[1]}"
        for row in rows
    ]
    return "\n".join([motor_sentence(motor_fit), "", *lines])


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
