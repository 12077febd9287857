"""`benchtool simulate flight`: a multirotor near surfaces under each controller."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer


def command(
    case: Annotated[
        str,
        typer.Option(help="over, edge, oblique, corner, gust, ramp or plate."),
    ] = "over",
    rig: Annotated[str, typer.Option(help="Rig that flies.")] = "pquad",
    model: Annotated[
        str, typer.Option(help="Model whose ground effect acts, or its file; eq. (4) without.")
    ] = "",
    gains: Annotated[str, typer.Option(help="Gain set (s3, s1a, stiff), or its file.")] = "s3",
    controllers: Annotated[
        str, typer.Option(help="Some of pid, observer, feedforward, both; with commas.")
    ] = "pid,observer,feedforward",
    z_over_r: Annotated[
        float, typer.Option("--z-over-r", help="Height over the obstacle in rotor radii.")
    ] = 2.0,
    speed_m_s: Annotated[
        float, typer.Option("--speed-m-s", help="Speed limit; the case's own without.")
    ] = 0.0,
    ramp: Annotated[
        bool, typer.Option("--ramp", help="Lead the reference along in place of a speed limit.")
    ] = False,
    gyro_noise_rad_s: Annotated[
        float, typer.Option("--gyro-noise-rad-s", help="Standard deviation; the paper has 0.015.")
    ] = 0.0,
    map_offset_m: Annotated[
        str, typer.Option("--map-offset-m", help="X,Y,Z of the feedforward's map; -0.05,0,0.")
    ] = "0,0,0",
    map_file: Annotated[
        Path | None, typer.Option("--map", help="Fly over this map (TOML or CSV) instead.")
    ] = None,
    goal_m: Annotated[str, typer.Option("--goal-m", help="X,Y to fly to instead.")] = "",
    lag_s: Annotated[float, typer.Option("--lag-s", help="Time constant of the motors.")] = 0.0,
    layout: Annotated[str, typer.Option(help="plus, or cross: turned by 45 degrees.")] = "plus",
    duration_s: Annotated[
        float, typer.Option("--duration-s", help="Length; the case's own without.")
    ] = 0.0,
    seed: Annotated[int, typer.Option(help="Seed of the noise.", min=0)] = 1,
    out: Annotated[Path | None, typer.Option(help="Folder for CSV, table and figure.")] = None,
) -> None:
    """Simulate a flight over an obstacle: numbers, recordings, figure."""
    from dataclasses import replace
    from typing import Any, get_args

    from benchtool.aero.expression import can_compile
    from benchtool.errors import InputError, UnknownChoice
    from benchtool.library import gains_named, load_model, rig_named
    from benchtool.simulate.flight import FlightControl, Goal
    from benchtool.simulate.flight_cases import flight_case
    from benchtool.simulate.flight_vehicle import FlightVehicle
    from benchtool.studies.flight_map import read_map
    from benchtool.studies.flight_report import fly_each, table_lines, warnings_of

    if not can_compile():
        print(
            "numba is not installed, so this runs as plain Python and takes minutes; "
            "pip install benchtool[fast] makes it a second",
            file=sys.stderr,
        )
    if layout not in ("plus", "cross"):
        raise UnknownChoice("layout", layout, ("plus", "cross"))
    names = [name.strip() for name in controllers.split(",") if name.strip()]
    known = get_args(FlightControl)
    for name in names:
        if name not in known:
            raise UnknownChoice("controller of a flight", name, known)
    if not names:
        raise InputError(f"no controller was named; name some of: {', '.join(known)}")
    vehicle = FlightVehicle(rig=rig_named(rig))
    if model:
        vehicle = FlightVehicle.of_model(load_model(model, rig_named(rig)).model)
    vehicle = replace(vehicle, lag_s=lag_s, turned_deg=45.0 if layout == "cross" else 0.0)
    changes: dict[str, Any] = {
        "ramp": ramp,
        "gyro_noise_rad_s": gyro_noise_rad_s,
        "map_offset_m": _numbers("--map-offset-m", map_offset_m, 3),
        "seed": seed,
    }
    if duration_s:
        changes["duration_s"] = duration_s
    if map_file is not None:
        changes["below"] = read_map(map_file)
    if goal_m:
        x, y = _numbers("--goal-m", goal_m, 2)
        z_m = z_over_r * vehicle.rig.propulsion.radius_m
        changes["goals"] = (Goal(x_m=x, y_m=y, z_m=z_m, speed_m_s=speed_m_s or 0.2),)
    flown = flight_case(
        case,
        vehicle,
        gains_named(gains),
        z_over_R=z_over_r,
        speed_m_s=speed_m_s or None,
        **changes,
    )
    flights = fly_each(flown, names)  # type: ignore[arg-type]
    print(
        f"SIMULATED flight {flown.name}: {flown.title}; rig {rig}, z/R {z_over_r:g}, "
        f"{flown.goals[-1].speed_m_s:g} m/s, gains {gains}"
    )
    for line in [*table_lines(flights), *warnings_of(flights)]:
        print(line, flush=True)
    if out is None:
        print("add --out FOLDER for the recordings (CSV) and the figure")
        return
    from benchtool.studies.flight_report import write_flights

    for path in write_flights(out, flights):
        print(f"written: {path}")


def _numbers(option: str, text: str, count: int) -> tuple[float, ...]:
    """Return so many numbers with commas between."""
    from benchtool.errors import InputError

    try:
        numbers = tuple(float(word) for word in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != count:
        raise InputError(f"{option} is {text!r}; give {count} numbers with commas between")
    return numbers
