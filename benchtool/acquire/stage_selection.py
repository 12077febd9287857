"""Selection of the plate stage from `--stage`."""

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
    """Return the parsed `--stage`; raise InputError before a bench is opened."""
    from benchtool.bench.addresses import parse_stage

    if option == "none" and plate:
        raise InputError(
            "--stage none cannot move the plate, but the plan has plate distances; use "
            "--stage hand, --stage grbl:PORT, or a plan without a plate (--plan steps)"
        )
    return parse_stage(option or "device")


def select_stage(
    option: str | None,
    bench: GuardedBench,
    rig: Rig,
    ask: Callable[[str], str],
    *,
    plate: bool = True,
) -> PlateStage:
    """Return the plate stage, not yet open.

    Args:
        option: `device`, `hand`, `none` (plan without a plate), or
            `grbl:PORT?axis=Z&zero_mm=1500&direction=1`; default: from device and rig.
        plate: whether the plan has plate distances; if not, only the device can move the plate.
    """
    from benchtool.bench.stage.stage import (
        BacklashCompensatedStage,
        DeviceStage,
        GuardedStage,
        ManualStage,
        NoStage,
    )

    default = rig.plate.moved_by if plate else "none"
    name = option or ("device" if bench.identity.moves_plate else default)
    stage = check_stage(name, plate=plate)
    if name == "none":
        return NoStage()
    if name == "device":
        if not bench.identity.moves_plate:
            raise InputError(
                "this device does not move the plate; give --stage hand or --stage grbl:PORT"
            )
        return BacklashCompensatedStage(DeviceStage(bench), rig.plate)
    if bench.identity.moves_plate:
        raise InputError(
            f"{bench.identity.address} moves the plate, so a second stage is not possible; omit "
            f"--stage {name.partition('?')[0]}"
        )
    if isinstance(stage, str):
        return GuardedStage(ManualStage(ask, rig.plate), bench)

    def listen(duration_s: float) -> None:
        """Discard samples before the start of the run."""
        bench.read(duration_s)

    return BacklashCompensatedStage(GuardedStage(_grbl(stage, rig, listen), bench), rig.plate)


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
        homing_pause=opening,
        option=address.text,
    )
