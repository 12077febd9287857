"""Units of files and columns with their factors to SI, and the array type of numbers in them.

All internal quantities are SI; other units are used only when files are read or numbers printed.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from benchtool.core.errors import UnknownChoice

Array = NDArray[np.float64]  # a docstring gives shape and unit
Number = TypeVar("Number", float, Array)

STANDARD_GRAVITY_M_S2 = 9.80665  # CGPM 1901; for gram-force and kilogram-force
POUND_FORCE_N = 4.4482216152605  # 0.45359237 kg (international pound, 1959) times gravity


@dataclass(frozen=True, slots=True)
class Unit:
    """One unit: value_SI = factor * value + offset, in the SI unit of its dimension."""

    symbol: str
    dimension: str
    factor: float = 1.0
    offset: float = 0.0


_ALL = (
    Unit("1", "ratio"),
    Unit("%", "ratio", 1e-2),
    Unit("count", "count"),
    Unit("s", "time"),
    Unit("ms", "time", 1e-3),
    Unit("us", "time", 1e-6),
    Unit("pwm_us", "pulse width"),
    Unit("m", "length"),
    Unit("cm", "length", 1e-2),
    Unit("mm", "length", 1e-3),
    Unit("in", "length", 0.0254),
    Unit("rad", "angle"),
    Unit("deg", "angle", pi / 180.0),
    Unit("rad/s", "angular speed"),
    Unit("deg/s", "angular speed", pi / 180.0),
    Unit("rpm", "angular speed", 2.0 * pi / 60.0),
    Unit("N", "force"),
    Unit("mN", "force", 1e-3),
    Unit("gf", "force", 1e-3 * STANDARD_GRAVITY_M_S2),
    Unit("kgf", "force", STANDARD_GRAVITY_M_S2),
    Unit("lbf", "force", POUND_FORCE_N),
    Unit("N m", "torque"),
    Unit("mN m", "torque", 1e-3),
    Unit("kg", "mass"),
    Unit("g", "mass", 1e-3),
    Unit("V", "voltage"),
    Unit("mV", "voltage", 1e-3),
    Unit("A", "current"),
    Unit("W", "power"),
    Unit("N/W", "force per power"),
    Unit("gf/W", "force per power", 1e-3 * STANDARD_GRAVITY_M_S2),
    Unit("K", "temperature"),
    Unit("degC", "temperature", 1.0, 273.15),
    Unit("Pa", "pressure"),
    Unit("hPa", "pressure", 100.0),
    Unit("kg/m3", "density"),
    Unit("m/s", "speed"),
    Unit("m/s2", "acceleration"),
    Unit("kg m2", "moment of inertia"),
    Unit("N/s", "force rate"),
    Unit("1/s", "rate"),
    Unit("N/(rad/s)2", "thrust coefficient"),
    Unit("N m/(rad/s)2", "drag coefficient"),
    Unit("N m s", "angular damping"),
    Unit("N m/rad", "angular stiffness"),
)

UNITS: dict[str, Unit] = {unit.symbol: unit for unit in _ALL}  # pulse widths stay in microseconds


def find_unit(symbol: str) -> Unit:
    """Return the unit of a symbol; raise UnknownChoice for an unknown one."""
    try:
        return UNITS[symbol]
    except KeyError:
        raise UnknownChoice("unit", symbol, UNITS) from None


def to_si(value: Number, symbol: str) -> Number:
    """Return `value` in unit `symbol`, converted to the SI unit of its dimension."""
    unit = find_unit(symbol)
    return value * unit.factor + unit.offset


def from_si(value: Number, symbol: str) -> Number:
    """Return `value` in SI, converted to the unit `symbol`."""
    unit = find_unit(symbol)
    return (value - unit.offset) / unit.factor
