"""From the options of `benchtool sweep` to a plan."""

from __future__ import annotations

from dataclasses import replace
from math import inf, isfinite
from typing import TYPE_CHECKING, Any

from benchtool.errors import InputError, PlanError, UnknownChoice

if TYPE_CHECKING:
    from benchtool.acquire.air import Air
    from benchtool.acquire.plan import Plan
    from benchtool.core.rig import Rig


def numbers(text: str, option: str, *, above: float | None = None) -> tuple[float, ...]:
    """Return the numbers of an option like `0.5,1,2`; every one finite, and above a bound."""
    try:
        found = tuple(float(part) for part in text.split(",") if part.strip())
    except ValueError:
        raise InputError(
            f"{option} is {text!r}, but numbers between commas are needed, like 0.5,1,2 (decimals "
            f"take a point)"
        ) from None
    if not found:
        raise InputError(f"{option} names no number; write it like 0.5,1,2")
    for number in found:
        if not isfinite(number) or (above is not None and not number > above):
            wanted = "finite" if above is None else f"above {above:g}"
            raise InputError(
                f"{option} is {text!r} and names {number:g}, but every number must be {wanted}; "
                f"correct it (decimals take a point: 0.5, not 0,5)"
            )
    return found


def with_options(plan: Plan, given: dict[str, Any]) -> Plan:
    """Return the plan with what was given on the command line in place of what it says.

    Args:
        plan: from a file, or the standard one.
        given: options by name; None where the user gave nothing.
    """
    present = {name: value for name, value in given.items() if value is not None}
    if "z_m" in present and "z_over_r" in present:
        raise PlanError("--z-m and --z-over-r are both given; give one of them")
    plate, throttle, order = plan.plate, plan.throttle, plan.order
    if "z_m" in present:
        distances_m = numbers(present["z_m"], "--z-m", above=0.0)
        plate = replace(plate, distances_m=distances_m, distances_over_R=())
    if "z_over_r" in present:
        ratios = numbers(present["z_over_r"], "--z-over-r", above=0.0)
        plate = replace(plate, distances_m=(), distances_over_R=ratios)
    if "tilt" in present:
        plate = replace(plate, tilts_deg=numbers(present["tilt"], "--tilt"))
    if "lateral" in present:
        plate = replace(plate, lateral_m=numbers(present["lateral"], "--lateral"))
    if "pwm" in present:
        throttle = replace(throttle, pwm_us=numbers(present["pwm"], "--pwm"))
    if "rotors" in present:
        rotors = numbers(present["rotors"], "--rotors")
        if any(rotor != int(rotor) or rotor < 1 for rotor in rotors):
            raise PlanError(f"--rotors is {present['rotors']!r}; name rotors by number, from 1")
        throttle = replace(throttle, rotors_on=tuple(int(rotor) for rotor in rotors))
    if "order" in present:
        kinds = ("randomised", "counterbalanced", "as_given")
        if present["order"] not in kinds:
            raise UnknownChoice("order", present["order"], kinds)
        order = replace(order, kind=present["order"])
    for option, field in (("seed", "seed"), ("anchor_every", "anchor_every")):
        if option in present:
            order = replace(order, **{field: present[option]})
    own = {name: present[name] for name in ("repeats", "sample_s", "name") if name in present}
    for name, value in own.items():
        if name != "name" and not 0 < value < inf:
            option = name.replace("_", "-")
            raise PlanError(f"--{option} is {value:g}; give a finite number above 0")
    return replace(plan, plate=plate, throttle=throttle, order=order, **own)


def air_of(temperature: float | None, pressure: float | None, humidity: float | None) -> Air:
    """Return the air from degC, hPa and percent; standard values stand where nothing was given."""
    from benchtool.acquire.air import HUMIDITIES, PRESSURES_PA, TEMPERATURES_DEGC, Air

    standard = Air()
    found = []
    for option, value, (low, high), factor, unit, without in (
        ("temperature", temperature, TEMPERATURES_DEGC, 1.0, "degC", standard.temperature_degC),
        ("pressure", pressure, PRESSURES_PA, 100.0, "hPa", standard.pressure_Pa),
        ("humidity", humidity, HUMIDITIES, 0.01, "percent", standard.humidity),
    ):
        if value is not None and not low <= factor * value <= high:
            raise InputError(
                f"--{option} is {value:g} {unit}, outside {low / factor:g} to {high / factor:g} "
                f"{unit}; correct it"
            )
        found.append(without if value is None else factor * value)
    measured = temperature is not None and pressure is not None
    return Air(found[0], found[1], found[2], measured=measured)


def rig_for(address: str, option: str | None) -> Rig:
    """Return the rig on the bench: as given, or the one that a `sim:` address names."""
    from benchtool.bench.address import parse_address
    from benchtool.library import rig_named, rig_names

    if option:
        return rig_named(option)
    parsed = parse_address(address)
    if parsed.scheme == "sim":
        return rig_named(parsed.place)
    raise InputError(
        f"which rig stands on {address}? name it with --rig: {', '.join(rig_names())}, or the "
        f"path of a rig file"
    )
