"""Flights over a design of numbers: one after the other in the compiled loop, on all cores."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.simulate.campaign import Measure, Row, at_point
from benchtool.simulate.design import Design
from benchtool.simulate.environment import Environment
from benchtool.simulate.flight.flight import FlightCase, fly
from benchtool.simulate.flight.measures import measure
from benchtool.simulate.flight.setup import FlightSetup, changed
from benchtool.simulate.flight.warnings import too_short
from benchtool.simulate.in_order import results_in_order

OGE = "oge"
"""PID with nothing below: what a gain set does by itself, without ground effect."""

MEASURES = {
    "arrives": Measure(text="share of flights that arrive", share=True),
    "struck": Measure(text="share of flights that strike the obstacle", share=True),
    "arrives_s": Measure(text="time of arrival [s]"),
    "max_x_m": Measure(text="furthest x [m]"),
    "push_backs": Measure(text="push-backs of more than 3 cm"),
    "max_pitch_deg": Measure(text="largest pitch [deg]"),
    "rms_pitch_deg": Measure(text="RMS of pitch [deg]"),
    "max_roll_deg": Measure(text="largest roll [deg]"),
    "swing_m": Measure(text="swing of x over the last 20 s [m]"),
}
"""What every flight is summed up in, as in its table; arrives_s is nan where it never does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightCampaign:
    """Fly one case at many points; see `Campaign`.

    Attributes:
        setups: the flight by the name of the gain set.
        controllers: flight controls, and `OGE`.
    """

    setups: Mapping[str, FlightSetup]
    controllers: tuple[str, ...]

    @property
    def _first(self) -> FlightSetup:
        return next(iter(self.setups.values()))

    @property
    def title(self) -> str:
        """See `Campaign`."""
        return f"{self._first.flown('pid').title}, {self._first.vehicle.rig.name}"

    @property
    def metadata(self) -> Mapping[str, str]:
        """See `Campaign`."""
        return {"flight": self._first.case} | self._first.words()

    @property
    def fixed(self) -> Mapping[str, str]:
        """See `Campaign`."""
        setup = self._first
        return {
            "z_over_R": f"{setup.z_over_R:g}",
            "speed_m_s": f"{setup.flown('pid').goals[-1].speed_m_s:g}",
            "K_b": f"{setup.vehicle.K_b:g}",
            "gyro_noise_rad_s": f"{setup.gyro_noise_rad_s:g}",
        }

    @property
    def gain_sets(self) -> tuple[str, ...]:
        """See `Campaign`."""
        return tuple(self.setups)

    @property
    def measures(self) -> Mapping[str, Measure]:
        """See `Campaign`."""
        return MEASURES

    def check(self, design: Design) -> None:
        """See `Campaign`; every probe is flown for an instant, as far as a start can fail."""
        noisy = self._first.gyro_noise_rad_s > 0.0 or "gyro_noise_rad_s" in design.names
        if design.seeds > 1 and not noisy:
            raise InputError(
                f"{design.seeds} seeds, but the gyro has no noise, so that all would be alike; "
                f"give --gyro-noise-rad-s (the paper has 0.015) or leave --seeds out"
            )
        for setup in self.setups.values():
            for point in design.probes():
                try:
                    case = _case(changed(setup, point), self.controllers[0], 1)
                    if why := too_short(case):
                        raise InputError(why)
                    fly(replace(case, duration_s=2.0 / case.gains.control_rate_Hz))
                except UnknownChoice:
                    raise
                except InputError as error:
                    raise at_point(error, point) from error

    def rows(self, design: Design, threads: int | None = None) -> Iterator[Row]:
        """See `Campaign`."""

        def tasks() -> Iterator[Callable[[], Row]]:
            for gains, setup in self.setups.items():
                for control in self.controllers:
                    for point in design.points():
                        here = changed(setup, point)
                        label: Row = {**point, "gains": gains, "controller": control}
                        for number in range(design.seeds):
                            yield partial(_row, label, point, here, control, design.seed + number)

        return results_in_order(tasks(), threads)


def _case(setup: FlightSetup, control: str, seed: int) -> FlightCase:
    if control == OGE:
        return replace(setup.flown("pid", seed), below=Environment())
    return setup.flown(control, seed)


def _row(
    label: Row, point: Mapping[str, float], setup: FlightSetup, control: str, seed: int
) -> Row:
    try:
        found = measure(fly(_case(setup, control, seed)))
    except InputError as error:
        raise at_point(error, point) from error
    return {
        **label,
        "seed": float(seed),
        "ending": found.ending,
        "arrives": float(found.arrives),
        "struck": float(found.ending == "struck"),
        "arrives_s": found.arrives_s,
        "max_x_m": found.max_x_m,
        "push_backs": float(found.push_backs),
        "max_pitch_deg": found.max_pitch_deg,
        "rms_pitch_deg": found.rms_pitch_deg,
        "max_roll_deg": found.max_roll_deg,
        "swing_m": found.swing_m,
        "held_ticks": float(found.held_ticks),
    }
