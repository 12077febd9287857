"""Tables of a sweep: settings, quantities, tares, limits, events."""

from __future__ import annotations

from math import isfinite

import numpy as np

from benchtool.core.recording import Recording
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.data.columns import REJECTED, speed_columns
from benchtool.report.numbers import value_with_sd
from benchtool.report.page import Block, Paragraph, Table
from benchtool.report.quantities import origins_table, values_table
from benchtool.report.style import BASES
from benchtool.report.sweep.figures import ERRORS
from benchtool.report.sweep.run import SweepRun

SHOWN_EVENTS = 60  # maximum number of events in the table; events.jsonl contains all
_LIMITS = {  # limits of a rig: label, unit, begin of channel names
    "thrust_N": ("thrust", "N", "thrust_N"),
    "rpm": ("rotor speed", "rpm", "rpm"),
    "current_A": ("current", "A", "current_A"),
    "temperature_degC": ("temperature", "°C", "temperature_degC"),
    "pwm_us": ("pulse", "µs", "pwm"),
}


def mean_rpm(run: SweepRun) -> Array:
    """Return the mean speed of the driven rotors per setting (s,); nan without speeds."""
    names = speed_columns(run.settings.names, "rpm")
    total, turning = np.zeros(len(run.settings)), np.zeros(len(run.settings))
    for name in names:
        rotor_rpm = np.nan_to_num(run.column(name))
        total, turning = total + rotor_rpm, turning + (rotor_rpm > 0.0)
    mean: Array = np.divide(total, turning, out=np.full(len(total), np.nan), where=turning > 0.0)
    return mean


def settings_table(run: SweepRun) -> Table:
    """Return a table of settings: distance, pulse width, speed, thrust, ratio."""
    z, levels = run.z_over_R(run.settings), run.level_us()
    rpm = mean_rpm(run)
    rows = []
    for row_index in range(len(run.settings)):
        thrust, error = run.column("thrust_N")[row_index], run.thrust_error_N[row_index]
        is_near = bool(run.measured()[row_index])
        offsets = run.column("plate_x_m")[row_index], run.column("plate_tilt_deg")[row_index]
        shifted = [
            f"{value:g} {unit}"
            for value, unit in zip(offsets, ("m shifted", "° tilted"), strict=True)
            if isfinite(value) and abs(value) > 1e-6
        ]
        rows.append(
            (
                " ".join([f"{z[row_index]:.3g}" if is_near else "parked", *shifted]),
                f"{levels[row_index]:g}",
                f"{run.column('n_repeats')[row_index]:.0f}",
                f"{rpm[row_index]:.0f}" if isfinite(rpm[row_index]) else "–",
                value_with_sd(float(thrust), float(error)),
                value_with_sd(float(run.ratio[row_index]), float(run.ratio_error[row_index]))
                if is_near and isfinite(run.ratio[row_index])
                else "–",
            )
        )
    if not run.uses_plate:
        head = ("pulse [µs]", "points", "mean rpm", "thrust [N]")
        caption = f"Throttle levels: means over repeats ± {ERRORS}."
        return Table(caption, head, [row[1:-1] for row in rows])
    return Table(
        f"Settings: means over repeats ± {ERRORS}. Ratios at {BASES[run.basis]}.",
        ("plate z/R", "pulse [µs]", "points", "mean rpm", "thrust [N]", "T_IGE/T_OGE"),
        rows,
    )


def quantity_tables(run: SweepRun) -> list[Table]:
    """Return tables of the quantities of each setting, and of their origin."""
    if not run.quantities:
        return []
    settings = settings_table(run)
    count = 2 if run.uses_plate else 1
    names = [[str(cell) for cell in row[:count]] for row in settings.rows]
    caption = "Quantities of each setting ± standard errors, including shared errors."
    return [
        values_table(caption, names, settings.header[:count], run.quantities),
        origins_table(run.quantities),
    ]


def tares_table(tares: Recording) -> Table:
    """Return a table of the load cell readings after each tare."""
    return Table(
        "Tares: load cell reading after the tare, motors at standstill.",
        ("time [min]", "offset [mN]", "samples"),
        [
            (
                f"{time / 60.0:.1f}",
                value_with_sd(1e3 * float(offset), 1e3 * float(se)),
                f"{count:.0f}",
            )
            for time, offset, se, count in zip(
                tares.column("time_s"),
                tares.column("thrust_N"),
                tares.column("thrust_se_N"),
                tares.column("n_samples"),
                strict=True,
            )
        ],
    )


def limits_table(run: SweepRun) -> Table:
    """Return a table of extreme readings and the limits of the rig."""
    limits, source = run.metadata["rig"]["limits"], run.samples or run.points
    rows = []
    for key, (label, unit, prefix) in _LIMITS.items():
        names = [
            name
            for name in source.names
            if name.startswith(prefix) and not name.endswith(("_se", "_sd_N", "_se_N", REJECTED))
        ]
        columns = [source.column(name) for name in names]
        if key not in limits or not columns or not np.isfinite(columns).any():
            continue
        maximum = float(np.nanmax(columns))
        margin = f"{100.0 * (1.0 - maximum / limits[key]):.0f} %"
        rows.append((label, unit, f"{maximum:.4g}", f"{limits[key]:g}", margin))
    min_V = limits.get("voltage_min_V", 0.0)
    if "voltage_V" in source and np.isfinite(source.column("voltage_V")).any() and min_V:
        lowest_V = float(np.nanmin(source.column("voltage_V")))
        margin = f"{100.0 * (lowest_V / min_V - 1.0):.0f} %"
        rows.append(("battery, minimum", "V", f"{lowest_V:.4g}", f"{min_V:g}", margin))
    return Table(
        "Extreme readings and rig limits.",
        ("quantity", "unit", "reading", "limit", "margin"),
        rows,
        text_columns=2,
    )


def events_block(run: SweepRun) -> Block:
    """Return the events of a run, without device messages."""
    events = [event for event in run.events if event.event != "device"]
    device = len(run.events) - len(events)
    more = f" In events.jsonl: {pluralize(device, 'message')} of the device." if device else ""
    if len(events) > SHOWN_EVENTS:
        more += f" The first {SHOWN_EVENTS} of {len(events)} are shown."
    if not events:
        return Paragraph("No events." + more)
    return Table(
        "Events." + more,
        ("event", "text", "point", "time [s]"),
        [
            (event.event, event.text, str(event.point or "–"), f"{event.time_s:.1f}")
            for event in events[:SHOWN_EVENTS]
        ],
        text_columns=2,
    )
