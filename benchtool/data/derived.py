"""Derived quantities of a recording's rows, with propagated errors.

Each input alone is changed by plus and minus its standard uncertainty and all quantities are
computed again; half the difference is its contribution (JCGM 100:2008, 5.1.3 note 2). So the
density in C_T and in C_P of a figure of merit is fully correlated.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from benchtool.core.air import STANDARD_DEGC, STANDARD_DENSITY_KG_M3, relative_density_sd
from benchtool.core.channel import Channel, error_channel_name, unit_from_name
from benchtool.core.error_source import ErrorSource, UncertainValues
from benchtool.core.errors import FileFormatError
from benchtool.core.recording import Recording
from benchtool.core.rig import Propeller, Rig, Sensor
from benchtool.core.toml_text import build_dataclass
from benchtool.core.units import Array
from benchtool.data.calibration import zero_noise, zero_variance
from benchtool.data.columns import speed_columns
from benchtool.data.quantities import DATA_SHEET, MEASURED, QUANTITIES, Quantity
from benchtool.data.run.ratios import standard_error
from benchtool.data.run.read import is_run, run_rig
from benchtool.data.run.run_metadata import read_metadata

DATA_SHEET_SD = 0.05  # relative standard uncertainty of values of a motor's data sheet; assumed

# Standard uncertainties, relative and in kelvin, of unmeasured air: uniform over 5 to 25 degC, up
# to 500 m above sea level and any weather; assumed
UNMEASURED_DENSITY_SD, UNMEASURED_K = 0.03, 6.0


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownValue:
    """Known value that is not a channel, with standard uncertainty and origin."""

    value: float
    sd: float = 0.0
    unit: str = "1"
    origin: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasurementContext:
    """Known values of a bench in addition to its channels."""

    known_values: Mapping[str, KnownValue] = field(default_factory=dict)  # as in `Quantity.of`
    scales: Mapping[str, KnownValue] = field(default_factory=dict)  # relative, by channel
    sensors: Mapping[str, Sensor] = field(default_factory=dict)  # fallback for standard errors
    rig: Rig | None = None  # of a run; None for a foreign file


def measurement_context(
    propeller: Propeller | None = None,
    air: Mapping[str, Any] | None = None,
    rig: Rig | None = None,
    calibration: Mapping[str, Any] | None = None,
) -> MeasurementContext:
    """Return the context from the metadata of a run or recording.

    Args:
        propeller: None means that of the rig, or its radius.
        air: as `Air.facts` returns it; None means the standard air.
    """
    values = dict(_air(air or {}))
    if propeller is None and rig is not None:
        diameter_m = 2.0 * rig.propulsion.radius_m
        propeller = rig.propeller or Propeller(name=f"rig {rig.name}", diameter_m=diameter_m)
    if propeller is not None:
        label, relative = propeller.name, propeller.diameter_sd
        d = propeller.diameter_m
        values["diameter_m"] = KnownValue(value=d, sd=d * relative, unit="m", origin=label)
        if (c := propeller.chord_m) is not None:
            sd = c * propeller.chord_sd
            values["chord_m"] = KnownValue(value=c, sd=sd, unit="m", origin=label)
    if rig is not None and (motor := rig.motor) is not None and motor.has_curve:
        for name, unit in zip(DATA_SHEET, ("1", "1", "A"), strict=True):
            value = float(getattr(motor, name))
            origin = f"data sheet, {100.0 * DATA_SHEET_SD:g} % assumed"
            sd = DATA_SHEET_SD * value
            values[name] = KnownValue(value=value, sd=sd, unit=unit, origin=origin)
    sensors = {} if rig is None else rig.sensors
    scales = {
        name: KnownValue(value=1.0, sd=sensor.scale_sd, origin=f"rig {rig.name}" if rig else "")
        for name, sensor in sensors.items()
        if sensor.scale_sd
    }
    if calibration:
        sd, number = float(calibration["relative_sd"]), str(calibration["id"])
        scales["thrust_N"] = KnownValue(value=1.0, sd=sd, origin=f"calibration {number}")
    return MeasurementContext(known_values=values, scales=scales, sensors=sensors, rig=rig)


def _air(facts: Mapping[str, Any]) -> Iterator[tuple[str, KnownValue]]:
    """Yield density and temperature of the air."""
    degC = float(facts.get("temperature_degC", STANDARD_DEGC))
    density = float(facts.get("density_kg_m3", STANDARD_DENSITY_KG_M3))
    relative, kelvin, origin = UNMEASURED_DENSITY_SD, UNMEASURED_K, "standard air, unmeasured"
    if facts.get("measured"):
        here = degC, float(facts["pressure_Pa"]), float(facts["humidity"])
        relative, kelvin, origin = relative_density_sd(*here), 1.0 / sqrt(3.0), "measured air"
    elif facts.get("stated"):
        relative, origin = 0.0, "density given by the user"
    sd = density * relative
    yield "density_kg_m3", KnownValue(value=density, sd=sd, unit="kg/m3", origin=origin)
    yield "air_degC", KnownValue(value=degC, sd=kelvin, unit="K", origin=origin)


def load_run_context(folder: Path) -> MeasurementContext:
    """Return the context of a run folder; only standard air for anything else."""
    if not is_run(folder):
        return measurement_context()
    facts = read_metadata(folder)
    try:
        rig = run_rig(folder, facts)
    except FileFormatError:
        return measurement_context(None, facts.get("air"))
    return measurement_context(None, facts.get("air"), rig, facts.get("calibration"))


def build_recording_context(facts: Mapping[str, Any], where: str) -> MeasurementContext:
    """Return the context of a recording file from its JSON metadata."""
    data = facts.get("propeller")
    propeller = build_dataclass(Propeller, data, f"{where}: propeller") if data else None
    return measurement_context(propeller, facts.get("air"))


@dataclass(frozen=True, slots=True, eq=False)
class QuantityValues(UncertainValues):
    """Values (n,) of a quantity in the rows of a recording."""

    quantity: Quantity
    origin: str  # label: measured, from the file, or the inputs that it is derived from

    @property
    def name(self) -> str:
        """Column name."""
        return self.quantity.name

    def averaged(self, groups: Array) -> QuantityValues:
        """Return means over the rows of each group (m,), in ascending order of the groups (n,).

        The independent error of a mean is the larger of its rows' errors and their scatter.
        """
        names, group = np.unique(groups, return_inverse=True)
        weights = (group == np.arange(len(names))[:, None]) & np.isfinite(self.value)
        count = weights.sum(axis=1)
        share = weights / np.where(count > 0, count, np.nan)[:, None]
        value = np.nan_to_num(self.value)
        mean = share @ value
        scatter = np.sqrt(np.sum(share * (value - mean[:, None]) ** 2, axis=1))
        scatter_se = np.where(count > 1, scatter / np.sqrt(np.maximum(count - 1, 1)), np.nan)
        errors = np.where(weights, self.standard_error, 0.0)
        propagated = np.sqrt(np.sum((share * errors) ** 2, axis=1))
        sources = tuple(
            replace(source, columns=share @ np.nan_to_num(source.columns))
            for source in self.error_sources
        )
        error = np.fmax(propagated, scatter_se)
        return replace(self, value=mean, standard_error=error, error_sources=sources)


Values = dict[str, Any]


def derive_quantities(
    recording: Recording, context: MeasurementContext
) -> tuple[QuantityValues, ...]:
    """Return every quantity that can be derived from a recording's channels and its context.

    A quantity that is a column of the recording is not derived again.
    """
    inputs = _inputs(recording, context)
    values = _evaluate(inputs)
    quantities = [quantity for quantity in QUANTITIES if _has_finite(values.get(quantity.name))]
    errors: dict[str, Array] = {quantity.name: np.zeros(len(recording)) for quantity in quantities}
    names = list(errors)
    leaves = {quantity.name: _find_inputs(quantity, inputs) for quantity in quantities}
    for name, row, error in _independent_errors(recording, context, inputs):
        if np.isnan(error).all():  # unknown: dependent quantities have no error
            errors |= {key: error for key in errors if name in leaves[key]}
            continue
        for key, part in _contributions(inputs, name, error, names, row).items():
            errors[key] = np.hypot(errors[key], part)
    shared: dict[str, list[ErrorSource]] = {quantity.name: [] for quantity in quantities}
    for label, name, known_value, error in _shared_errors(context, inputs):
        for key, part in _contributions(inputs, name, error, list(shared)).items():
            if np.any(np.nan_to_num(part) != 0.0):
                shared[key].append(
                    ErrorSource(
                        name=label, kind="B", unit=known_value.unit, sd=known_value.sd,
                        columns=part[:, None], origin=known_value.origin,
                    )
                )  # fmt: skip
    return tuple(
        QuantityValues(
            np.asarray(values[quantity.name], float), errors[quantity.name],
            tuple(shared[quantity.name]), quantity, _origin(quantity, inputs, context),
        )
        for quantity in quantities
    )  # fmt: skip


def evaluate_quantities(recording: Recording, context: MeasurementContext) -> dict[str, Array]:
    """Return every quantity (n,) of a recording's rows by name, without errors."""
    values = _evaluate(_inputs(recording, context))
    return {
        item.name: values[item.name] for item in QUANTITIES if _has_finite(values.get(item.name))
    }


