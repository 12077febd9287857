"""What the owner of the pitch bench knows: the numbers of its `bench.json`, in that file's keys."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """Hold a bench's data sheet. The field names are those of the file.

    Attributes:
        J: inertia about the hinge, kg m2.
        L: arm, hinge to rotor, m.
        R: rotor radius, m.
        kT: thrust over speed squared, N/rpm2.
        rpm_per_us: speed gained per microsecond of pulse above pwm0.
        pwm0: pulse at which a rotor starts, us.
        tau_m: first-order lag of a rotor, s.
        base_pwm: pulse about which the controller works, us.
        ge_rho: coefficient of (R/4h)^2 in the covered rotor's ground effect.
        b_body: half diagonal for the body-lift term, m.
        m: mass, kg.
        g: gravity, m/s2.
        kp: us/rad.
        ki: us/(rad s).
        kd: us/(rad/s).
        dt: sample time, s.
        sd_theta: encoder noise, rad.
        q_theta: encoder quantum, rad.
        sd_gyro: gyro noise, rad/s.
        q_gyro: gyro quantum, rad/s.
        sd_rpm: rotor speed noise, rpm.
        q_rpm: rotor speed quantum, rpm.
        sd_z: noise of the plate's distance, m.
        sd_process: standard deviation of the wake torque, N m.
        tau_process: correlation time of the wake torque, s.
    """

    J: float = 0.03
    L: float = 0.25
    R: float = 0.127
    kT: float = 1.1e-7
    rpm_per_us: float = 12.0
    pwm0: float = 1000.0
    tau_m: float = 0.02
    base_pwm: float = 1500.0
    ge_rho: float = 1.0
    b_body: float = 0.3
    m: float = 1.2
    g: float = 9.81
    kp: float = 350.0
    ki: float = 350.0
    kd: float = 65.0
    dt: float = 0.004
    sd_theta: float = math.radians(0.02)
    q_theta: float = 2.0 * math.pi / 16384
    sd_gyro: float = math.radians(0.1)
    q_gyro: float = math.radians(0.061)
    sd_rpm: float = 15.0
    q_rpm: float = 10.0
    sd_z: float = 0.001
    sd_process: float = 0.004
    tau_process: float = 0.1

    def keys(self) -> dict[str, float]:
        """Return the sheet as the file holds it."""
        return asdict(self)


SHEET = Sheet()

PULSE_LIMITS_US = (1100.0, 1950.0)
INTEGRAL_LIMIT_RAD_S = 0.5
PARKED_M = 1.0
