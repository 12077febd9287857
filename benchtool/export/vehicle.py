"""Vehicle data for export targets, each number with its interval or source."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import isfinite
from operator import attrgetter
from pathlib import Path

import numpy as np

from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.fit_result import Estimate
from benchtool.core.rig import UNSPECIFIED, Propeller, Rig
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.data.run.entry import FIT_FILE, read_result
from benchtool.data.run.read import is_run
from benchtool.fit.motor.constants import MotorFit, fit_motor
from benchtool.fit.motor.runs import check_propeller
from benchtool.physics.conditions import Conditions
from benchtool.physics.model import Model
from benchtool.physics.model_file import load_model

MODEL_FILE = "model.toml"


@dataclass(frozen=True, slots=True)
class ExportedNumber:
    """Exported number."""

    value: float
    unit: str
    why: str  # 95 % interval and fit, or source
    stated: bool = True  # False for a typical value that replaces a missing one of the rig

    @property
    def note(self) -> str:
        """Unit and origin, for a comment."""
        return self.why if self.unit == "1" else f"{self.unit}; {self.why}"

    def within(self, low: float, high: float) -> ExportedNumber:
        """Return the number clipped to the range of a target, which its origin then states."""
        value = min(max(self.value, low), high)
        if value == self.value:
            return self
        why = f"limit of the target, estimate {self.value:.4g}; {self.why}"
        return replace(self, value=value, why=why)

    def of(self, factor: float, unit: str) -> ExportedNumber:
        """Return the number times a factor, in another unit; the stated interval is unscaled."""
        why = f"of {self.value:.6g} {self.unit}, {self.why}"
        return replace(self, value=self.value * factor, unit=unit, why=why)


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """Vehicle data for flight software and simulators."""

    model: Model  # physics of the thrust near a surface
    motor: MotorFit | None = None  # constants of a motor test; None: those of the rig
    intervals: Mapping[str, tuple[float, float]]  # 95 %, by full name; combined if available
    fitted: str = ""  # source of the intervals, such as "fit bench-1"
    simulated: bool = False  # data of the fit or the motor test
    mass_kg: float | None = None  # instead of the rig's
    rotors: int | None = None  # that carry the mass, if not the rig's; for hover only

    def __post_init__(self) -> None:
        if self.rotors is not None and self.rig.n_rotors not in (1, self.rotors):
            raise InputError(
                f"--rotors is {self.rotors}, but rig {self.rig.name!r} has {self.rig.n_rotors}"
            )

    @property
    def rig(self) -> Rig:
        """The rig of the model."""
        return self.model.rig

    @property
    def name(self) -> str:
        """Name of the rig as an identifier."""
        text = re.sub("[^A-Za-z0-9]", "_", self.rig.name)
        return text if text[:1].isalpha() else f"rig_{text}"

    def of_rig(self, key: str, unit: str) -> ExportedNumber:
        """Return a number of the rig by its dotted key, such as "body.mass_kg"."""
        source = self.rig.sources.get(key) or "no source"
        assumed = "assumed: " if key in self.rig.assumed and "assumed" not in source else ""
        stated = not source.startswith(UNSPECIFIED)
        value = float(attrgetter(key)(self.rig))
        return ExportedNumber(value, unit, f"no interval; {assumed}{source}", stated)

    @property
    def mass(self) -> ExportedNumber:
        """Mass that `rotors` carry: kg."""
        if self.mass_kg is None:
            return self.of_rig("body.mass_kg", "kg")
        return ExportedNumber(self.mass_kg, "kg", "no interval; as stated for the export")

    @property
    def masses(self) -> dict[str, ExportedNumber]:
        """Mass and moments of inertia of the whole vehicle of the rig."""
        inertias = {
            f"i{axis}": self.of_rig(f"body.inertia_{axis}_kgm2", "kg m^2")
            for axis in ("xx", "yy", "zz")
        }
        is_rig = self.rotors in (None, self.rig.n_rotors)
        return {"mass": self.mass if is_rig else self.of_rig("body.mass_kg", "kg"), **inertias}

    def _of_motor(self, name: str) -> ExportedNumber | None:
        """Return a constant of the motor test; None if it is not determined."""
        if self.motor is None or not isfinite(self.motor.value(name)):
            return None
        estimate: Estimate = self.motor[name]
        low, high = estimate.interval_95
        note = f"{estimate.bound}; " if estimate.bound else ""
        runs = ", ".join(self.motor.names)
        why = f"{note}95 %: {low:.5g} to {high:.5g}, motor test {runs}"
        return ExportedNumber(estimate.value, estimate.unit, why)

    @cached_property
    def full(self) -> tuple[ExportedNumber, ExportedNumber]:
        """Pulse and voltage of full command: us, V; the rig's, or the highest measured."""
        pulse = self.of_rig("propulsion.pwm_max_us", "us")
        voltage = self.of_rig("propulsion.voltage_nominal_V", "V")
        if self.motor is not None and self._of_motor("T_max") is not None:
            full, test = self.motor.full, f"motor test {self.motor.names[0]}"
            volts = full.voltage_V if isfinite(full.voltage_V) else full.measured_V
            if full.pulse_us != pulse.value:
                pulse = ExportedNumber(full.pulse_us, "us", f"highest measured, {test}")
            if isfinite(volts) and volts != voltage.value:
                why = "voltage at the highest measured throttle, where the thrust curve is valid; "
                why += f"not the maximum of the battery; {test}"
                voltage = ExportedNumber(volts, "V", why)
        return pulse, voltage

    def parameter(self, name: str) -> ExportedNumber:
        """Return a parameter of the model by its full name."""
        item = self.model.parameters[name]
        why = f"no interval; {item.source or 'the rig'}"
        if name in self.intervals:
            low, high = self.intervals[name]
            why = f"95 %: {low:.5g} to {high:.5g}, {self.fitted}"
        return ExportedNumber(item.value, item.unit, why)

    @cached_property
    def _k(self) -> ExportedNumber:
        """Thrust over squared speed of one rotor: from motor test, fit or rig, in this order."""
        k = self.of_rig("propulsion.thrust_coefficient_N_s2", "N/(rad/s)^2")
        return self._of_motor("k") or (self.parameter("k") if "k" in self.intervals else k)

    @cached_property
    def k(self) -> ExportedNumber:
        """Thrust over squared speed at full command: N/(rad/s)^2.

        A target whose thrust is k w^2 reaches `thrust_max` at `speed_max`; the error at lower
        throttles is stated.
        """
        k = self.thrust_max.value / self.speed_max.value**2
        thrust = self.thrust_N(np.linspace(0.1, 1.0, 91))
        error = np.abs(k * self.speed_rad_s(thrust) ** 2 - thrust)
        worst = int(error.argmax())
        of_full, relative = error[worst] / thrust[-1], error[worst] / thrust[worst]
        if of_full < 1e-9:
            return self._k
        why = f"exact at full command, k w^2 within {100.0 * of_full:.2g} % of full thrust"
        why += f" ({100.0 * relative:.3g} % of that thrust) above throttle 0.1; fitted"
        return ExportedNumber(
            k, self._k.unit, f"{why} {self._k.value:.6g}, {self._k.why}", self._k.stated
        )

    def speed_rad_s(self, thrust_N: Array) -> Array:
        """Return the speeds (n,) at thrusts far from any surface: rad/s."""
        if self.motor is None or self.motor.law is None:
            return np.asarray(np.sqrt(thrust_N / self._k.value), float)
        speed_at = self.motor.law.speed_at
        return np.asarray(np.vectorize(lambda T: speed_at(T)[0], otypes=[float])(thrust_N))

    @cached_property
    def torque_per_thrust(self) -> ExportedNumber:
        """Shaft torque over thrust: m."""
        torque = self.of_rig("propulsion.drag_coefficient_Nm_s2", "N m/(rad/s)^2")
        return torque.of(1.0 / self.k.value, "m")

    @cached_property
    def speed_max(self) -> ExportedNumber:
        """Speed at full command, from the thrust: rad/s."""
        full = self.thrust_max
        speed = float(self.speed_rad_s(np.array(full.value)))
        return ExportedNumber(speed, "rad/s", f"at thrust {full.value:.6g} N, {full.why}")

    @cached_property
    def thrust_max(self) -> ExportedNumber:
        """Thrust of one rotor at pulse and voltage of `full`: N."""
        p = self.rig.propulsion
        speed_rad_s = p.speed_per_us_rad_s * (p.pwm_max_us - p.pwm_start_us)
        return self._of_motor("T_max") or self._k.of(speed_rad_s**2, "N")

    @cached_property
    def expo(self) -> ExportedNumber:
        """The e of thrust over throttle u: T = T_max ((1 - e) u + e u^2).

        1 for a speed linear in the pulse above `pwm_start_us`, as in rigs.
        """
        why = "no interval; the rig's speed is linear in the pulse, thrust in its square"
        return self._of_motor("expo") or ExportedNumber(1.0, "1", why, stated=False)

    def lag(self, way: str) -> ExportedNumber:
        """Return the time constant of speed, throttle rising ("up") or falling ("down"): s."""
        return self._of_motor(f"lag_{way}") or self.of_rig("propulsion.lag_s", "s")

    @property
    def hover_share(self) -> ExportedNumber:
        """Hover thrust over full thrust."""
        mass, rotors = self.mass, self.rotors or self.rig.n_rotors
        why = f"hover of {mass.value:g} kg on {pluralize(rotors, 'rotor')}; mass: {mass.why}"
        share = mass.value * 9.80665 / (rotors * self.thrust_max.value)
        if share > 1.0 and (self.mass_kg, self.rotors) != (None, None):
            raise InputError(
                f"{mass.value:g} kg on {pluralize(rotors, 'rotor')} need {share:.3g} of full "
                f"thrust; give another --mass-kg or --rotors"
            )
        return ExportedNumber(share, "1", why, mass.stated)

    def thrust_N(self, throttle: Array) -> Array:
        """Return the thrust of one rotor at throttles (n,), far from any surface: N.

        Used by all targets. Throttle: 0 at `pwm_start_us`, 1 at `full`.
        """
        e = self.expo.value
        u = np.asarray(throttle, float)
        return np.asarray(self.thrust_max.value * ((1.0 - e) * u + e * u * u), float)

    @cached_property
    def _flying(self) -> Model:
        """Model without bench geometry: offset or tilt of the plate."""
        model = self.model
        for effect in self.model.effects:
            if effect.changes_geometry:
                model = model.without(effect.name)
        return model

    @property
    def nearest_z_m(self) -> float:
        """Minimum distance of the model's validity: m."""
        return self.model.nearest_z_over_R * self.rig.propulsion.radius_m

    def factor(self, z_m: Array) -> Array:
        """Return the thrust ratio (n,), level, with equal speeds and full coverage."""
        conditions = Conditions.build(
            self.rig,
            speed_rad_s=np.full((self.rig.n_rotors, len(z_m)), 0.5 * self.speed_max.value),
            plate_z_m=np.asarray(z_m, float),
            plate_x_m=np.zeros(len(z_m)),
            plate_tilt_rad=np.zeros(len(z_m)),
        )
        conditions.coverage[:] = 1.0
        values = self._flying.parameters.values_array()
        near, far = (
            self._flying.squared_speed(self._flying.flow(state, values), values)
            for state in (conditions, conditions.out_of_ground_effect())
        )
        return np.asarray(near / far, float)