def _has_finite(values: Any) -> bool:
    return values is not None and bool(np.isfinite(values).any())


def _inputs(recording: Recording, context: MeasurementContext) -> Values:
    """Return the inputs of quantities: channels, speeds, known values."""
    inputs: Values = {name: known_value.value for name, known_value in context.known_values.items()}
    candidates = dict.fromkeys((*MEASURED, *(quantity.name for quantity in QUANTITIES)))
    for name in candidates:
        if name in recording and _has_finite(recording.column(name)):
            inputs[name] = recording.to_si(name)
    if names := speed_columns(recording.names, "rpm"):
        inputs["speed_rad_s"] = np.array([recording.to_si(name) for name in names])
        turning = [row for row in inputs["speed_rad_s"] if np.any(row > 0.0)]
        if len(turning) == 1:
            inputs["shaft_rad_s"] = turning[0]
    if "shaft_rad_s" not in inputs and "speed_rad_s" in inputs:
        inputs.pop("torque_Nm", None)  # of several rotors a stand measures a sum that cancels
    if "torque_Nm" in inputs:  # its sign is that of the spin
        inputs["torque_Nm"] = inputs["torque_Nm"] * np.sign(
            np.nansum(inputs["torque_Nm"] * inputs.get("shaft_rad_s", 1.0))
        )
    return inputs


