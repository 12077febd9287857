"""From `--stage` to what moves the plate."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite, nan
from typing import TYPE_CHECKING
from urllib.parse import parse_qsl

from benchtool.core.errors import InputError, UnknownChoice

if TYPE_CHECKING:
    from benchtool.bench.guard import GuardedBench
    from benchtool.bench.stage.stage import Pause, PlateStage
    from benchtool.core.rig import Rig

_GRBL_OPTIONS = ("baud", "axis", "zero_mm", "direction", "lateral", "lateral_zero_mm")


def check_stage(option: str | None, rig: Rig, *, plate: bool = True) -> None:
    """Refuse what no `--stage` can be, before a bench is opened."""
    scheme, _, place = (option or "device").partition(":")
    if scheme == "grbl" and place:
        _grbl(place, rig)
    elif scheme == "grbl":
        raise InputError("the stage's port is missing; give --stage grbl:PORT?axis=Z&zero_mm=...")
    elif option == "none" and plate:
        raise InputError(
            "--stage none moves no plate, but the plan visits plate distances; give --stage hand "
            "or --stage grbl:PORT, or a plan without a plate (--plan steps)"
        )
    elif option not in (None, "device", "hand", "none"):
        raise UnknownChoice("stage", str(option), ("device", "hand", "grbl:PORT", "none"))


def stage_for(
    option: str | None,
    bench: GuardedBench,
    rig: Rig,
    ask: Callable[[str], str],
    *,
    plate: bool = True,
) -> PlateStage:
    """Return what moves the plate, not opened yet.

    Args:
        option: `device`, `hand`, or `grbl:PORT?axis=Z&zero_mm=1500&direction=1`; what the device
            and the rig say when left out; `none`, of a plan without a plate, moves nothing.
        plate: whether the plan visits plate distances; without, only a bench that moves its own
            plate moves one.
    """
    from benchtool.bench.stage.stage import (
        DeviceStage,
        HandStage,
        IdleStage,
        NoStage,
        OneSidedStage,
    )

    usual = rig.plate.moved_by if plate else "none"
    chosen = option or ("device" if bench.identity.moves_plate else usual)
    check_stage(chosen, rig, plate=plate)
    if chosen == "none":
        return NoStage()
    if chosen == "device":
        if not bench.identity.moves_plate:
            raise InputError(
                "this device does not move the plate; give --stage hand or --stage grbl:PORT"
            )
        return OneSidedStage(DeviceStage(bench), rig.plate)
    if bench.identity.moves_plate:
        raise InputError(
            f"{bench.identity.address} moves its own plate, so a second stage would move nothing "
            f"that it measures; leave --stage {chosen.partition('?')[0]} out"
        )
    if chosen == "hand":
        return IdleStage(HandStage(ask, rig.plate), bench)
    place = chosen.partition(":")[2]

    def listen(duration_s: float) -> None:
        """Throw away what is measured before the run has begun."""
        bench.read(duration_s)

    return OneSidedStage(IdleStage(_grbl(place, rig, listen), bench), rig.plate)


def _grbl(place: str, rig: Rig, opening: Pause = lambda duration_s: None) -> PlateStage:
    from benchtool.bench.stage.grbl import GrblAxis, GrblStage
    from benchtool.bench.transport.serial_port import SerialPort

    port, _, query = place.partition("?")
    options = dict(parse_qsl(query))
    for name in options:
        if name not in _GRBL_OPTIONS:
            raise UnknownChoice("option of grbl: stages", name, _GRBL_OPTIONS)

    def number(name: str, default: float) -> float:
        try:
            value = float(options.get(name, default))
        except ValueError:
            value = nan
        if not isfinite(value):
            raise InputError(
                f"option {name} of --stage is {options[name]!r}, not a number; write "
                f"{name}={default:g}"
            )
        return value

    direction = -1 if number("direction", 1.0) < 0.0 else 1
    distance = GrblAxis(
        options.get("axis", "Z"), 1e-3 * number("zero_mm", 1e3 * rig.plate.z_park_m), direction
    )
    lateral = None
    if "lateral" in options:
        lateral = GrblAxis(options["lateral"], 1e-3 * number("lateral_zero_mm", 0.0))
    return GrblStage(
        SerialPort(port, int(number("baud", 115200))),
        distance,
        rig.plate.speed_m_s,
        lateral,
        rig.plate.z_min_m,
        name=f"the stage on {port}",
        opening=opening,
        option=f"grbl:{place}",
    )