def build_vehicle(
    model: str | Path,
    motor: Sequence[str | Path] = (),
    permit: CodePermit = check_code_allowed,
    rig: Rig | None = None,
    propeller: Propeller | None = None,
    extrapolate: bool = False,
) -> Vehicle:
    """Return the vehicle of a model, a fit folder, a run without a plate, or a stand log.

    Args:
        model: bundled name or path. A run or log is a motor test of its rig, with the law of the
            paper near a surface.
        motor: runs without a plate or logs of the same rotors, whose constants replace the rig's.
        permit: called with user code of a model before it is run.
        rig, propeller, extrapolate: see `fit_motor`.

    Raises:
        FileFormatError, UnknownChoice: unknown model.
        InputError: model rejected by its data, or motor test of another rig.
    """
    path = Path(model)
    if is_run(path) or (path.is_file() and path.suffix != ".toml"):
        test = fit_motor((path, *motor), None, rig, propeller, extrapolate=extrapolate)
        check_propeller(test.rig)
        paper_model = load_model("quad_body_lift" if test.rig.n_discs > 1 else "single", test.rig)
        return Vehicle(model=paper_model.model, motor=test, intervals={}, simulated=test.simulated)
    if path.is_dir():
        if not (path / MODEL_FILE).is_file():
            raise FileFormatError(
                str(path), f"no {MODEL_FILE} in it; name the folder of a fit or run"
            )
        path = path / MODEL_FILE
    loaded = load_model(path if path.is_file() else model, permit=permit).model
    if why := loaded.provenance.get("rejected"):
        raise InputError(f"model {loaded.name!r} was rejected by its data, not exported: {why}")
    intervals: dict[str, tuple[float, float]] = {}
    fit_file, simulated = path.with_name(FIT_FILE), False
    if path.is_file() and fit_file.is_file():
        tables = read_result(fit_file.parent)
        simulated = bool(tables["simulated"])
        for result in tables["results"].values():
            for name, item in result["estimates"].items():
                combined = item.get("combined_95", (None,))
                low, high = item["interval_95"] if None in combined else combined
                intervals[name] = (float(low), float(high))
    inputs = (None, rig or loaded.rig, propeller)
    motor_test = fit_motor(motor, *inputs, extrapolate=extrapolate) if motor else None
    if motor_test is not None:
        _check_rigs(motor_test.rig, loaded.rig)
    return Vehicle(
        model=loaded,
        motor=motor_test,
        intervals=intervals,
        fitted=f"fit {fit_file.parent.resolve().name}",
        simulated=simulated or (motor_test is not None and motor_test.simulated),
    )


def _check_rigs(tested: Rig, rig: Rig) -> None:
    """Raise InputError if a motor test is not valid for the rig of a model."""
    # A test of one rotor represents each rotor of the vehicle.
    if tested.n_rotors not in (1, rig.n_rotors):
        raise InputError(
            f"the motor test has {tested.n_rotors} rotors and rig {rig.name!r} {rig.n_rotors}; "
            f"test one rotor, or this vehicle's"
        )
    pulses = attrgetter("pwm_stop_us", "pwm_start_us", "pwm_max_us")
    if pulses(tested.propulsion) != pulses(rig.propulsion):
        raise InputError(
            f"pulse widths differ: {pulses(tested.propulsion)} us of rig {tested.name!r} in the "
            f"motor test, {pulses(rig.propulsion)} us of rig {rig.name!r} in the model; name the "
            f"run instead of a model, or another model"
        )