@np.errstate(divide="ignore", invalid="ignore", over="ignore")
def _evaluate(inputs: Values) -> Values:
    values = dict(inputs)
    for quantity in QUANTITIES:
        if quantity.name not in values and values.keys() >= set(quantity.needs):
            values[quantity.name] = quantity.of(**{name: values[name] for name in quantity.needs})
    return values


def _contributions(
    inputs: Values, name: str, error: Any, names: Sequence[str], row: int | None = None
) -> dict[str, Array]:
    """Return the change of each quantity (n,) of `names` by one standard uncertainty of an input.

    `row` is that of the only rotor whose speed is changed; None for all.
    """
    step = error
    if row is not None:
        step = np.zeros_like(inputs[name])
        step[row] = error
    moved = []
    for changed in (inputs[name] + step, inputs[name] - step):
        values = {**inputs, name: changed}
        if name == "speed_rad_s" and "shaft_rad_s" in inputs:
            values["shaft_rad_s"] = max(changed, key=lambda row: float(np.nansum(row)))
        moved.append(_evaluate(values))
    return {
        key: np.asarray(0.5 * (moved[0][key] - moved[1][key]), float)
        for key in names
        if key in moved[0]
    }


def _independent_errors(
    recording: Recording, context: MeasurementContext, inputs: Values
) -> Iterator[tuple[str, int | None, Array]]:
    """Yield each input with independent errors, its rotor's row, and its standard error (n,)."""
    for name in inputs.keys() & {*MEASURED, *(quantity.name for quantity in QUANTITIES)}:
        error = standard_error(recording, name, context.sensors)
        if name == "thrust_N" and context.rig is not None and "elapsed_s" in recording:
            since_s = np.nan_to_num(recording.column("elapsed_s"))
            zero = zero_variance(np.maximum(since_s, 0.0), zero_noise(context.rig))
            error = np.hypot(error, np.sqrt(zero))
        yield name, None, error
    for row, name in enumerate(speed_columns(recording.names, "rpm")):
        if np.any(inputs["speed_rad_s"][row] > 0.0):
            yield "speed_rad_s", row, standard_error(recording, name, context.sensors) * pi / 30.0


