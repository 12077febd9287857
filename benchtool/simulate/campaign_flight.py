"""Campaign of flights, on all cores."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import NamedTuple

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.simulate.campaign import Campaign, Point, Row, at_point
from benchtool.simulate.design import Design
from benchtool.simulate.flight.environment import Environment
from benchtool.simulate.flight.flight import FlightCase, fly
from benchtool.simulate.flight.measures import measure
from benchtool.simulate.flight.setup import FlightSetup, with_changes
from benchtool.simulate.flight.warnings import check_duration
from benchtool.simulate.loop import results_in_order

OGE = "oge"  # PID without ground effect, the reference of a gain set

MEASURES = {  # of every flight, as in its table; arrives_s is nan without arrival
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


class FlightPoint(NamedTuple):
    """Flight at a point of a design."""

    setup: FlightSetup
    control: str
    point: Point

    def build_case(self, seed: int) -> FlightCase:
        """Return the case with one noise seed."""
        if self.control == OGE:
            return replace(self.setup.build_case("pid", seed), below=Environment())
        return self.setup.build_case(self.control, seed)


def flight_campaign(setups: Mapping[str, FlightSetup], controllers: tuple[str, ...]) -> Campaign:
    """Return the campaign of flights by gain set, with flight controllers and `OGE`."""
    first = next(iter(setups.values()))
    example = first.build_case("pid")
    return Campaign(
        title=f"{example.title}, {first.vehicle.rig.name}",
        metadata={"flight": first.case} | first.to_metadata(),
        setups=setups,
        controllers=controllers,
        measures=MEASURES,
        probe=partial(_probe, controllers[0]),
        case=lambda setup, control, point: FlightPoint(with_changes(setup, point), control, point),
        run=lambda cases, seed, threads: results_in_order(
            (partial(_measure_flight, case, seed + number) for case, number in cases), threads
        ),
    )


def _probe(control: str, setup: FlightSetup, point: Point, design: Design) -> None:
    """Fly the first two control periods of a point; raise InputError if it cannot start."""
    has_noise = setup.gyro_noise_rad_s > 0.0 or "gyro_noise_rad_s" in design.names
    if design.seeds > 1 and not has_noise:
        raise InputError(
            f"{design.seeds} seeds give identical flights without gyro noise; "
            f"set --gyro-noise-rad-s (paper: 0.015) or remove --seeds"
        )
    try:
        case = FlightPoint(with_changes(setup, point), control, point).build_case(1)
        if warning := check_duration(case):
            raise InputError(warning)
        fly(replace(case, duration_s=2.0 / case.gains.control_rate_Hz))
    except UnknownChoice:
        raise
    except InputError as error:
        raise at_point(error, point) from error


def _measure_flight(case: FlightPoint, seed: int) -> Row:
    try:
        measures = measure(fly(case.build_case(seed)))
    except InputError as error:
        raise at_point(error, case.point) from error
    # "struck" is an ending, not an attribute.
    numbers = {name: float(getattr(measures, name, measures.ending == name)) for name in MEASURES}
    return {"ending": measures.ending, **numbers, "held_ticks": float(measures.held_ticks)}
