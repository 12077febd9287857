"""Flights over a design of numbers: one after the other in the compiled loop, on all cores."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import NamedTuple

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.simulate.campaign import Campaign, Point, Row, at_point, results_in_order
from benchtool.simulate.design import Design
from benchtool.simulate.flight.environment import Environment
from benchtool.simulate.flight.flight import FlightCase, fly
from benchtool.simulate.flight.measures import measure
from benchtool.simulate.flight.setup import FlightSetup, with_changes
from benchtool.simulate.flight.warnings import too_short

OGE = "oge"  # PID with nothing below: what a gain set does by itself, without ground effect

MEASURES = {
    "arrives": "share of flights that arrive",
    "struck": "share of flights that strike the obstacle",
    "arrives_s": "time of arrival [s]",
    "max_x_m": "furthest x [m]",
    "push_backs": "push-backs of more than 3 cm",
    "max_pitch_deg": "largest pitch [deg]",
    "rms_pitch_deg": "RMS of pitch [deg]",
    "max_roll_deg": "largest roll [deg]",
    "swing_m": "swing of x over the last 20 s [m]",
}
"""What every flight is summed up in, as in its table; arrives_s is nan where it never does."""


class FlightPoint(NamedTuple):
    """A flight at a point of a design."""

    setup: FlightSetup
    control: str
    point: Point

    def flown(self, seed: int) -> FlightCase:
        """Return the flight under one noise."""
        if self.control == OGE:
            return replace(self.setup.flown("pid", seed), below=Environment())
        return self.setup.flown(self.control, seed)


def flight_campaign(setups: Mapping[str, FlightSetup], controllers: tuple[str, ...]) -> Campaign:
    """Return the campaign of flights by gain set, under flight controls and `OGE`."""
    first = next(iter(setups.values()))
    flown = first.flown("pid")
    return Campaign(
        title=f"{flown.title}, {first.vehicle.rig.name}",
        metadata={"flight": first.case} | first.words(),
        setups=setups,
        controllers=controllers,
        measures=MEASURES,
        probe=partial(_probe, controllers[0]),
        case=lambda setup, control, point: FlightPoint(with_changes(setup, point), control, point),
        run=lambda cases, seed, threads: results_in_order(
            (partial(_measured, case, seed + number) for case, number in cases), threads
        ),
    )


def _probe(control: str, setup: FlightSetup, point: Point, design: Design) -> None:
    """Fly a point for an instant, as far as a start can fail."""
    noisy = setup.gyro_noise_rad_s > 0.0 or "gyro_noise_rad_s" in design.names
    if design.seeds > 1 and not noisy:
        raise InputError(
            f"{design.seeds} seeds, but the gyro has no noise, so that all would be alike; "
            f"give --gyro-noise-rad-s (the paper has 0.015) or leave --seeds out"
        )
    try:
        case = FlightPoint(with_changes(setup, point), control, point).flown(1)
        if why := too_short(case):
            raise InputError(why)
        fly(replace(case, duration_s=2.0 / case.gains.control_rate_Hz))
    except UnknownChoice:
        raise
    except InputError as error:
        raise at_point(error, point) from error


def _measured(case: FlightPoint, seed: int) -> Row:
    try:
        found = measure(fly(case.flown(seed)))
    except InputError as error:
        raise at_point(error, case.point) from error
    # "struck" is an ending and no measure of its own.
    numbers = {name: float(getattr(found, name, found.ending == name)) for name in MEASURES}
    return {"ending": found.ending, **numbers, "held_ticks": float(found.held_ticks)}
