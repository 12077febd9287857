"""A flight as a study: flown, measured, and as a recording."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchtool.core.channel import Channel
from benchtool.core.recording import Recording
from benchtool.simulate.controllers.laws import FLIGHT_CONTROLLERS
from benchtool.simulate.flight.environment import Environment
from benchtool.simulate.flight.flight import Flight, FlightCase, fly
from benchtool.simulate.flight.measures import Measures, measure


@dataclass(frozen=True, slots=True, eq=False)
class FlownCase:
    """Hold a flight with its numbers."""

    flight: Flight
    measures: Measures

    @property
    def case(self) -> FlightCase:
        """What was flown."""
        return self.flight.case


def fly_and_measure(case: FlightCase) -> FlownCase:
    """Fly a case, as that of another flight with some fields replaced; take its numbers."""
    flight = fly(case)
    return FlownCase(flight, measure(flight))


def out_of_ground_effect(case: FlightCase) -> FlightCase:
    """Return the same flight with nothing below."""
    return replace(case, below=Environment(), gyro_noise_rad_s=0.0)


def name_of(flown: FlownCase) -> str:
    """Return what tables and figures call a flight's controller."""
    return flown.flight.own or FLIGHT_CONTROLLERS[flown.case.control]


def recording_of(flight: Flight) -> Recording:
    """Return a flight in the recording format, marked as simulated."""
    units = {"_s": "s", "_m": "m", "_m_s": "m/s", "_rad": "rad", "_rad_s": "rad/s"}
    units |= {"_Nm": "N m", "_N": "N"}

    def unit(name: str) -> str:
        fitting = [suffix for suffix in units if name.endswith(suffix)]
        return units[max(fitting, key=len)] if fitting else "1"

    finite = np.where(np.isinf(flight.log), np.nan, flight.log)
    case = flight.case
    return Recording(
        tuple(Channel(name, unit(name)) for name in flight.names),
        finite,
        {
            "flight": case.name,
            "rig": case.vehicle.rig.name,
            "gains": case.gains.name,
            "control": flight.own or case.control,
            "environment": case.below.name,
            "z_over_R": f"{case.start_m[2] / case.vehicle.rig.propulsion.radius_m:g}",
            "speed_m_s": f"{case.goals[-1].speed_m_s:g}",
            "gyro_noise_rad_s": f"{case.gyro_noise_rad_s:g}",
            "map_offset_m": ", ".join(f"{value:g}" for value in case.map_offset_m),
            "seed": str(case.seed),
            "ending": flight.ending,
        },
        simulated=True,
    )


def verdict(flown: FlownCase) -> str:
    """Say in one line what a flight came to."""
    found, goal = flown.measures, flown.case.goals[-1]
    if found.ending == "struck":
        return f"strikes the obstacle at {flown.flight.end_s:.1f} s"
    if found.arrives:
        return f"arrives at {found.arrives_s:.1f} s"
    if found.swing_m > 0.05:
        return f"never arrives: swings {found.range_m[0]:.2f} to {found.range_m[1]:.2f} m"
    return f"stays {abs(goal.x_m - found.range_m[0]):.2f} m short"


def obstacle_extent(case: FlightCase) -> tuple[float, float] | None:
    """Return where obstacles begin and end along x, when that is one finite stretch."""
    fixed = [block for block in case.below.blocks if not any(block.slide_m)]
    ends = [end for block in fixed for end in block.x_m]
    if not ends or not np.all(np.isfinite(ends)):
        return None
    return min(ends), max(ends)
