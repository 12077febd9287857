"""The true bench: every number that makes its readings."""

from __future__ import annotations

from dataclasses import dataclass, fields

from tests.proof.blind.sweep.layouts import Layout

Numbers = tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Bench:
    """Hold the truth of a bench; every default is what the data sheet says.

    Attributes:
        softness, near: of the ground law (`ground.py`).
        neighbours: strength of the neighbours' images; 1 on a quadrotor as the sheet has it.
        coverage_power: of the covered fraction, for the increment at quarters of the disc.
        gain_of_rotor: pulse-to-speed gain of each rotor over the sheet's; empty: all equal.
    """

    layout: Layout  # the data sheet
    k_ratio: float = 1.0  # thrust coefficient over the sheet's
    k_of_rotor: Numbers = ()  # of each rotor over that; empty: all equal
    radius_ratio: float = 1.0  # effective over geometric rotor radius
    softness: float = 1.0
    near: float = 0.0
    neighbours: float = 1.0
    K_b: float = 0.0  # body lift
    exponent_excess: float = 0.0  # thrust goes as speed^(2 + excess)
    blockage: float = 0.0  # share of thrust that the stand takes with no plate near
    coverage_power: float = 1.0
    plate_dz_m: float = 0.0  # true minus read distance
    plate_tilt_rad: float = 0.0  # positive brings +x rotors nearer; about the plate's own centre
    plate_x0_m: float = 0.0  # true minus read lateral position
    plate_scatter_m: float = 0.0  # sd of the distance from visit to visit
    stage_play_m: float = 0.0  # backlash of the distance
    gain_of_rotor: Numbers = ()
    pwm_start_off_us: float = 0.0  # true minus stated start of the speed line
    full_V: float = 12.2  # open-circuit voltage at the start
    resistance_ohm: float = 0.012  # of the supply
    sag_per_s: float = 0.0  # linear loss of the open-circuit voltage, and with it of the gain
    sag_curve: float = 0.0  # how much faster at the end of a quarter of an hour
    tare_N: float = 0.0  # what a tare leaves on the reading
    drift_N_per_s: float = 0.0  # creep of the zero since a tare
    hysteresis_N: float = 0.0  # half width of the load cell's play at hover
    hysteresis_slope: float = 0.0  # how much wider at twice hover
    bow_N: float = 0.0  # bow of the cell's characteristic at half its rating
    saturation_N: float = 0.0  # reading that the amplifier cannot pass; 0: none
    density_loss_per_s: float = 0.0  # relative fall of the air's density
    noise_ratio: float = 1.0  # true over usual standard error
    room_loss: float = 0.0  # share of thrust lost to air that comes round again
    room_s: float = 30.0  # time in which it does
    flutter_rad_s: float = 0.0  # speed above which the blades flutter; 0: never
    flutter_jump: float = 0.0  # relative change of thrust there
    creep_share: float = 0.0  # of a load that the cell's reading gains late
    creep_s: float = 60.0  # time in which it does
    shaking_rad_s: float = 0.0  # speed at which the stand resonates; 0: nowhere
    shaking_share: float = 0.0  # of thrust that the reading loses there
    shaking_damping: float = 0.06  # of the stand, over the critical one
    warm_loss: float = 0.0  # share of the thrust coefficient that warm blades and motors lose
    warm_s: float = 90.0  # time in which they warm up and cool down
    plate_yield_m: float = 0.0  # by which the wash at hover bends the nearest plate away

    def departures(self) -> dict[str, object]:
        """Return every number that is not the data sheet's."""
        sheet = Bench(layout=self.layout)
        return {
            item.name: getattr(self, item.name)
            for item in fields(self)
            if getattr(self, item.name) != getattr(sheet, item.name)
        }
