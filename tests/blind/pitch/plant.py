"""The true numbers of one bench: what the physics runs on and the owner does not know."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal

from tests.blind.pitch.sheet import SHEET

FrictionLaw = Literal["constraint", "smooth"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Plant:
    """Hold the truth about a bench. As it stands here it is the data sheet's ideal bench.

    Attributes:
        inertia_kgm2: about the hinge, everything that moves.
        friction_Nm: Coulomb friction of the hinge.
        friction_law: `constraint` is MuJoCo's own dry friction, which holds at rest up to a creep
            below 1e-3 rad/s; `smooth` is friction_Nm tanh(rate / friction_width_rad_s).
        friction_width_rad_s: width of the smooth law.
        damping_Nms: viscous friction of the hinge.
        stiffness_Nm_per_rad: spring at the hinge, at rest with the beam level.
        cog_x_m: centre of gravity from the hinge towards rotor 1.
        cog_below_m: centre of gravity below the hinge.
        tau_s: lag of a rotor that slows down.
        tau_rise_ratio: lag of a rotor that speeds up over tau_s.
        delay_s: time from the logged pulse to the rotor's drive.
        rpm_per_us: pulse-to-speed gains of rotors 1 and 2.
        sag_per_s: linear loss of these gains with time.
        thrust_ratio: thrust of rotor 2 over rotor 1 at one speed.
        thrust_exponent: thrust goes with speed to this power, equal to kT rpm^2 at 6000 rpm.
        ge_rho: coefficient of the image rotor.
        K_b: body lift.
        coverage_share: share of the covered rotor's thrust increment that is really there.
        plate_dz_m: true minus read plate distance.
        aero_damping: relative thrust lost per climb speed in units of the tip speed.
        gyro_bias_rad_s: added to the gyro.
        gyro_scale: reading over true rate.
        encoder_wobble_rad: once-per-turn error of the encoder.
        encoder_phase_rad: phase of that error.
        wake_sd_Nm: standard deviation of the wake torque.
        wake_tau_s: its correlation time.
        bristle_coulomb_Nm: friction in motion of a bristle (LuGre) hinge; 0: no such hinge.
        bristle_static_Nm: friction that such a hinge reaches before it breaks loose.
        bristle_rate_rad_s: Stribeck rate at which the excess is down to 1/e.
        bristle_angle_rad: angle over which it gives way before it breaks loose.
        flex_Nm_per_rad: stiffness between hub and arms; 0: rigid.
        flex_damping_Nms: damping between hub and arms.
        flex_hub_share: share of the inertia that stays with the hub.
        encoder_play_rad: half the play between hub and encoder.
        esc_step_us: the ESC answers only to multiples of this pulse; 0: to all.
        thrust_lean: relative thrust gained by a rotor that speeds up, and lost by one that slows.
        thrust_lean_rpm_per_s: rate of speed change at which tanh of it is 0.76.
        load_shift_Nm: weight torque of a load that creeps from one place to another.
        load_time_s: time at which it is half way.
        load_width_s: time that it needs.
    """

    inertia_kgm2: float = SHEET.J
    friction_Nm: float = 0.0
    friction_law: FrictionLaw = "constraint"
    friction_width_rad_s: float = 0.01
    damping_Nms: float = 0.0
    stiffness_Nm_per_rad: float = 0.0
    cog_x_m: float = 0.0
    cog_below_m: float = 0.0
    tau_s: float = SHEET.tau_m
    tau_rise_ratio: float = 1.0
    delay_s: float = 0.0
    rpm_per_us: tuple[float, float] = (SHEET.rpm_per_us, SHEET.rpm_per_us)
    sag_per_s: float = 0.0
    thrust_ratio: float = 1.0
    thrust_exponent: float = 2.0
    ge_rho: float = SHEET.ge_rho
    K_b: float = 0.0
    coverage_share: float = 1.0
    plate_dz_m: float = 0.0
    aero_damping: float = 0.0
    gyro_bias_rad_s: float = 0.0
    gyro_scale: float = 1.0
    encoder_wobble_rad: float = 0.0
    encoder_phase_rad: float = 0.0
    wake_sd_Nm: float = SHEET.sd_process
    wake_tau_s: float = SHEET.tau_process
    bristle_coulomb_Nm: float = 0.0
    bristle_static_Nm: float = 0.0
    bristle_rate_rad_s: float = 0.05
    bristle_angle_rad: float = 0.01
    flex_Nm_per_rad: float = 0.0
    flex_damping_Nms: float = 0.0
    flex_hub_share: float = 0.5
    encoder_play_rad: float = 0.0
    esc_step_us: float = 0.0
    thrust_lean: float = 0.0
    thrust_lean_rpm_per_s: float = 3000.0
    load_shift_Nm: float = 0.0
    load_time_s: float = 15.0
    load_width_s: float = 5.0

    @property
    def flexible(self) -> bool:
        """Whether the arms give against the hub."""
        return self.flex_Nm_per_rad > 0.0

    def departures(self) -> dict[str, object]:
        """Return every number that is not the ideal bench's."""
        ideal = asdict(Plant())
        return {name: value for name, value in asdict(self).items() if value != ideal[name]}
