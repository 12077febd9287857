"""Supply model of a sweep: changes of speed at a pulse and of voltage under load.

Drive is the relative supply voltage times the relative speed near the plate, where blade torque
differs. Each pulse level has a fitted speed scale, so no map from pulse to speed is needed; only
changes of speed within a level and of voltage are compared with a model.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchtool.core.recording import Recording
from benchtool.core.rig import Rig, Sensor
from benchtool.core.units import Array

Mask = NDArray[np.bool_]

FIRST_VISITS = 2  # of a level, before its speed can be predicted
CURVE_AT_S = 900.0  # reference time of the curvature of a discharge; assumed


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SupplyModel:
    """Pulses, speeds and voltage of a sweep's points with running motors, (m,) each."""

    time_s: Array  # since the start of the run
    pulse_us: Array  # mean over rotors
    level: NDArray[np.intp]  # index of the pulse level
    speed_rad_s: Array  # mean over rotors; standard error: `speed_se`
    speed_se: Array
    rotor_rad_s: Array  # (n, m) of measured rotors; standard error: `rotor_se`
    rotor_se: Array
    load: Array  # over `full_load`; current, or cube of speed if not measured
    full_load: float  # maximum of this sweep or of a reference sweep
    by_current: bool  # load is current
    voltage_V: Array  # nan if not measured; standard error: `voltage_se`
    voltage_se: float
    is_predicted: Mask  # predicted rows: all but the first visits of a level

    def planned(self, time_s: Array, pulse_us: Array, speed_rad_s: Array) -> SupplyModel:
        """Return the model of a planned sweep with the same measurement errors."""
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
            voltage_V=np.full(len(time_s), np.fmax.reduce(self.voltage_V)),
            voltage_se=self.voltage_se,
            is_predicted=_find_predictable(level),
        )

    def at_supply(self, supply: Array, drive: Array) -> SupplyModel:
        """Return the model at a relative supply (m,) and relative speeds (n or 1, m)."""
        return replace(
            self,
            speed_rad_s=self.speed_rad_s * drive.mean(axis=0),
            rotor_rad_s=self.rotor_rad_s * drive,
            voltage_V=self.voltage_V * supply,
        )

    def loaded_as(self, other: SupplyModel) -> SupplyModel:
        """Return the model with the full load of another sweep, so that one drop fits both."""
        if self.by_current != other.by_current:
            return self
        load = self.load * self.full_load / other.full_load
        return replace(self, load=load, full_load=other.full_load)

    def supply(self, rate_per_s: Array, curve: Array, drop: Array) -> Array:
        """Return supply over its initial open-circuit voltage (m, n_sets), for sets (n_sets,).

        Args:
            curve: relative increase of the rate at `CURVE_AT_S`.
            drop: relative drop at full load.
        """
        time = self.time_s[:, None]
        loss = rate_per_s * time * (1.0 + curve * (time / CURVE_AT_S - 1.0))
        return np.asarray(1.0 - loss - drop * self.load[:, None], float)

    def speeds(self, drive: Array) -> Array:
        """Return speeds (m, n_sets) for relative speeds (n or 1, m, n_sets), scaled by level."""
        mean_drive: Array = drive.mean(axis=0)
        fitted = np.empty_like(mean_drive)
        for level in np.unique(self.level):
            rows = self.level == level
            w = 1.0 / self.speed_se[rows] ** 2
            shape = mean_drive[rows]
            fitted[rows] = ((w * self.speed_rad_s[rows]) @ shape) / (w @ shape**2) * shape
        return fitted

    @property
    def n_rows(self) -> int:
        """Number of speeds and voltages."""
        return len(self.time_s) + int(np.isfinite(self.voltage_V).sum())

    def whiten_changes(self, changes: Array) -> Array:
        """Return changes of speeds and voltages (n_rows, r) divided by their standard errors.

        The fitted scales of levels and the fitted open-circuit voltage are projected out.
        """
        whitened, m = changes.copy(), len(self.time_s)
        for level in np.unique(self.level):
            rows = np.flatnonzero(self.level == level)
            shape = self.speed_rad_s[rows]
            weights = shape / self.speed_se[rows] ** 2
            whitened[rows] -= shape[:, None] * ((weights @ changes[rows]) / (weights @ shape))
        whitened[:m] /= self.speed_se[:, None]
        shape = self.voltage_V[np.isfinite(self.voltage_V)]
        if len(shape):
            whitened[m:] -= shape[:, None] * (shape @ changes[m:]) / (shape @ shape)
            whitened[m:] /= self.voltage_se
        return whitened

    def predicted(self, drive: Array, readings: Array) -> Array:
        """Return predictions of each visit from the earlier ones of its level.

        Args:
            drive: (n or 1, m, n_sets) speed over that at full supply out of ground effect.
            readings: (n, m, n_sets) speeds of each rotor, or their errors (linear prediction).

        Returns:
            (n, m, n_sets) in the unit of `readings`; 0 for the first visits.
        """
        predictions = np.zeros(np.broadcast_shapes(readings.shape, drive.shape))
        weights = 1.0 / self.rotor_se[:, :, None] ** 2
        for level in np.unique(self.level):
            rows = np.flatnonzero(self.level == level)
            shape, weight = drive[:, rows], weights[:, rows]
            weighted_sum = np.cumsum(weight * shape * readings[:, rows], axis=1)
            total_weight = np.cumsum(weight * shape**2, axis=1)
            predictions[:, rows[1:]] = shape[:, 1:] * weighted_sum[:, :-1] / total_weight[:, :-1]
        predictions[:, ~self.is_predicted] = 0.0
        return predictions

    def voltages(self, supply: Array) -> Array:
        """Return voltages (m, n_sets) with fitted open-circuit voltage."""
        has_voltage = np.isfinite(self.voltage_V)
        shape = supply[has_voltage]
        scale = (self.voltage_V[has_voltage] @ shape) / np.sum(shape**2, axis=0)
        return np.asarray(scale * supply, float)


