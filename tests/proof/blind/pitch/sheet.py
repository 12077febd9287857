"""What the owner of the pitch bench knows: the numbers of its `bench.json`, in that file's keys."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """Hold a bench's data sheet. The field names are those of the file."""

    J: float = 0.03  # inertia about the hinge, kg m2
    L: float = 0.25  # arm, hinge to rotor, m
    R: float = 0.127  # rotor radius, m
    kT: float = 1.1e-7  # thrust over speed squared, N/rpm2
    rpm_per_us: float = 12.0  # speed gained per microsecond of pulse above pwm0
    pwm0: float = 1000.0  # pulse at which a rotor starts, us
    tau_m: float = 0.02  # first-order lag of a rotor, s
    base_pwm: float = 1500.0  # pulse about which the controller works, us
    ge_rho: float = 1.0  # coefficient of (R/4h)^2 in the covered rotor's ground effect
    b_body: float = 0.3  # half diagonal for the body-lift term, m
    m: float = 1.2  # mass, kg
    g: float = 9.81  # gravity, m/s2
    kp: float = 350.0  # us/rad
    ki: float = 350.0  # us/(rad s)
    kd: float = 65.0  # us/(rad/s)
    dt: float = 0.004  # sample time, s
    sd_theta: float = math.radians(0.02)  # encoder noise, rad
    q_theta: float = 2.0 * math.pi / 16384  # encoder quantum, rad
    sd_gyro: float = math.radians(0.1)  # gyro noise, rad/s
    q_gyro: float = math.radians(0.061)  # gyro quantum, rad/s
    sd_rpm: float = 15.0  # rotor speed noise, rpm
    q_rpm: float = 10.0  # rotor speed quantum, rpm
    sd_z: float = 0.001  # noise of the plate's distance, m
    sd_process: float = 0.004  # standard deviation of the wake torque, N m
    tau_process: float = 0.1  # correlation time of the wake torque, s

    def keys(self) -> dict[str, float]:
        """Return the sheet as the file holds it."""
        return asdict(self)


SHEET = Sheet()

PULSE_LIMITS_US = (1100.0, 1950.0)
INTEGRAL_LIMIT_RAD_S = 0.5
PARKED_M = 1.0
