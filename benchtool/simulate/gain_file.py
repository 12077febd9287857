"""Gain sets as TOML files: strict, with a source for every number."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, get_type_hints

from annotated_types import Ge, Gt

from benchtool.core.errors import FileFormatError, InputError, UnknownChoice
from benchtool.core.library import list_names, read_named
from benchtool.core.parsed_text import parse_toml
from benchtool.core.toml_text import (
    FiniteTable,
    ValueSources,
    build_dataclass,
    require_sources,
    unwrap_quantities,
)

Positive = Annotated[float, Gt(0.0)]
NotNegative = Annotated[float, Ge(0.0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class PositionGains(FiniteTable):
    """Turn a position error into an acceleration.

    Attributes:
        k_x_per_s: velocity command over position error.
        k_v_per_s: acceleration command over velocity error.
        k_iv_per_s2: rate of the velocity integral over velocity error.
        slew_limit_m_s2: limit of the velocity command's rate of change.
    """

    k_x_per_s: NotNegative
    k_v_per_s: NotNegative
    k_iv_per_s2: NotNegative
    integral_limit_m_s2: NotNegative
    slew_limit_m_s2: Positive
    pitch_limit_rad: Positive


@dataclass(frozen=True, slots=True, kw_only=True)
class AttitudeGains(FiniteTable):
    """Turn an attitude error into an angular acceleration, in two nested loops.

    Attributes:
        k_theta_per_s: rate command over attitude error.
        k_i_theta_per_s2: rate of the rate command's integral part over attitude error.
        k_q_per_s: angular acceleration over rate error.
        k_i_q_per_s2: rate of the acceleration's integral part over rate error.
    """

    k_theta_per_s: NotNegative
    k_i_theta_per_s2: NotNegative
    theta_integral_limit_rad_s: NotNegative
    rate_limit_rad_s: Positive
    k_q_per_s: NotNegative
    k_i_q_per_s2: NotNegative
    q_integral_limit_rad_s2: NotNegative


@dataclass(frozen=True, slots=True, kw_only=True)
class AltitudeGains(FiniteTable):
    """Turn a height error into a vertical acceleration."""

    k_z_per_s2: NotNegative
    k_vz_per_s: NotNegative
    k_iz_per_s3: NotNegative
    limit_m_s2: Positive


@dataclass(frozen=True, slots=True, kw_only=True)
class ObserverGains(FiniteTable):
    """Set the disturbance observer of eq. (12): its bandwidth, 1/s; 0 is no observer."""

    rate_per_s: NotNegative


@dataclass(frozen=True, slots=True, kw_only=True)
class YawGains(FiniteTable):
    """Turn a heading error into an angular acceleration about the vertical axis."""

    k_psi_per_s: NotNegative
    k_r_per_s: NotNegative


@dataclass(frozen=True, kw_only=True)
class Gains(FiniteTable):
    """Hold one named set of gains for every loop.

    Attributes:
        sources: where each number comes from, by its dotted key.
        assumed: dotted keys whose numbers are assumptions.
    """

    name: str
    title: str
    control_rate_Hz: Positive
    position: PositionGains
    attitude: AttitudeGains
    altitude: AltitudeGains
    yaw: YawGains
    observer: ObserverGains
    sources: dict[str, str] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()

    def with_values(self, **values: float) -> Gains:
        """Return the set with some numbers changed, by dotted key ("attitude.k_q_per_s").

        A table's name alone ("attitude") takes a factor on its gains and leaves limits alone.
        """
        tables = [item.name for item in fields(self) if is_dataclass(getattr(self, item.name))]
        changed: Gains = self
        owner: Any
        for key, value in values.items():
            table, _, name = key.rpartition(".")
            if key in tables:
                owner = getattr(changed, key)
                names = (item.name for item in fields(owner))
                gains = [each for each in names if each.startswith("k_") or each == "rate_per_s"]
                scaled = {f"{key}.{each}": value * getattr(owner, each) for each in gains}
                changed = changed.with_values(**scaled)
                continue
            if table not in tables and key != "control_rate_Hz":
                raise UnknownChoice("table of gains", table or name, [*tables, "control_rate_Hz"])
            owner = getattr(changed, table) if table else changed
            known = [item.name for item in fields(owner)]
            if name not in known:
                raise UnknownChoice(f"gain of {table}", name, known)
            positive = name in _positive(owner.__class__)
            if not 0.0 <= float(value) < float("inf") or (positive and not value):
                bound = "above 0" if positive else "0 or more"
                raise InputError(f"gain {key} is {value}; give a finite number, {bound}")
            numbers: dict[str, Any] = {name: float(value)}
            changed = replace(changed, **({table: replace(owner, **numbers)} if table else numbers))
        return changed


@lru_cache
def _positive(table: Hashable) -> frozenset[str]:
    """Return the names of a table's numbers that must be above zero."""
    hints = get_type_hints(table, include_extras=True)
    return frozenset(
        name for name, hint in hints.items() if Gt(0.0) in getattr(hint, "__metadata__", ())
    )


def gain_names() -> tuple[str, ...]:
    """Return the names of the gain sets that benchtool ships."""
    return list_names("gains")


def gains_named(name_or_path: str | Path) -> Gains:
    """Return a shipped gain set by name, or a user's own by the path of its TOML file."""
    return gains_from_toml(*read_named("gain set", "gains", name_or_path))


def gains_from_toml(text: str, where: str) -> Gains:
    """Return the gain set that TOML text describes.

    Raises:
        UnknownChoice: a key that a gain set has not.
        FileFormatError: a number without a source, of the wrong type, or out of range.
    """
    found = ValueSources()
    data = unwrap_quantities(parse_toml(text, where), found)
    require_sources(found, where)
    gains = build_dataclass(Gains, data, where)
    if gains.control_rate_Hz > 1e5:
        raise FileFormatError(
            where, f"control_rate_Hz is {gains.control_rate_Hz:g}, above 100000; lower it"
        )
    return replace(gains, sources=found.by_key, assumed=tuple(found.assumed))
