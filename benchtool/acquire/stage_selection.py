"""From `--stage` to what moves the plate."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from benchtool.core.errors import InputError

if TYPE_CHECKING:
    from benchtool.bench.addresses import GrblAddress
    from benchtool.bench.guard import GuardedBench
    from benchtool.bench.stage.stage import Pause, PlateStage
    from benchtool.core.rig import Rig


def check_stage(option: str | None, *, plate: bool = True) -> GrblAddress | str:
    """Return what `--stage` names; refuse what no stage can be, before a bench is opened."""
    from benchtool.bench.addresses import parse_stage

    if option == "none" and plate:
        raise InputError(
            "--stage none moves no plate, but the plan visits plate distances; give --stage hand "
            "or --stage grbl:PORT, or a plan without a plate (--plan steps)"
        )
    return parse_stage(option or "device")


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
        BacklashCompensatedStage,
        DeviceStage,
        FixedStage,
        ManualStage,
        NoStage,
    )

    usual = rig.plate.moved_by if plate else "none"
    chosen = option or ("device" if bench.identity.moves_plate else usual)
    stage = check_stage(chosen, plate=plate)
    if chosen == "none":
        return NoStage()
    if chosen == "device":
        if not bench.identity.moves_plate:
            raise InputError(
                "this device does not move the plate; give --stage hand or --stage grbl:PORT"
            )
        return BacklashCompensatedStage(DeviceStage(bench), rig.plate)
    if bench.identity.moves_plate:
        raise InputError(
            f"{bench.identity.address} moves its own plate, so a second stage would move nothing "
            f"that it measures; leave --stage {chosen.partition('?')[0]} out"
        )
    if isinstance(stage, str):
        return FixedStage(ManualStage(ask, rig.plate), bench)

    def listen(duration_s: float) -> None:
        """Throw away what is measured before the run has begun."""
        bench.read(duration_s)

    return BacklashCompensatedStage(FixedStage(_grbl(stage, rig, listen), bench), rig.plate)


def _grbl(address: GrblAddress, rig: Rig, opening: Pause) -> PlateStage:
    from benchtool.bench.stage.grbl import GrblAxis, GrblStage
    from benchtool.bench.transport.serial_port import SerialPort

    zero_m = rig.plate.z_park_m if address.zero_mm is None else 1e-3 * address.zero_mm
    lateral = address.lateral and GrblAxis(address.lateral, 1e-3 * address.lateral_zero_mm)
    return GrblStage(
        SerialPort(address.port, address.baud),
        GrblAxis(address.axis, zero_m, address.direction),
        rig.plate.speed_m_s,
        lateral,
        rig.plate.z_min_m,
        name=f"the stage on {address.port}",
        opening=opening,
        option=address.text,
    )
