"""How far the flight claims depend on what the paper does not say: one change of S3 at a time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchtool.commands.paper.claims import Claim, Flights, yes
from benchtool.core.rig import Rig
from benchtool.simulate.flight.vehicle import FlightVehicle
from benchtool.simulate.gain_file import Gains, gains_named

SCATTER = 0.10
"""Joint random change of the seven gains, either way."""

SETS = 9
"""How many random gain sets (as in the notes' study)."""

SEVEN = (
    "position.k_x_per_s", "position.k_v_per_s", "position.k_iv_per_s2",
    "position.integral_limit_m_s2", "attitude.k_theta_per_s", "attitude.k_q_per_s",
    "observer.rate_per_s",
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """Describe one change: factors on gains, gains set, fields of the vehicle, of the case."""

    name: str
    expects: str
    factors: Mapping[str, float]
    vehicle: Mapping[str, Any]
    case: Mapping[str, Any]
    values: Mapping[str, float]
    holds: bool


def _change(
    name: str,
    holds: bool,
    expects: str,
    factors: Mapping[str, float] | None = None,
    values: Mapping[str, float] | None = None,
    vehicle: Mapping[str, Any] | None = None,
    case: Mapping[str, Any] | None = None,
) -> Change:
    return Change(
        name=name,
        expects=expects,
        holds=holds,
        factors=factors or {},
        values=values or {},
        vehicle=vehicle or {},
        case=case or {},
    )


_KEEPS = "still pushed back, and carried over by the observer"
_CROSSES = "PID crosses"

CHANGES = (
    *(
        _change(f"attitude loop stiffer x{f:g}", False, _CROSSES,
                {"attitude.k_theta_per_s": f**0.5, "attitude.k_q_per_s": f**0.5})
        for f in (1.5, 2.0, 3.0)
    ),
    *(
        _change(f"rate integral {k:g} 1/s2", False, _CROSSES,
                values={"attitude.k_i_q_per_s2": k})
        for k in (1.0, 5.0)
    ),
    *(
        _change(f"velocity integral limit x{f:g}", False, _CROSSES,
                {"position.integral_limit_m_s2": f})
        for f in (1.5, 2.0)
    ),
    _change("no velocity integral", True, "stands still before the edge, no repetition",
            values={"position.k_iv_per_s2": 0.0}),
    _change("ramp in place of a speed limit", False, _CROSSES, case={"ramp": True}),
    _change("body term out of the rotors (eq. 3)", False, _CROSSES, vehicle={"K_b": 0.0}),
    _change("b the whole diagonal", True, _KEEPS, vehicle={"body_distance": "diagonal"}),
    *(_change(f"K_b = {k:g}", True, _KEEPS, vehicle={"K_b": k}) for k in (1.5, 2.5)),
    *(
        _change(f"true inertia x{f:g}", True, _KEEPS, vehicle={"inertia_scale": f})
        for f in (0.7, 1.3)
    ),
    *(_change(f"motor lag {1e3 * s:g} ms", True, _KEEPS, vehicle={"lag_s": s})
      for s in (0.02, 0.05)),
    *(_change(f"observer {r:g} 1/s", True, _KEEPS, values={"observer.rate_per_s": r})
      for r in (2.0, 30.0)),
)  # fmt: skip
"""The notes' list (section 3.5) with what its prototype found."""


def sensitivity_claims(flights: Flights) -> list[Claim]:
    """Return one row per change: is the wall still there, does the observer still cross?"""
    base = gains_named("s3")
    rows = [_row(flights, change, _changed(base, change)) for change in CHANGES]
    return [*rows, *(_arm(flights, arm) for arm in (0.20, 0.255)), joint_claim(flights, base)]


def _changed(gains: Gains, change: Change) -> Gains:
    numbers = {key: _number(gains, key) * factor for key, factor in change.factors.items()}
    return gains.with_values(**numbers, **change.values)


def _number(gains: Gains, key: str) -> float:
    table, _, name = key.partition(".")
    return float(getattr(getattr(gains, table), name))


def _row(flights: Flights, change: Change, gains: Gains, rig: Rig | None = None) -> Claim:
    vehicle = FlightVehicle.of_rig(rig or flights.rig, **change.vehicle)
    over = flights.measure("over", gains=gains, vehicle=vehicle, **change.case)
    edge = flights.measure("edge", gains=gains, vehicle=vehicle, **change.case)
    helped = flights.measure("over", "observer", gains=gains, vehicle=vehicle, **change.case)
    there = not over.arrives
    found = (
        f"PID {'never crosses' if there else f'crosses in {over.arrives_s:.1f} s'} "
        f"({over.push_backs} push-backs), swings {edge.swing_m:.2f} m at the edge; observer "
        f"{f'crosses in {helped.arrives_s:.1f} s' if helped.arrives else 'does not cross'}"
    )
    return Claim(
        where="sensitivity",
        says=f"{change.name}: {change.expects}",
        by="study",
        found=found,
        gains="s3, changed",
        verdict=yes(there == change.holds and (helped.arrives or not change.holds)),
    )


def _arm(flights: Flights, arm_m: float) -> Claim:
    rig = flights.rig
    factor = arm_m / max(abs(rotor.x_m) for rotor in rig.rotors)
    rotors = tuple(
        replace(rotor, x_m=factor * rotor.x_m, y_m=factor * rotor.y_m) for rotor in rig.rotors
    )
    change = _change(f"arm {arm_m:g} m", True, _KEEPS)
    return _row(flights, change, gains_named("s3"), replace(rig, rotors=rotors))


def joint_claim(flights: Flights, base: Gains) -> Claim:
    """Return how many of nine random gain sets near S3 keep wall, oscillation and rescue."""
    rng = np.random.default_rng(17)
    kept = 0
    for _ in range(SETS):
        factors = rng.uniform(1.0 - SCATTER, 1.0 + SCATTER, len(SEVEN))
        numbers = {k: _number(base, k) * f for k, f in zip(SEVEN, factors, strict=True)}
        gains = base.with_values(**numbers)
        kept += bool(
            not flights.measure("over", gains=gains).arrives
            and flights.measure("over", speed_m_s=1.0, gains=gains).arrives
            and flights.measure("edge", gains=gains).swing_m > 0.1
            and flights.measure("over", "observer", gains=gains).arrives
            and flights.measure("edge", "observer", gains=gains).swing_m < 0.02
        )
    return Claim(
        where="sensitivity",
        says="all seven gains at once by up to 10 %: 8 of 9 sets keep everything",
        by="study",
        found=f"{kept} of {SETS} random sets keep the wall, its crossing at 1 m/s, the oscillation "
        f"and the observer's rescue of both",
        gains="s3 +-10 %",
        verdict=yes(kept >= 6),
    )
