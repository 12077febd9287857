"""Conversion of units in foreign files; pint for units that benchtool does not define."""

from __future__ import annotations

import re
import tokenize
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

from benchtool.core.errors import InputError
from benchtool.core.units import STANDARD_GRAVITY_M_S2, UNITS, find_unit

_SPELLINGS: dict[str, str] = {  # seen in real headers (RCbenchmark writes µs, N·m and ºC)
    **dict.fromkeys(("µs", "μs", "usec"), "us"),
    **dict.fromkeys(("RPM", "Rpm", "U/min", "1/min", "min-1"), "rpm"),
    **dict.fromkeys(("N·m", "N⋅m", "N*m", "Nm", "N.m", "N-m"), "N m"),
    **dict.fromkeys(("ºC", "°C", "C"), "degC"),
    **dict.fromkeys(("º", "°"), "deg"),
    "°F": "degF",
    "sec": "s",
    "": "1",
}

_FORCE_OF_MASS: dict[str, str] = {"g": "gf", "kg": "kgf", "lb": "lbf", "oz": "ozf"}
"""Unit of weight by unit of mass, for a thrust in a unit of mass."""

_TURNS: frozenset[str] = frozenset({"Hz", "rps", "rev/s", "1/s"})  # pint takes Hz for rad/s

_FOR_PINT: dict[str, str] = {
    "1": "dimensionless",
    "rpm": "revolutions_per_minute",
    "pwm_us": "microsecond",
    "gf": "force_gram",
    "kgf": "kilogram_force",
    "lbf": "pound_force",
    "ozf": "force_ounce",
    "lbft": "force_pound * foot",
    "N m": "newton * meter",
    "mN m": "millinewton * meter",
    "kg m2": "kilogram * meter ** 2",
    "kg/m3": "kilogram / meter ** 3",
    "m/s2": "meter / second ** 2",
}


def is_unit(text: str) -> bool:
    """Return whether a text is a unit: of benchtool, a known spelling or a unit of mass."""
    return text not in ("", "1") and (text in UNITS or text in _SPELLINGS or text in _FORCE_OF_MASS)


@dataclass(frozen=True, slots=True)
class Conversion:
    """Linear unit conversion: channel value = factor * file value + offset."""

    factor: float
    offset: float = 0.0


def find_conversion(text: str, target: str) -> Conversion:
    """Return the conversion from the unit `text` to the unit `target`."""
    unit = " ".join(text.split())
    unit = _SPELLINGS.get(unit, unit)
    dimension = find_unit(target).dimension
    if dimension == "force":
        unit = _FORCE_OF_MASS.get(unit, unit)
    if dimension == "acceleration" and unit == "g":
        return Conversion(STANDARD_GRAVITY_M_S2)
    if dimension == "angular speed" and unit in _TURNS:
        unit = "revolutions_per_second"
    if unit == target or (target == "pwm_us" and unit == "us"):
        return Conversion(1.0)
    listed = UNITS.get(unit)
    if listed is not None and listed.dimension == dimension:
        ours = find_unit(target)
        return Conversion(listed.factor / ours.factor, (listed.offset - ours.offset) / ours.factor)
    return _through_pint(unit, target, text)


def unit_in_header(text: str, target: str) -> Conversion | None:
    """Return the conversion from a header's text in brackets, or None if it is not a unit.

    Raises:
        InputError: a unit of another dimension.
    """
    if not text:
        return None
    try:
        return find_conversion(text, target)
    except InputError as error:
        if type(error.__cause__).__name__ != "DimensionalityError":
            return None
        raise


def _through_pint(unit: str, target: str, text: str) -> Conversion:
    import pint

    registry = _registry()
    ours = registry.Unit(_FOR_PINT.get(target, target))
    try:
        theirs = registry.Unit(_FOR_PINT.get(unit, re.sub(r"(?<=[a-zA-Z])(\d)", r"**\1", unit)))
        at_zero, at_one = (
            float(registry.Quantity(number, theirs).to(ours).magnitude) for number in (0.0, 1.0)
        )
    except pint.DimensionalityError as error:
        raise InputError(
            f"unit {text!r} is not a unit of {find_unit(target).dimension} ({target}); correct the "
            f"column's unit"
        ) from error
    except _PINT_FAULTS as error:
        raise InputError(
            f"unit {text!r} is unknown; use N, gf, lbf, ozf, rpm, Hz, us, degF, ..., or another "
            f"unit of pint"
        ) from error
    return Conversion(at_one - at_zero, at_zero)


_PINT_FAULTS = (
    *(AttributeError, ValueError, TypeError, KeyError, SyntaxError, AssertionError),
    *(ArithmeticError, RecursionError, NotImplementedError, tokenize.TokenError),
)
"""Exceptions of pint for text that is not a unit (UndefinedUnitError is an AttributeError)."""


@cache
def _registry() -> Any:
    """Return pint's registry, created on demand, as that takes 0.1 s."""
    import pint

    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True)


_WITH_UNIT = re.compile(r"(?P<name>.*?)\s*[(\[](?P<unit>[^()\[\]]*)[)\]]")


class HeaderCell(NamedTuple):
    """Name and unit of a column as in the header; the unit may be missing."""

    name: str
    unit: str | None


def parse_header_cell(cell: str) -> HeaderCell:
    """Return name and unit of a header cell."""
    cell = cell.strip()
    match = _WITH_UNIT.fullmatch(cell)
    if match is None or not match["name"]:
        return HeaderCell(cell, None)
    return HeaderCell(match["name"].strip(), match["unit"].strip())