def _shared_errors(
    context: MeasurementContext, inputs: Values
) -> Iterator[tuple[str, str, KnownValue, Any]]:
    """Yield label, input, known value and change of the input of each error shared by rows."""
    for name, known_value in context.known_values.items():
        if known_value.sd:
            yield LABELS.get(name, name), name, known_value, known_value.sd
    for channel, known_value in context.scales.items():
        name = "speed_rad_s" if channel == "rpm" else channel
        if name in inputs:
            yield f"{channel.split('_')[0]} scale", name, known_value, known_value.sd * inputs[name]


LABELS = {  # of the errors of known values
    "diameter_m": "diameter", "chord_m": "chord", "density_kg_m3": "air density",
    "air_degC": "air temperature", "Kv_rpm_V": "Kv of the motor",
    "resistance_ohm": "resistance of the motor", "no_load_current_A": "no-load current",
}  # fmt: skip


def _find_inputs(quantity: Quantity, inputs: Values) -> list[str]:
    """Return the inputs that a quantity is derived from, directly or indirectly."""
    if quantity.name in inputs:
        return [quantity.name]
    table = {entry.name: entry for entry in QUANTITIES}
    names: dict[str, None] = {}
    for name in quantity.needs:
        names |= dict.fromkeys([name] if name in inputs else _find_inputs(table[name], inputs))
    return list(names)


def _origin(quantity: Quantity, inputs: Values, context: MeasurementContext) -> str:
    if quantity.name in inputs:
        return "measured" if quantity.name in MEASURED else "as in the file"
    leaves = _find_inputs(quantity, inputs)
    channels = [
        "rpm" if name in ("speed_rad_s", "shaft_rad_s") else name
        for name in leaves
        if name not in context.known_values
    ]
    text = f"from {', '.join(dict.fromkeys(channels))}"
    sheet = [name for name in leaves if name in DATA_SHEET]
    return f"{text} and the data sheet ({', '.join(sheet)})" if sheet else text


def add_quantities(recording: Recording, context: MeasurementContext) -> Recording:
    """Return a recording with every quantity that can be derived in this context."""
    return with_quantities(recording, derive_quantities(recording, context))


def with_quantities(recording: Recording, quantities: Sequence[QuantityValues]) -> Recording:
    """Return a recording with a column for each quantity and one for its standard error.

    Existing columns are unchanged; unknown errors get no column.
    """
    for quantity in quantities:
        for name, values in (
            (quantity.name, quantity.value),
            (error_channel_name(quantity.name), quantity.total_error),
        ):
            if name not in recording and (name == quantity.name or _has_finite(values)):
                recording = recording.with_column(Channel(name, unit_from_name(name)), values)
    return recording
