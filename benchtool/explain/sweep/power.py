"""What pulses make of speeds along a sweep: the supply sags, and speed at a pulse with it.

Near the plate blades may take another torque, so that the motors turn otherwise at the same pulse:
what is left of the supply times that is the drive. Every level of the pulse has a speed of its own,
so that no map from pulse to speed is needed; what is held against a model is how speeds at one
level, and the voltage under load, change with time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array_type import Array
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig, Sensor

Mask = NDArray[np.bool_]

FIRST_VISITS = 2  # visits of a level that give its speed before the next one is predicted
CURVE_AT_S = 900.0  # at which a discharge's curvature counts in full; assumed


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SupplyModel:
    """Hold pulses, speeds and voltage of a sweep's points, motors running (m,) each."""

    time_s: Array  # since the run began
    pulse_us: Array  # mean over rotors
    level: NDArray[np.intp]  # number of the pulse level
    speed_rad_s: Array  # mean over rotors, its standard error `speed_se`
    speed_se: Array
    rotor_rad_s: Array  # (n, m) of each rotor that was read, with standard errors `rotor_se`
    rotor_se: Array
    load: Array  # over `full_load`; of current, or of the cube of speed where none was read
    full_load: float  # the greatest of this sweep, or of one that it is compared with
    by_current: bool  # whether load is that of current
    voltage_V: Array  # nan where it was not read; its standard error `voltage_se`
    voltage_se: float
    late: Mask  # rows that are to be predicted: all but the first visits of a level

    def planned(self, time_s: Array, pulse_us: Array, speed_rad_s: Array) -> SupplyModel:
        """Return what a sweep with other pulses would have, readings as good as here."""
        level = _levels(pulse_us)
        rotors = len(self.rotor_rad_s)
        full_load = float(np.max(speed_rad_s) ** 3)
        return SupplyModel(
            time_s=time_s,
            pulse_us=pulse_us,
            level=level,
            speed_rad_s=speed_rad_s,
            speed_se=np.full(len(time_s), float(np.median(self.speed_se))),
            rotor_rad_s=np.tile(speed_rad_s, (rotors, 1)),
            rotor_se=np.full((rotors, len(time_s)), float(np.median(self.rotor_se))),
            load=speed_rad_s**3 / full_load,
            full_load=full_load,
            by_current=False,
            voltage_V=np.full(len(time_s), float(np.nanmax(self.voltage_V)))
            if np.isfinite(self.voltage_V).any()
            else np.full(len(time_s), np.nan),
            voltage_se=self.voltage_se,
            late=_late(level),
        )

    def at_supply(self, supply: Array, drive: Array) -> SupplyModel:
        """Return speeds and voltage with so much of the supply left (m,), drives (n or 1, m)."""
        return replace(
            self,
            speed_rad_s=self.speed_rad_s * drive.mean(axis=0),
            rotor_rad_s=self.rotor_rad_s * drive,
            voltage_V=self.voltage_V * supply,
        )

    def loaded_as(self, other: SupplyModel) -> SupplyModel:
        """Return it with load counted as in another sweep, so that one drop holds for both."""
        if self.by_current != other.by_current:
            return self
        load = self.load * self.full_load / other.full_load
        return replace(self, load=load, full_load=other.full_load)

    def supply(self, rate_per_s: Array, curve: Array, drop: Array) -> Array:
        """Return supply voltage over its open value at the start (m, n_sets), for sets (n_sets,).

        Args:
            curve: how much faster it goes after `CURVE_AT_S` than on average.
            drop: share lost at full load.
        """
        time = self.time_s[:, None]
        loss = rate_per_s * time * (1.0 + curve * (time / CURVE_AT_S - 1.0))
        return np.asarray(1.0 - loss - drop * self.load[:, None], float)

    def speeds(self, drive: Array) -> Array:
        """Return speeds (m, n_sets), for drives (n or 1, m, n_sets), each level's scale fitted."""
        mean: Array = drive.mean(axis=0)
        out = np.empty_like(mean)
        for level in np.unique(self.level):
            rows = self.level == level
            weights = 1.0 / self.speed_se[rows] ** 2
            shape = mean[rows]
            out[rows] = ((weights * self.speed_rad_s[rows]) @ shape) / (weights @ shape**2) * shape
        return out

    @property
    def n_rows(self) -> int:
        """How many speeds and voltages there are."""
        return len(self.time_s) + int(np.isfinite(self.voltage_V).sum())

    def white_changes(self, changes: Array) -> Array:
        """Return changes of speeds and voltages (n_rows, r) over their errors.

        Without what each level's own scale, and the open voltage, take up.
        """
        out, m = changes.copy(), len(self.time_s)
        for level in np.unique(self.level):
            rows = np.flatnonzero(self.level == level)
            shape = self.speed_rad_s[rows]
            weights = shape / self.speed_se[rows] ** 2
            out[rows] -= shape[:, None] * ((weights @ changes[rows]) / (weights @ shape))
        out[:m] /= self.speed_se[:, None]
        shape = self.voltage_V[np.isfinite(self.voltage_V)]
        if len(shape):
            out[m:] -= shape[:, None] * (shape @ changes[m:]) / (shape @ shape)
            out[m:] /= self.voltage_se
        return out

    def predicted(self, drive: Array, read: Array) -> Array:
        """Return what each visit is predicted to show from the earlier ones of its level.

        Args:
            drive: (n or 1, m, n_sets) speed over that at full supply far from the plate.
            read: (n, m, n_sets) speeds of each rotor, or errors in them: prediction is linear.

        Returns:
            (n, m, n_sets) in the unit of `read`; 0 for the first visits, which nothing predicts.
        """
        out = np.zeros(np.broadcast_shapes(read.shape, drive.shape))
        weights = 1.0 / self.rotor_se[:, :, None] ** 2
        for level in np.unique(self.level):
            rows = np.flatnonzero(self.level == level)
            shape, weight = drive[:, rows], weights[:, rows]
            shown = np.cumsum(weight * shape * read[:, rows], axis=1)
            known = np.cumsum(weight * shape**2, axis=1)
            out[:, rows[1:]] = shape[:, 1:] * shown[:, :-1] / known[:, :-1]
        out[:, ~self.late] = 0.0
        return out

    def voltages(self, supply: Array) -> Array:
        """Return voltages (m, n_sets) with the open one fitted."""
        known = np.isfinite(self.voltage_V)
        shape = supply[known]
        scale = (self.voltage_V[known] @ shape) / np.sum(shape**2, axis=0)
        return np.asarray(scale * supply, float)


