"""Figures of a motor: thrust over throttle and speed with residuals, power, steps, time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from benchtool.core.array import Array
from benchtool.fit.motor.constants import MotorFit
from benchtool.report.figure import figure
from benchtool.report.palette import BLUE, GREY, ORANGE, VERMILION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WAYS = ((1.0, "up", BLUE, "^"), (-1.0, "down", ORANGE, "v"))  # throttle's way, name, colour, marker


def _both_ways(axes: Axes, fit: MotorFit, x: Array, y: Array, error: Array | None = None) -> None:
    """Draw points after a lower and after a higher throttle apart."""
    for way, name, color, marker in WAYS:
        here = fit.points.way == way
        if here.any():
            bars = None if error is None else error[here]
            axes.errorbar(
                x[here], y[here], yerr=bars, fmt=marker, color=color, ms=4.6, label=name
            )  # fmt: skip


@figure(
    page="motor",
    name="thrust",
    title="Thrust curve and its residuals",
    caption="Thrust of one rotor over throttle at the voltage of T_max (left) and over speed "
    "(right), throttle rising and falling apart; lines: the fitted laws. Below: residuals; bars: "
    "standard errors of the points.",
    when=lambda fit: bool(np.isfinite(fit.value("T_max"))),
    height_in=5.2,
)
def thrust(figure: Figure, fit: MotorFit) -> None:
    """Draw thrust over throttle and over speed with the fitted laws and residuals."""
    has_speed = fit.law is not None
    axes = figure.subplots(
        2, 2 if has_speed else 1, sharex="col", height_ratios=[2.2, 1.0], squeeze=False
    )
    p, error_mN = fit.points, 1e3 * fit.points.thrust_se_N
    u, at_full = 100.0 * fit.throttle, fit.thrust_at_full_voltage_N
    shown = np.linspace(0.0, u.max(), 200)
    _both_ways(axes[0, 0], fit, u, at_full)
    axes[0, 0].plot(shown, fit.thrust_at_throttle_N(0.01 * shown), color=VERMILION, label="fit")
    axes[0, 0].set_ylabel("thrust of a rotor [N]")
    axes[0, 0].legend(loc="upper left")
    left_mN = 1e3 * (at_full - fit.thrust_at_throttle_N(fit.throttle))
    _both_ways(axes[1, 0], fit, u, left_mN, error_mN)
    axes[1, 0].set(xlabel="throttle [%]", ylabel="residual [mN]")
    if has_speed:
        rpm = p.speed_rad_s * 30.0 / np.pi
        fine = np.linspace(0.0, rpm.max(), 200)
        _both_ways(axes[0, 1], fit, rpm, p.thrust_N)
        axes[0, 1].plot(fine, fit.thrust_at_speed_N(fine * np.pi / 30.0), color=VERMILION)
        residual_mN = 1e3 * (p.thrust_N - fit.thrust_at_speed_N(p.speed_rad_s))
        _both_ways(axes[1, 1], fit, rpm, residual_mN, error_mN)
        axes[1, 1].set_xlabel("speed [rpm]")
    for below in axes[1]:
        below.axhline(0.0, color=GREY, linewidth=0.9)


@figure(
    page="motor",
    name="throttle",
    title="Speed and power over throttle",
    caption="Speed and electrical power over throttle as measured, throttle "
    "rising and falling apart: a gap between the two ways is hysteresis, heat or the pack.",
    when=lambda fit: len(np.unique(fit.points.pulse_us)) > 1
    and bool(_panels_over_throttle(fit)),
    height_in=lambda fit: 1.0 + 1.7 * len(_panels_over_throttle(fit)),
)  # fmt: skip
def throttle(figure: Figure, fit: MotorFit) -> None:
    """Draw speed and electrical power over throttle, up and down apart."""
    panels = _panels_over_throttle(fit)
    for axes, (label, values) in zip(
        figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0], panels, strict=True
    ):
        _both_ways(axes, fit, 100.0 * fit.throttle, values)
        axes.set_ylabel(label)
    axes.set_xlabel("throttle [%]")
    figure.axes[0].legend(loc="upper left")


def _panels_over_throttle(fit: MotorFit) -> list[tuple[str, Array]]:
    p = fit.points
    panels = [
        ("speed [rpm]", p.speed_rad_s * 30.0 / np.pi),
        ("power [W]", p.power_W),
    ]
    return [panel for panel in panels if np.isfinite(panel[1]).any()]


@figure(
    page="motor",
    name="response",
    title="Speed after a step of the throttle",
    caption="Every step from the speed before (0) to the speed after (1), up and down apart, and "
    "the first-order lag at the mean of each way.",
    when=lambda fit: bool(fit.steps),
    height_in=3.8,
)
def response(figure: Figure, fit: MotorFit) -> None:
    """Draw the speed after every step, brought to 0 and 1, with the mean lags."""
    sides = figure.subplots(1, 2, sharey=True)
    for axes, (way, name, color, _) in zip(sides, WAYS, strict=True):
        these = [step for step in fit.steps if step.up is (way > 0.0)]
        for step in these:
            share = (step.speed_rad_s - step.before_rad_s) / (step.after_rad_s - step.before_rad_s)
            axes.plot(1e3 * step.time_s, share, ".", color=color, ms=2.0, alpha=0.5)
        if these:
            lag = float(np.mean([step.seen_lag_s for step in these]))
            late = float(np.mean([step.delay_s for step in these]))
            time_s = np.linspace(0.0, max(step.time_s[-1] for step in these), 300)
            law = 1.0 - np.exp(-np.maximum(time_s - late, 0.0) / lag)
            axes.plot(1e3 * time_s, law, color=VERMILION)
        axes.set(xlabel="time since the step [ms]", title=name)
    sides[0].set_ylabel("share of the change [–]")


@figure(
    page="motor",
    name="time",
    title="Points over time",
    caption="Means of the points over the time of each run: what heat and an emptying pack do.",
    height_in=lambda fit: 1.0 + 1.3 * len(_panels_over_time(fit)),
)
def time(figure: Figure, fit: MotorFit) -> None:
    """Draw thrust, speed, power, voltage and temperature of the points over time."""
    panels = _panels_over_time(fit)
    rows = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (label, values) in zip(rows, panels, strict=True):
        for number, name in enumerate(fit.names):
            here = fit.points.run == number
            color = (BLUE, ORANGE, VERMILION, GREY)[number % 4]
            axes.plot(
                fit.points.time_s[here] / 60.0, values[here], ".-",
                color=color, linewidth=0.7, label=name,
            )  # fmt: skip
        axes.set_ylabel(label)
    rows[-1].set_xlabel("time of the run [min]")
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
