"""Gain sets as strict TOML files, with a source for every number."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, get_type_hints

from annotated_types import Ge, Gt

from benchtool.core.errors import FileFormatError, InputError, UnknownChoice
from benchtool.core.toml_text import FiniteTable, build_dataclass, parse_quantities
from benchtool.core.user_file import list_names, read_library_file

Positive = Annotated[float, Gt(0.0)]
NotNegative = Annotated[float, Ge(0.0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class PositionGains(FiniteTable):
    """Gains of the position loop: acceleration from position error.

    Attributes:
        k_x_per_s: velocity command per position error.
        k_v_per_s: acceleration command per velocity error.
        k_iv_per_s2: rate of the velocity integral per velocity error.
        slew_limit_m_s2: rate limit of the velocity command.
    """

    k_x_per_s: NotNegative
    k_v_per_s: NotNegative
    k_iv_per_s2: NotNegative
    integral_limit_m_s2: NotNegative
    slew_limit_m_s2: Positive
    pitch_limit_rad: Positive


@dataclass(frozen=True, slots=True, kw_only=True)
class AttitudeGains(FiniteTable):
    """Gains of the attitude loops: angular acceleration from attitude error.

    Attributes:
        k_theta_per_s: rate command per attitude error.
        k_i_theta_per_s2: rate of the integral part of the rate command per attitude error.
        k_q_per_s: angular acceleration per rate error.
        k_i_q_per_s2: rate of the integral part of the acceleration per rate error.
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
    """Gains of the altitude loop: vertical acceleration from height error."""

    k_z_per_s2: NotNegative
    k_vz_per_s: NotNegative
    k_iz_per_s3: NotNegative
    limit_m_s2: Positive


@dataclass(frozen=True, slots=True, kw_only=True)
class ObserverGains(FiniteTable):
    """Bandwidth of the disturbance observer of eq. (12): 1/s; 0 is no observer."""

    rate_per_s: NotNegative


@dataclass(frozen=True, slots=True, kw_only=True)
class YawGains(FiniteTable):
    """Gains of the yaw loop: angular acceleration from heading error."""

    k_psi_per_s: NotNegative
    k_r_per_s: NotNegative


@dataclass(frozen=True, kw_only=True)
class Gains(FiniteTable):
    """Named gain set of all loops.

    Attributes:
        sources: source of each number by dotted key.
        assumed: dotted keys of the assumed numbers.
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

        For the name of a table ("attitude") the value is a factor on its gains, not on its limits.
        """
        tables = [item.name for item in fields(self) if is_dataclass(getattr(self, item.name))]
        changed: Gains = self
        owner: Any
        for key, value in values.items():
            table, _, name = key.rpartition(".")
            if key in tables:
                owner = getattr(changed, key)
                scaled = {
                    f"{key}.{item.name}": value * getattr(owner, item.name)
                    for item in fields(owner)
                    if item.name.startswith("k_") or item.name == "rate_per_s"
                }
                changed = changed.with_values(**scaled)
                continue
            if table not in tables and key != "control_rate_Hz":
                raise UnknownChoice("table of gains", table or name, [*tables, "control_rate_Hz"])
            owner = getattr(changed, table) if table else changed
            field_names = [item.name for item in fields(owner)]
            if name not in field_names:
                raise UnknownChoice(f"gain of {table}", name, field_names)
            must_be_positive = name in _positive(owner.__class__)
            if not 0.0 <= float(value) < float("inf") or (must_be_positive and not value):
                bound = "above 0" if must_be_positive else "0 or more"
                raise InputError(f"gain {key} is {value}; allowed: finite, {bound}")
            numbers: dict[str, Any] = {name: float(value)}
            changed = replace(changed, **({table: replace(owner, **numbers)} if table else numbers))
        return changed


@lru_cache
def _positive(table: Hashable) -> frozenset[str]:
    """Return the names of the numbers of a table that must be positive."""
    hints = get_type_hints(table, include_extras=True)
    return frozenset(
        name for name, hint in hints.items() if Gt(0.0) in getattr(hint, "__metadata__", ())
    )


def gain_names() -> tuple[str, ...]:
    """Return the names of the gain sets in the library."""
    return list_names("gains")


def load_gains(name_or_path: str | Path) -> Gains:
    """Return a gain set by its name in the library or by the path of its TOML file."""
    return parse_gains(*read_library_file("gain set", "gains", name_or_path))


def parse_gains(text: str, where: str) -> Gains:
    """Return the gain set in TOML text; every number needs a source."""
    data, value_sources = parse_quantities(text, where)
    gains = build_dataclass(Gains, data, where)
    if gains.control_rate_Hz > 1e5:
        raise FileFormatError(
            where, f"control_rate_Hz = {gains.control_rate_Hz:g} is out of range; limit: 100000"
        )
    return replace(gains, sources=value_sources.by_key, assumed=tuple(value_sources.assumed))
