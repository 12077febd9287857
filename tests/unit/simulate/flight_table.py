"""The notes' table of flights (section 3.3): what a planar prototype gave, row by row.

The paper prints no numbers for its figures 12 to 24; this table is an independent planar program's
answer to the same cases with gain set S3, and the flight simulator is held to it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import nan

from benchtool.simulate.flight.cases import GYRO_NOISE_RAD_S, FlightCase, flight_case
from benchtool.simulate.flight.study import Measures
from benchtool.simulate.flight.vehicle import FlightVehicle
from benchtool.simulate.gain_file import Gains


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """Hold one row.

    Attributes:
        flight: "over" (case 1) or "edge" (case 2).
        speed_m_s, control, z_over_R: as flown; z/R None is out of ground effect.
        map_early_m: how much too early the map has the edge.
        noisy: with gyro noise.
        arrives: "yes", "never", "struck", or "reported" where outcome and numbers are not compared.
        arrives_s, max_x_m, max_pitch_deg, rms_pitch_deg: of the prototype; nan where not given.
        range_m: position limits in the last 20 s.
        push_backs: of case 1; None where not given.
    """

    flight: str
    speed_m_s: float
    control: str
    z_over_R: float | None
    arrives: str
    arrives_s: float
    max_x_m: float
    max_pitch_deg: float
    rms_pitch_deg: float
    range_m: tuple[float, float]
    push_backs: int | None = None
    map_early_m: float = 0.0
    noisy: bool = False

    @property
    def swing_m(self) -> float:
        """Width of the last 20 s."""
        return self.range_m[1] - self.range_m[0]

    def label(self) -> str:
        """Say in words what is flown."""
        height = "OGE" if self.z_over_R is None else f"z/R {self.z_over_R:g}"
        extra = ""
        if self.map_early_m:
            extra = f", map {100.0 * abs(self.map_early_m):.0f} cm "
            extra += "early" if self.map_early_m > 0.0 else "late"
        return f"{self.flight} {self.speed_m_s:g} m/s {height} {self.control}{extra}" + (
            ", gyro noise" if self.noisy else ""
        )

    def case(self, vehicle: FlightVehicle, gains: Gains, seed: int = 1) -> FlightCase:
        """Return the flight to compare."""
        return flight_case(
            self.flight,
            vehicle,
            gains,
            z_over_R=self.z_over_R,
            speed_m_s=self.speed_m_s,
            control=self.control,
            map_offset_m=(-self.map_early_m, 0.0, 0.0),
            gyro_noise_rad_s=GYRO_NOISE_RAD_S if self.noisy else 0.0,
            seed=seed,
        )

    def outcome(self, found: Measures) -> str:
        """Return "yes", "never" or "struck" of what was found."""
        if found.ending != "flown":
            return "struck"
        return "yes" if found.arrives else "never"

    def departures(self, found: Measures) -> list[str]:
        """Say where a flight departs from the row by more than is agreed.

        Rows that arrive: 10 % or the last printed digit in every number. Others: the same outcome,
        and the swing within 10 %. Rows that are only reported: nothing.
        """
        if self.arrives == "reported":
            return []
        if (outcome := self.outcome(found)) != self.arrives:
            return [f"outcome {outcome}, expected {self.arrives}"]
        if self.arrives == "struck":
            return []
        if self.arrives == "never":
            off = abs(found.swing_m - self.swing_m)
            if off <= 0.1 * self.swing_m:
                return []
            return [f"swing {found.swing_m:.3f} m, expected {self.swing_m:.3f}"]
        pairs = {
            "arrives s": (found.arrives_s, self.arrives_s, 0.1),
            "max x": (found.max_x_m, self.max_x_m, 0.01),
            "max pitch deg": (found.max_pitch_deg, self.max_pitch_deg, 0.1),
            "rms pitch deg": (found.rms_pitch_deg, self.rms_pitch_deg, 0.01),
            "range low": (found.range_m[0], self.range_m[0], 0.001),
            "range high": (found.range_m[1], self.range_m[1], 0.001),
        }
        if self.push_backs is not None:
            pairs["push-backs"] = (float(found.push_backs), float(self.push_backs), 1.0)
        return [
            f"{name} {got:.4g}, expected {want:.4g}"
            for name, (got, want, digit) in pairs.items()
            if want == want and not abs(got - want) <= max(0.1 * abs(want), digit) + 1e-9
        ]


def _over(
    speed: float, control: str, z: float | None, at: float, x: float, backs: int | None,
    pitch: float, rms: float, early: float = 0.0,
) -> Row:  # fmt: skip
    return Row(
        flight="over", speed_m_s=speed, control=control, z_over_R=z, arrives="yes", arrives_s=at,
        max_x_m=x, push_backs=backs, max_pitch_deg=pitch, rms_pitch_deg=rms, range_m=(7.0, 7.0),
        map_early_m=early,
    )  # fmt: skip


def _edge(
    speed: float, control: str, z: float | None, arrives: str, at: float, x: float,
    pitch: float, rms: float, low: float, high: float, early: float = 0.0, noisy: bool = False,
) -> Row:  # fmt: skip
    return Row(
        flight="edge", speed_m_s=speed, control=control, z_over_R=z, arrives=arrives, arrives_s=at,
        max_x_m=x, max_pitch_deg=pitch, rms_pitch_deg=rms, range_m=(low, high), map_early_m=early,
        noisy=noisy,
    )  # fmt: skip


TABLE: tuple[Row, ...] = (
    _over(0.2, "pid", None, 38.1, 7.04, 0, 1.5, 0.20),
    _over(0.2, "pid", 3.0, 38.6, 7.03, 2, 3.3, 0.49),
    Row(
        flight="over", speed_m_s=0.2, control="pid", z_over_R=2.0, arrives="never", arrives_s=nan,
        max_x_m=3.15, push_backs=41, max_pitch_deg=8.9, rms_pitch_deg=4.91, range_m=(2.731, 3.151),
    ),
    _over(0.2, "observer", 3.0, 38.1, 7.04, 0, 1.5, 0.22),
    _over(0.2, "observer", 2.0, 38.1, 7.04, 0, 1.5, 0.26),
    _over(0.2, "feedforward", 3.0, 38.1, 7.04, 0, 1.5, 0.20),
    _over(0.2, "feedforward", 2.0, 38.1, 7.04, 0, 1.5, 0.20),
    _over(1.0, "pid", None, 18.8, 7.46, 0, 5.6, 1.43),
    _over(1.0, "pid", 3.0, 18.8, 7.47, 0, 5.6, 1.47),
    _over(1.0, "pid", 2.0, 18.9, 7.51, 0, 5.8, 1.56),
    _over(1.0, "observer", 2.0, 18.7, 7.43, 0, 5.5, 1.42),
    _edge(0.2, "pid", None, "yes", 17.1, 2.84, 1.5, 0.23, 2.800, 2.800),
    _edge(0.2, "pid", 3.0, "yes", 23.1, 2.84, 1.7, 0.41, 2.797, 2.803),
    _edge(0.2, "pid", 2.0, "never", nan, 3.10, 11.3, 5.67, 2.324, 3.097),
    _edge(0.2, "observer", 2.0, "yes", 16.8, 2.83, 1.5, 0.22, 2.800, 2.800),
    _edge(0.2, "feedforward", 2.0, "yes", 17.1, 2.84, 1.5, 0.23, 2.800, 2.800),
    _edge(0.2, "feedforward", 2.0, "yes", 15.7, 2.87, 1.5, 0.22, 2.800, 2.800, 0.05),
    _edge(0.2, "feedforward", 2.0, "reported", 28.1, 3.13, 10.9, 1.22, 2.798, 2.802, 0.08),
    _edge(0.2, "feedforward", 2.0, "reported", nan, 3.16, 20.9, 4.03, 2.382, 3.129, 0.10),
    _edge(0.2, "feedforward", 2.0, "struck", nan, 3.20, 24.0, nan, nan, nan, 0.15),
    _edge(0.2, "feedforward", 2.0, "yes", 17.1, 2.83, 1.6, 0.27, 2.800, 2.800, -0.05),
    _edge(0.2, "feedforward", 2.0, "never", nan, 3.12, 9.4, 3.77, 2.455, 3.122, -0.15),
    _edge(1.0, "pid", 3.0, "never", nan, 3.37, 9.6, 6.07, 2.403, 3.197),
    _edge(1.0, "pid", 2.0, "never", nan, 3.30, 13.6, 7.56, 2.289, 3.204),
    _edge(1.0, "pid", 2.0, "never", nan, 3.30, 13.6, 7.56, 2.289, 3.204, noisy=True),
    _edge(1.0, "observer", 2.0, "yes", 11.6, 3.46, 6.2, 1.30, 2.800, 2.800),
    _edge(0.2, "observer", 2.0, "yes", 16.8, 2.83, 1.5, 0.22, 2.795, 2.805, noisy=True),
    _over(0.2, "feedforward", 2.0, 38.1, 7.04, 1, 4.6, 0.56, 0.05),
    _over(0.2, "feedforward", 2.0, 46.0, 7.04, None, 20.0, 2.23, 0.15),
)  # fmt: skip
"""Section 3.3 of the notes (corrected), gain set S3. In the last row independent programs differ:
it arrives in 44 to 48 s, after 6 to 8 push-backs."""
