"""What a pitch simulation gives: columns, a recording, the numbers of the plate's visit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.channel import Channel
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig
from benchtool.core.schedule import PARKED_M

COLUMNS = {  # first columns of a log, with the records' fields that they show
    "reference_rad": "setpoint.reference_rad",
    "theta_rad": "readings.theta_rad",
    "gyro_rad_s": "readings.gyro_rad_s",
    "plate_z_m": "setpoint.plate_z_m",
    "plate_read_m": "readings.plate_z_m",
    "plate_share": "setpoint.plate_share",
    "torque_Nm": "command.torque_Nm",
    "estimate_Nm": "law_state.estimate_Nm",
    "true_theta_rad": "hinge.theta_rad",
    "true_rate_rad_s": "hinge.rate_rad_s",
}

LOGGED = (*COLUMNS.values(), "command.pwm_us", "readings.speed_rad_s")  # fields of a run's log


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PitchRun:
    """Hold one simulated run.

    Attributes:
        rate_Hz: control rate; one row per control tick.
        log: (n_ticks, 10 + 2 n_discs): `COLUMNS`, pulses, measured rotor speeds (rad/s).
        clamped_steps: plant steps with a disc nearer than the formulae hold.
    """

    controller: str
    rate_Hz: float
    log: Array
    clamped_steps: int = 0
    stopped_steps: int = 0

    @property
    def time_s(self) -> Array:
        """Time since the run began (n_ticks,)."""
        return np.arange(len(self.log)) / self.rate_Hz

    @property
    def n_discs(self) -> int:
        """How many discs the log holds."""
        return int(self.log.shape[1] - len(COLUMNS)) // 2

    def column(self, name: str) -> Array:
        """Return one of `COLUMNS` (n_ticks,)."""
        return self.log[:, [*COLUMNS].index(name)]

    @property
    def pwm_us(self) -> Array:
        """Pulse width of each disc (n_discs, n_ticks)."""
        return self.log[:, len(COLUMNS) : len(COLUMNS) + self.n_discs].T

    @property
    def speed_rad_s(self) -> Array:
        """Rotor speed of each disc as read (n_discs, n_ticks)."""
        return self.log[:, len(COLUMNS) + self.n_discs :].T

    def recording(self, rig: Rig, provenance: Mapping[str, str] | None = None) -> Recording:
        """Return the run in the recording format: what a pitch bench would have logged."""
        pairs = [
            (Channel("time_s", "s"), self.time_s),
            (Channel("theta_ref_rad", "rad"), self.column("reference_rad")),
            (Channel("theta_rad", "rad"), self.column("theta_rad")),
            (Channel("gyro_rad_s", "rad/s"), self.column("gyro_rad_s")),
        ]
        discs = rig.disc_of_rotor
        pwm, rpm = self.pwm_us, self.speed_rad_s * 30.0 / np.pi
        pairs += [(Channel(f"pwm{k + 1}_us", "pwm_us"), pwm[disc]) for k, disc in enumerate(discs)]
        pairs += [(Channel(f"rpm{k + 1}", "rpm"), rpm[disc]) for k, disc in enumerate(discs)]
        shown = np.where(self.column("plate_share") > 0.0, self.column("plate_read_m"), PARKED_M)
        pairs += [
            (Channel("plate_z_m", "m"), shown),
            (Channel("coverage1", "1"), self.column("plate_share")),
            (Channel("torque_Nm", "N m"), self.column("torque_Nm")),
            (Channel("disturbance_Nm", "N m"), self.column("estimate_Nm")),
        ]
        return Recording.from_columns(pairs, provenance, simulated=True)


@dataclass(frozen=True, slots=True)
class PlateNumbers:
    """Sum up what a visit of the plate did to the attitude; angles in rad, errors are true ones.

    Attributes:
        quiet_rms_rad: before the plate comes.
        peak_rad: largest error while it is there, with its sign.
        settling_s: from its coming until the error stays within 20 % of the peak about its last
            value; nan where the peak does not stand out of the quiet noise.
        residual_rad: mean error over the last quarter of the visit.
        rebound_rad: largest error of the opposite sign after it left, else 0.
    """

    quiet_rms_rad: float
    peak_rad: float
    settling_s: float
    residual_rad: float
    rebound_rad: float


BAND = 0.2  # settling band as a share of the peak
QUIET_FACTOR = 5.0  # a peak below this many quiet standard deviations is noise; assumed


def plate_numbers(run: PitchRun, in_s: float, out_s: float, move_s: float) -> PlateNumbers:
    """Return the numbers of a visit that begins at `in_s` and ends at `out_s`."""
    t = run.time_s
    error = run.column("true_theta_rad") - run.column("reference_rad")
    before = (t < in_s) & (t >= 0.4 * in_s)
    during = (t >= in_s) & (t < out_s)
    late = (t >= in_s + 0.75 * (out_s - in_s)) & (t < out_s)
    after = t >= out_s
    quiet = float(np.sqrt(np.mean(error[before] ** 2))) if before.any() else float("nan")
    if not during.any():
        nan = float("nan")
        return PlateNumbers(quiet, nan, nan, nan, nan)
    visit, times = error[during], t[during] - in_s
    peak = float(visit[np.argmax(np.abs(visit))])
    residual = float(np.mean(error[late]))
    outside = np.abs(visit - residual) > BAND * abs(peak)
    settled = float(times[np.flatnonzero(outside)[-1]]) if outside.any() else 0.0
    if abs(peak) < QUIET_FACTOR * quiet:
        settled = float("nan")
    back = error[after] * -np.sign(peak) if after.any() else np.zeros(1)
    rebound = float(max(back.max(), 0.0)) * -float(np.sign(peak))
    return PlateNumbers(quiet, peak, settled, residual, rebound)
