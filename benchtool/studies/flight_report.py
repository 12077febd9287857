"""Flights of one case under several controllers: the table, the files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from benchtool.errors import InputError
from benchtool.report.files import refuse_existing, save_figure
from benchtool.report.flight import flight_figure
from benchtool.simulate.flight import FlightCase, FlightControl
from benchtool.simulate.flight_measures import measure
from benchtool.simulate.flight_own import fly_own
from benchtool.simulate.in_order import results_in_order
from benchtool.simulate.own_controller import made
from benchtool.store.write import write_table
from benchtool.studies.flight import (
    CONTROL_NAMES,
    Flown,
    fly_and_measure,
    obstacle_extent,
    out_of_ground_effect,
    recording_of,
    trace_of,
)


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
    beside = replace(out_of_ground_effect(case), control="pid")
    cases = [beside, *(replace(case, control=control) for control in controls)]
    flights = list(results_in_order(partial(fly_and_measure, each) for each in cases))
    for name, kind in own:
        flight = fly_own(case, made(kind, name), name)
        flights.append(Flown(flight, measure(flight)))
    return flights


def name_of(flown: Flown) -> str:
    """Return what tables and figures call a flight's controller."""
    return flown.flight.own or CONTROL_NAMES[flown.case.control]


def table_lines(flights: Sequence[Flown]) -> list[str]:
    """Return the table of numbers; the first flight is the one out of ground effect."""
    names = [name_of(flown) for flown in flights]
    names[0] += " OGE"
    width = max(len(name) for name in names)
    lines = [
        f"{'controller':<{width}}  arrives s          max x m  push-backs  max pitch  RMS pitch  "
        f"max roll  x in last 20 s",
        f"{'':<{width}}                                           deg        deg       deg  m",
    ]
    for name, flown in zip(names, flights, strict=True):
        found = flown.measures
        low, high = found.range_m
        lines.append(
            f"{name:<{width}}  {found.arrival_text():<17}  {found.max_x_m:>7.2f}  "
            f"{found.push_backs:>10}  {found.max_pitch_deg:>9.1f}  {found.rms_pitch_deg:>9.2f}  "
            f"{found.max_roll_deg:>8.1f}  {low:.3f}..{high:.3f}"
        )
    return lines


def warnings_of(flights: Sequence[Flown]) -> list[str]:
    """Return what a reader of the numbers must know."""
    out = []
    for flown in flights:
        name = name_of(flown)
        if flown.flight.ending == "struck":
            out.append(f"{name}: a rotor touched the obstacle at {flown.flight.end_s:.2f} s")
        if flown.flight.ending == "lost":
            out.append(f"{name}: the numbers left the finite range at {flown.flight.end_s:.2f} s")
        if flown.measures.max_roll_deg > 90.0:
            out.append(
                f"{name}: it turned over (roll {flown.measures.max_roll_deg:.0f} deg); its other "
                f"numbers are those of a fall"
            )
        if flown.measures.held_ticks:
            out.append(
                f"{name}: a rotor came nearer than z/R = 0.5 in {flown.measures.held_ticks} steps; "
                f"its height was held there, where the formulae end"
            )
    mapped = [flown for flown in flights if flown.case.control in ("feedforward", "both")]
    if any(not flown.flight.own for flown in mapped) and not any(
        any(flown.case.map_offset_m) for flown in flights
    ):
        out.append(
            "feedforward: its map is the plant's own model, so that it is best by construction"
        )
    return out


def write_flights(out: Path, flights: Sequence[Flown]) -> list[Path]:
    """Write one CSV for each flight, the table and the figure; refuses to write over anything."""
    names = [flown.flight.own.replace(":", "-") or flown.case.control for flown in flights]
    names[0] = "oge"
    if len(set(names)) < len(names):
        raise InputError(f"a controller is named twice: {', '.join(names[1:])}; name each once")
    tables = {out / f"{name}.csv": flown for name, flown in zip(names, flights, strict=True)}
    text = out / "numbers.txt"
    refuse_existing([*tables, text, out / "flight.svg", out / "flight.png"])
    out.mkdir(parents=True, exist_ok=True)
    for path, flown in tables.items():
        write_table(path, recording_of(flown.flight))
    text.write_text("\n".join(table_lines(flights)) + "\n", encoding="utf-8")
    first = flights[1].case
    height = first.start_m[2] / first.vehicle.rig.propulsion.radius_m
    figure = flight_figure(
        [trace_of(flown, name_of(flown)) for flown in flights[1:]],
        title=f"{first.title}, z/R = {height:.3g}, gains {first.gains.name}",
        beside=trace_of(flights[0], "PID out of ground effect"),
        obstacle_m=obstacle_extent(first),
    )
    return [*tables, text, *save_figure(figure, out / "flight")]
