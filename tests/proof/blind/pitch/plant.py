"""The true numbers of one bench: what the physics runs on and the owner does not know."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal

from tests.proof.blind.pitch.sheet import SHEET

FrictionLaw = Literal["constraint", "smooth"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Plant:
    """Hold the truth about a bench. As it stands here it is the data sheet's ideal bench.

    Attributes:
        friction_law: `constraint` is MuJoCo's own dry friction, which holds at rest up to a creep
            below 1e-3 rad/s; `smooth` is friction_Nm tanh(rate / friction_width_rad_s).
        rpm_per_us: pulse-to-speed gains of rotors 1 and 2.
        thrust_exponent: thrust goes with speed to this power, equal to kT rpm^2 at 6000 rpm.
        coverage_share: share of the covered rotor's thrust increment that is really there.
        bristle_coulomb_Nm: friction in motion of a bristle (LuGre) hinge; 0: no such hinge.
        thrust_lean: relative thrust gained by a rotor that speeds up, and lost by one that slows.
    """

    inertia_kgm2: float = SHEET.J  # about the hinge, everything that moves
    friction_Nm: float = 0.0  # Coulomb friction of the hinge
    friction_law: FrictionLaw = "constraint"
    friction_width_rad_s: float = 0.01  # width of the smooth law
    damping_Nms: float = 0.0  # viscous friction of the hinge
    stiffness_Nm_per_rad: float = 0.0  # spring at the hinge, at rest with the beam level
    cog_x_m: float = 0.0  # centre of gravity from the hinge towards rotor 1
    cog_below_m: float = 0.0  # centre of gravity below the hinge
    tau_s: float = SHEET.tau_m  # lag of a rotor that slows down
    tau_rise_ratio: float = 1.0  # lag of a rotor that speeds up over tau_s
    delay_s: float = 0.0  # time from the logged pulse to the rotor's drive
    rpm_per_us: tuple[float, float] = (SHEET.rpm_per_us, SHEET.rpm_per_us)
    sag_per_s: float = 0.0  # linear loss of these gains with time
    thrust_ratio: float = 1.0  # thrust of rotor 2 over rotor 1 at one speed
    thrust_exponent: float = 2.0
    ge_rho: float = SHEET.ge_rho  # coefficient of the image rotor
    K_b: float = 0.0  # body lift
    coverage_share: float = 1.0
    plate_dz_m: float = 0.0  # true minus read plate distance
    aero_damping: float = 0.0  # relative thrust lost per climb speed in units of the tip speed
    gyro_bias_rad_s: float = 0.0  # added to the gyro
    gyro_scale: float = 1.0  # reading over true rate
    encoder_wobble_rad: float = 0.0  # once-per-turn error of the encoder
    encoder_phase_rad: float = 0.0  # phase of that error
    wake_sd_Nm: float = SHEET.sd_process  # standard deviation of the wake torque
    wake_tau_s: float = SHEET.tau_process  # its correlation time
    bristle_coulomb_Nm: float = 0.0
    bristle_static_Nm: float = 0.0  # friction that such a hinge reaches before it breaks loose
    bristle_rate_rad_s: float = 0.05  # Stribeck rate at which the excess is down to 1/e
    bristle_angle_rad: float = 0.01  # angle over which it gives way before it breaks loose
    flex_Nm_per_rad: float = 0.0  # stiffness between hub and arms; 0: rigid
    flex_damping_Nms: float = 0.0  # damping between hub and arms
    flex_hub_share: float = 0.5  # share of the inertia that stays with the hub
    encoder_play_rad: float = 0.0  # half the play between hub and encoder
    esc_step_us: float = 0.0  # the ESC answers only to multiples of this pulse; 0: to all
    thrust_lean: float = 0.0
    thrust_lean_rpm_per_s: float = 3000.0  # rate of speed change at which tanh of it is 0.76
    load_shift_Nm: float = 0.0  # weight torque of a load that creeps from one place to another
    load_time_s: float = 15.0  # time at which it is half way
    load_width_s: float = 5.0  # time that it needs
    bumper_Nm_per_rad: float = 0.0  # stiffness of rubber that the beam meets at an angle
    bumper_rad: float = 0.15  # that angle, rotor 1 up
    vane_Nms2: float = 0.0  # torque against the rate, over its square
    fade: float = 0.0  # share of its thrust that rotor 1 loses as it warms up
    fade_s: float = 8.0  # time in which it is down to 1/e of the rest
    flutter: float = 0.0  # relative thrust gained in the middle of a band of speeds
    flutter_rpm: float = 6000.0  # that middle
    flutter_width_rpm: float = 250.0  # half of the band's width at half of the gain
    near_gain: float = 0.0  # gain of the covered rotor's thrust at the plate, beside the images
    near_length: float = 0.5  # distance over R in which it is down to 1/e

    @property
    def flexible(self) -> bool:
        """Whether the arms give against the hub."""
        return self.flex_Nm_per_rad > 0.0

    def departures(self) -> dict[str, object]:
        """Return every number that is not the ideal bench's."""
        ideal = asdict(Plant())
        return {name: value for name, value in asdict(self).items() if value != ideal[name]}