def reconstruct_supply(recording: Recording, rig: Rig) -> SupplyModel | None:
    """Return the supply model; None if pulses, speeds or time are missing."""
    n = rig.n_rotors
    speeds, errors = _rows(recording, "rpm{}", n), _rows(recording, "rpm{}_se", n)
    pulses = _rows(recording, "pwm{}_us", n)
    if not len(speeds) or not len(pulses) or "time_s" not in recording:
        return None
    speed = speeds.mean(axis=0)
    pulse = pulses.mean(axis=0)
    level = _levels(pulse)
    is_predicted = _find_predictable(level)
    time_s = recording.to_si("time_s")
    if not np.isfinite(speed).all() or not np.isfinite(pulses).all() or not is_predicted.any():
        return None
    mean_se = np.sqrt(np.sum(errors**2, axis=0)) / n if len(errors) else np.zeros(len(time_s))
    sensor = rig.sensors.get("rpm", Sensor())
    min_se = np.pi / 30.0 * max(sensor.quantum / np.sqrt(12.0), 0.01)
    rotor_se = errors if errors.shape == speeds.shape else np.zeros_like(speeds)
    voltage = _column(recording, "voltage_V")
    current = _column(recording, "current_A")
    by_current = bool(np.isfinite(current).all() and np.ptp(current) > 0.0)
    load = current if by_current else speed**3
    voltmeter = rig.sensors.get("voltage_V", Sensor())
    samples = np.nanmedian(recording.column("n_samples")) if "n_samples" in recording else 1.0
    voltage_se = np.hypot(voltmeter.noise / np.sqrt(samples), voltmeter.quantum / np.sqrt(12.0))
    return SupplyModel(
        time_s=time_s,
        pulse_us=pulse,
        level=level,
        speed_rad_s=speed,
        speed_se=np.hypot(np.nan_to_num(mean_se), min_se / np.sqrt(n)),
        rotor_rad_s=speeds,
        rotor_se=np.hypot(np.nan_to_num(rotor_se), min_se),
        load=load / load.max(),
        full_load=float(load.max()),
        by_current=by_current,
        voltage_V=voltage,
        voltage_se=float(max(voltage_se, 1e-3)),
        is_predicted=is_predicted,
    )


def _levels(pulse_us: Array) -> NDArray[np.intp]:
    """Return the index of each row's pulse level, with pulses rounded to 0.1 us."""
    indices: NDArray[np.intp] = np.unique(np.round(pulse_us, 1), return_inverse=True)[1]
    return indices.reshape(-1)


def _find_predictable(level: NDArray[np.intp]) -> Mask:
    """Return the rows (m,) after the first visits of their level."""
    is_predicted = np.ones(len(level), bool)
    for index in np.unique(level):
        is_predicted[np.flatnonzero(level == index)[:FIRST_VISITS]] = False
    return is_predicted


def _rows(recording: Recording, pattern: str, n: int) -> Array:
    """Return a channel of all rotors (n, m), else of the first one (1, m), else (0,)."""
    names = [pattern.format(i + 1) for i in range(n)]
    if any(name not in recording for name in names):
        names = [name for name in names[:1] if name in recording]
    return np.array([recording.to_si(name) for name in names])


def _column(recording: Recording, name: str) -> Array:
    return recording.to_si(name) if name in recording else np.full(len(recording), np.nan)