def reconstruct_supply(recording: Recording, rig: Rig) -> SupplyModel | None:
    """Return pulses against speeds; None where one of them, or the time, is missing."""
    n = rig.n_rotors
    speeds, errors = _rows(recording, "rpm{}", n), _rows(recording, "rpm{}_se", n)
    pulses = _rows(recording, "pwm{}_us", n)
    if not len(speeds) or not len(pulses) or "time_s" not in recording:
        return None
    speed = speeds.mean(axis=0)
    pulse = pulses.mean(axis=0)
    level = _levels(pulse)
    late = _late(level)
    time = recording.to_si("time_s")
    if not np.isfinite(speed).all() or not np.isfinite(pulses).all() or not late.any():
        return None
    stated = np.sqrt(np.sum(errors**2, axis=0)) / n if len(errors) else np.zeros(len(time))
    sensor = rig.sensors.get("rpm", Sensor())
    least = np.pi / 30.0 * max(sensor.quantum / np.sqrt(12.0), 0.01)
    each = errors if errors.shape == speeds.shape else np.zeros_like(speeds)
    voltage = _column(recording, "voltage_V")
    current = _column(recording, "current_A")
    by_current = bool(np.isfinite(current).all() and np.ptp(current) > 0.0)
    load = current if by_current else speed**3
    volts = rig.sensors.get("voltage_V", Sensor())
    samples = np.nanmedian(recording.column("n_samples")) if "n_samples" in recording else 1.0
    return SupplyModel(
        time_s=time,
        pulse_us=pulse,
        level=level,
        speed_rad_s=speed,
        speed_se=np.hypot(np.nan_to_num(stated), least / np.sqrt(n)),
        rotor_rad_s=speeds,
        rotor_se=np.hypot(np.nan_to_num(each), least),
        load=load / load.max(),
        full_load=float(load.max()),
        by_current=by_current,
        voltage_V=voltage,
        voltage_se=float(
            max(np.hypot(volts.noise / np.sqrt(samples), volts.quantum / np.sqrt(12.0)), 1e-3)
        ),
        late=late,
    )


def _levels(pulse_us: Array) -> NDArray[np.intp]:
    """Return the number of each row's pulse level; pulses a tenth of a us apart are one."""
    numbers: NDArray[np.intp] = np.unique(np.round(pulse_us, 1), return_inverse=True)[1]
    return numbers.reshape(-1)


def _late(level: NDArray[np.intp]) -> Mask:
    """Return the rows (m,) after the first visits of their level."""
    late = np.ones(len(level), bool)
    for number in np.unique(level):
        late[np.flatnonzero(level == number)[:FIRST_VISITS]] = False
    return late


def _rows(recording: Recording, pattern: str, n: int) -> Array:
    """Return a channel of every rotor (n, m), the first one's (1, m), or none (0,)."""
    names = [pattern.format(i + 1) for i in range(n)]
    if any(name not in recording for name in names):
        names = [name for name in names[:1] if name in recording]
    return np.array([recording.to_si(name) for name in names])


def _column(recording: Recording, name: str) -> Array:
    return recording.to_si(name) if name in recording else np.full(len(recording), np.nan)
