"""Flights of one case under several controllers: the table, the files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from benchtool import __version__
from benchtool.core.errors import InputError
from benchtool.data.run.recording_file import beside, write_recording
from benchtool.report.figure import drawn
from benchtool.report.files import refuse_existing, save_figure
from benchtool.simulate.campaign import results_in_order
from benchtool.simulate.flight.flight import FlightCase, FlightControl
from benchtool.simulate.flight.measures import measure
from benchtool.simulate.flight.own import fly_own
from benchtool.simulate.flight.study import (
    Flown,
    fly_and_measure,
    name_of,
    out_of_ground_effect,
    recording_of,
)
from benchtool.simulate.flight.warnings import warnings_of
from benchtool.simulate.own_controller import made


def fly_each(
    case: FlightCase,
    controls: Sequence[FlightControl],
    own: Sequence[tuple[str, type[Any]]] = (),
) -> list[Flown]:
    """Fly a case out of ground effect with PID first, then under each controller.

    Args:
        case: what is flown.
        controls: built-in controllers.
        own: name and class of the user's own; a new one is made for every flight.
    """
    free = replace(out_of_ground_effect(case), control="pid")
    cases = [free, *(replace(case, control=control) for control in controls)]
    flights = list(results_in_order(partial(fly_and_measure, each) for each in cases))
    for name, kind in own:
        flight = fly_own(case, made(kind, name), name)
        flights.append(Flown(flight, measure(flight)))
    return flights


def table_lines(flights: Sequence[Flown]) -> list[str]:
    """Return the table of numbers; the first flight is the one out of ground effect."""
    names = [name_of(flown) for flown in flights]
    names[0] += " OGE"
    heads = (
        "controller", "arrives s", "max x m", "push-backs", "max pitch", "RMS pitch", "max roll",
        "z from set", "x in last 20 s",
    )  # fmt: skip
    units = ("", "", "", "", "deg", "deg", "deg", "cm", "m")
    rows = []
    for name, flown in zip(names, flights, strict=True):
        found = flown.measures
        low_cm, high_cm = (round(100.0 * z_m, 1) + 0.0 for z_m in found.range_z_m)
        low, high = found.range_m
        rows.append(
            (
                name, found.arrival_text(), f"{found.max_x_m:.2f}", f"{found.push_backs}",
                f"{found.max_pitch_deg:.1f}", f"{found.rms_pitch_deg:.2f}",
                f"{found.max_roll_deg:.1f}", f"{low_cm:.1f}..{high_cm:.1f}",
                f"{low:.3f}..{high:.3f}",
            )
        )  # fmt: skip
    widths = [max(map(len, column)) for column in zip(heads, units, *rows, strict=True)]
    left = (0, 1, len(heads) - 1)

    def line(cells: Sequence[str]) -> str:
        padded = (
            cell.ljust(width) if at in left else cell.rjust(width)
            for at, (cell, width) in enumerate(zip(cells, widths, strict=True))
        )
        return "  ".join(padded).rstrip()

    return [line(cells) for cells in (heads, units, *rows)]


def report_lines(flights: Sequence[Flown]) -> list[str]:
    """Return all that is said of the flights: what was flown, the table, the warnings."""
    case = flights[0].case
    z_over_R = case.start_m[2] / case.vehicle.rig.propulsion.radius_m
    head = (
        f"SIMULATED flight {case.name}: {case.title}; rig {case.vehicle.rig.name}, "
        f"z/R {z_over_R:.4g}, {case.goals[-1].speed_m_s:g} m/s, gains {case.gains.name}"
    )
    return [head, *table_lines(flights), *warnings_of(flights)]


def write_flights(out: Path, flights: Sequence[Flown]) -> list[Path]:
    """Write a recording for each flight, the lines of the report and the figure.

    Raises:
        WouldOverwrite: one of the files is there already.
    """
    names = [flown.flight.own.replace(":", "-") or flown.case.control for flown in flights]
    names[0] = "oge"
    if len(set(names)) < len(names):
        raise InputError(f"a controller is named twice: {', '.join(names[1:])}; name each once")
    tables = {out / f"{name}.csv": flown for name, flown in zip(names, flights, strict=True)}
    text = out / "numbers.txt"
    figures = [out / "flight.svg", out / "flight.png"]
    refuse_existing([*tables, *(beside(path) for path in tables), text, *figures])
    out.mkdir(parents=True, exist_ok=True)
    for path, flown in tables.items():
        write_recording(path, recording_of(flown.flight), {"software": f"benchtool {__version__}"})
    text.write_text("\n".join(report_lines(flights)) + "\n", encoding="utf-8")
    block = drawn("flight", flights)["flight"]
    return [*tables, text, *save_figure(block.figure, out / "flight")]
