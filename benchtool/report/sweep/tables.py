"""Tables of a sweep's run: settings, tares, limits, events."""

from __future__ import annotations

from math import isfinite

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.plural import pluralize
from benchtool.core.recording import Recording
from benchtool.data.columns import REJECTED, speed_columns
from benchtool.report.numbers import value_with_sd
from benchtool.report.page import Block, Paragraph, Table
from benchtool.report.quantities import origins_table, values_table
from benchtool.report.style import BASES
from benchtool.report.sweep.figures import ERRORS
from benchtool.report.sweep.run import SweepRun

SHOWN_EVENTS = 60  # events in the table; a run with more has them all in its events.jsonl
_LIMITS = {  # limits of a rig: words, unit, channels
    "thrust_N": ("thrust", "N", "thrust_N"),
    "rpm": ("rotor speed", "rpm", "rpm"),
    "current_A": ("current", "A", "current_A"),
    "temperature_degC": ("temperature", "°C", "temperature_degC"),
    "pwm_us": ("pulse", "µs", "pwm"),
}


def mean_rpm(run: SweepRun) -> Array:
    """Return the mean speed of the rotors that turn, for each setting (s,); nan without speeds."""
    names = speed_columns(run.settings.names, "rpm")
    total, turning = np.zeros(len(run.settings)), np.zeros(len(run.settings))
    for name in names:
        own = np.nan_to_num(run.column(name))
        total, turning = total + own, turning + (own > 0.0)
    mean: Array = np.divide(total, turning, out=np.full(len(total), np.nan), where=turning > 0.0)
    return mean


def settings_table(run: SweepRun) -> Table:
    """List every setting: where, how fast, how much thrust, which ratio."""
    z, levels = run.z_over_R(run.settings), run.level_us()
    rpm = mean_rpm(run)
    rows = []
    for place in range(len(run.settings)):
        thrust, error = run.column("thrust_N")[place], run.thrust_error_N[place]
        near = bool(run.measured()[place])
        side = run.column("plate_x_m")[place], run.column("plate_tilt_deg")[place]
        shifted = [
            f"{value:g} {unit}"
            for value, unit in zip(side, ("m aside", "° tilted"), strict=True)
            if isfinite(value) and abs(value) > 1e-6
        ]
        rows.append(
            (
                " ".join([f"{z[place]:.3g}" if near else "parked", *shifted]),
                f"{levels[place]:g}",
                f"{run.column('n_repeats')[place]:.0f}",
                f"{rpm[place]:.0f}" if isfinite(rpm[place]) else "–",
                value_with_sd(float(thrust), float(error)),
                value_with_sd(float(run.ratio[place]), float(run.ratio_error[place]))
                if near and isfinite(run.ratio[place])
                else "–",
            )
        )
    if not run.uses_plate:
        head = ("pulse [µs]", "visits", "mean rpm", "thrust [N]")
        caption = f"Each throttle level: means over its repeats ± {ERRORS}."
        return Table(caption, head, [row[1:-1] for row in rows])
    return Table(
        f"Each setting: means over its repeats ± {ERRORS}. Ratios at {BASES[run.basis]}.",
        ("plate z/R", "pulse [µs]", "visits", "mean rpm", "thrust [N]", "T_IGE/T_OGE"),
        rows,
    )


def quantity_tables(run: SweepRun) -> list[Table]:
    """List the quantities of every setting, and what they are worked out from."""
    if not run.quantities:
        return []
    settings = settings_table(run)
    count = 2 if run.uses_plate else 1
    names = [[str(cell) for cell in row[:count]] for row in settings.rows]
    caption = "Quantities of each setting ± standard errors, of what all settings share as well."
    return [
        values_table(caption, names, settings.header[:count], run.quantities),
        origins_table(run.quantities),
    ]


def tares_table(tares: Recording) -> Table:
    """List what was left after each tare."""
    return Table(
        "Tares: what was left with the motors at rest.",
        ("time [min]", "left [mN]", "samples"),
        [
            (
                f"{time / 60.0:.1f}",
                value_with_sd(1e3 * float(left), 1e3 * float(se)),
                f"{count:.0f}",
            )
            for time, left, se, count in zip(
                tares.column("time_s"),
                tares.column("thrust_N"),
                tares.column("thrust_se_N"),
                tares.column("n_samples"),
                strict=True,
            )
        ],
    )


def limits_table(run: SweepRun) -> Table:
    """Set the largest reading beside each limit that no reading may exceed."""
    limits, source = run.metadata["rig"]["limits"], run.samples or run.points
    rows = []
    for key, (words, unit, begins) in _LIMITS.items():
        names = [
            name
            for name in source.names
            if name.startswith(begins) and not name.endswith(("_se", "_sd_N", "_se_N", REJECTED))
        ]
        seen = [source.column(name) for name in names]
        if key not in limits or not seen or not np.isfinite(seen).any():
            continue
        most = float(np.nanmax(seen))
        room = f"{100.0 * (1.0 - most / limits[key]):.0f} %"
        rows.append((words, unit, f"{most:.4g}", f"{limits[key]:g}", room))
    least_V = limits.get("voltage_min_V", 0.0)
    if "voltage_V" in source and np.isfinite(source.column("voltage_V")).any() and least_V:
        seen_V = float(np.nanmin(source.column("voltage_V")))
        room = f"{100.0 * (seen_V / least_V - 1.0):.0f} %"
        rows.append(("battery, least", "V", f"{seen_V:.4g}", f"{least_V:g}", room))
    return Table(
        "Largest readings against the rig's limits.",
        ("limit", "unit", "reading", "limit at", "room left"),
        rows,
        text_columns=2,
    )


def events_block(run: SweepRun) -> Block:
    """Return what happened during the run, without the device's chatter."""
    shown = [event for event in run.events if event.event != "device"]
    device = len(run.events) - len(shown)
    more = f" In events.jsonl: {pluralize(device, 'message')} of the device." if device else ""
    if len(shown) > SHOWN_EVENTS:
        more += f" The first {SHOWN_EVENTS} of {len(shown)} are shown."
    if not shown:
        return Paragraph("Nothing happened that is worth reporting." + more)
    return Table(
        "Events." + more,
        ("event", "what", "visit", "time [s]"),
        [
            (event.event, event.text, str(event.point or "–"), f"{event.time_s:.1f}")
            for event in shown[:SHOWN_EVENTS]
        ],
        text_columns=2,
    )
