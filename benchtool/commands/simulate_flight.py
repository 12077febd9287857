"""`benchtool simulate flight`: a multirotor near surfaces under each controller."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from benchtool.commands import simulate_options as options

if TYPE_CHECKING:
    from benchtool.simulate.flight.vehicle import FlightVehicle


def command(
    case: Annotated[
        str,
        typer.Option(help="over, edge, oblique, corner, gust, ramp or plate."),
    ] = "over",
    rig: Annotated[str, typer.Option(help="Rig that flies.")] = "pquad",
    model: Annotated[
        str,
        typer.Option(help="Model whose ground effect acts, or its file; eq. (4) when left out."),
    ] = "",
    gains: options.Gains = None,
    controllers: Annotated[
        str,
        typer.Option(
            "--controllers",
            "--controller",
            help="Some of pid, observer, feedforward, both; your own as module:Class; oge (PID "
            "over nothing) in a campaign.",
        ),
    ] = "",
    z_over_r: Annotated[
        float, typer.Option("--z-over-r", help="Height over the obstacle in rotor radii.")
    ] = 2.0,
    speed_m_s: Annotated[
        float,
        typer.Option(
            "--speed-m-s", help="Speed limit; the case's own when left out.", show_default=False
        ),
    ] = 0.0,
    ramp: Annotated[
        bool, typer.Option("--ramp", help="Lead the reference along in place of a speed limit.")
    ] = False,
    gyro_noise_rad_s: Annotated[
        float | None,
        typer.Option(
            "--gyro-noise-rad-s",
            help="Standard deviation; left out: none, or the paper's 0.015 under several seeds.",
        ),
    ] = None,
    map_offset_m: Annotated[
        str, typer.Option("--map-offset-m", help="X,Y,Z of the feedforward's map; -0.05,0,0.")
    ] = "0,0,0",
    map_file: Annotated[
        Path | None, typer.Option("--map", help="Fly over this map (TOML or CSV) instead.")
    ] = None,
    goal_m: Annotated[str, typer.Option("--goal-m", help="X,Y to fly to instead.")] = "",
    lag_s: Annotated[float, typer.Option("--lag-s", help="Time constant of the motors.")] = 0.0,
    layout: Annotated[str, typer.Option(help="plus, or cross: turned by 45 degrees.")] = "plus",
    duration_s: options.Duration = 0.0,
    seed: options.Seed = 1,
    settings: options.Settings = None,
    vary: options.Varied = None,
    seeds: options.Seeds = 1,
    samples: options.Samples = 0,
    measure: options.MeasureName = "",
    out: options.Out = None,
) -> None:
    """Simulate flights over an obstacle under each controller.

    Numbers, recordings, a figure; or a campaign of many flights.
    """
    from typing import get_args

    from benchtool.commands.terminal.announce_code import announce_code
    from benchtool.commands.terminal.name_values import name_values
    from benchtool.core.errors import UnknownChoice
    from benchtool.report.flight.report import fly_each, report_lines, write_flights
    from benchtool.simulate.campaign_flight import OGE, FlightCampaign
    from benchtool.simulate.flight.cases import GYRO_NOISE_RAD_S
    from benchtool.simulate.flight.flight import FlightControl
    from benchtool.simulate.flight.map import read_map
    from benchtool.simulate.flight.setup import FlightSetup, changed, full_name
    from benchtool.simulate.gain_file import gains_named
    from benchtool.simulate.own_controllers import controller_class

    options.say_if_slow()
    known = get_args(FlightControl)
    names = options.controller_names(
        controllers or ("oge,pid" if vary else "pid,observer,feedforward"), known
    )
    for name in names:
        if name not in known and not (vary and name == OGE) and (vary or ":" not in name):
            raise UnknownChoice("controller of a flight", name, [*known, OGE] if vary else known)
    sets = options.gain_sets(gains)
    if gyro_noise_rad_s is None:
        gyro_noise_rad_s = GYRO_NOISE_RAD_S if seeds > 1 else 0.0
    offset_x_m, offset_y_m, offset_z_m = options.numbers_between_commas(
        "--map-offset-m", map_offset_m, 3
    )
    goal = options.numbers_between_commas("--goal-m", goal_m, 2) if goal_m else None
    setup = FlightSetup(
        case=case,
        vehicle=_vehicle(rig, model, lag_s, layout),
        gains=gains_named(sets[0]),
        z_over_R=z_over_r,
        speed_m_s=speed_m_s or None,
        duration_s=duration_s or None,
        goal_m=(goal[0], goal[1]) if goal else None,
        below=None if map_file is None else read_map(map_file),
        ramp=ramp,
        gyro_noise_rad_s=gyro_noise_rad_s,
        map_offset_m=(offset_x_m, offset_y_m, offset_z_m),
    )
    given = name_values(settings or [], "--set")
    if vary:
        from dataclasses import replace

        from benchtool.commands.terminal.campaign_display import run_with_progress
        from benchtool.simulate.design import Design

        setups = {
            name: changed(replace(setup, gains=gains_named(name)), given) for name in sets
        }  # fmt: skip
        design = Design.read(vary, samples=samples, seeds=seeds, seed=seed, full_name=full_name)
        campaign = FlightCampaign(setups=setups, controllers=tuple(names))
        run_with_progress(campaign, design, settings or [], measure, out)
        return
    options.refuse_without_vary(seeds=seeds > 1, samples=samples, measure=measure)
    options.one_gain_set(sets)
    setup = changed(setup, given)
    flown = setup.flown("pid", seed)
    own = [
        (name, controller_class(name, known, announce_code)) for name in names if name not in known
    ]
    built_in = [each for name in names for each in known if each == name]
    flights = fly_each(flown, built_in, own)
    options.show_study(report_lines(flights), lambda folder: write_flights(folder, flights), out)


def _vehicle(rig: str, model: str, lag_s: float, layout: str) -> FlightVehicle:
    """Return what flies."""
    from dataclasses import replace

    from benchtool.commands.terminal.announce_code import announce_code, print_notes
    from benchtool.core.errors import UnknownChoice
    from benchtool.core.rig_file import rig_named
    from benchtool.physics.model_file import load_model
    from benchtool.simulate.flight.vehicle import FlightVehicle

    if layout not in ("plus", "cross"):
        raise UnknownChoice("layout", layout, ("plus", "cross"))
    vehicle = FlightVehicle(rig=rig_named(rig))
    if model:
        loaded = load_model(model, rig_named(rig), announce_code)
        print_notes(loaded.notes)
        vehicle = FlightVehicle.of_model(loaded.model)
    return replace(vehicle, lag_s=lag_s, turned_deg=45.0 if layout == "cross" else 0.0)
