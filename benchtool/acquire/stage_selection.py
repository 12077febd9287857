"""Selection of the plate stage from `--stage`."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from benchtool.core.errors import InputError

if TYPE_CHECKING:
    from benchtool.bench.drivers import GrblAddress
    from benchtool.bench.guard import GuardedBench
    from benchtool.bench.stage.stage import PlateStage
    from benchtool.core.rig import Rig


def check_stage(option: str | None, *, plate: bool = True) -> GrblAddress | str:
    """Return the parsed `--stage`; raise InputError before a bench is opened."""
    from benchtool.bench.drivers import parse_stage

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
    from benchtool.bench.stage.stage import DeviceStage, HandStage, PlateStage

    default = rig.plate.moved_by if plate else "none"
    name = option or ("device" if bench.identity.moves_plate else default)
    stage = check_stage(name, plate=plate)
    if name == "none":
        return PlateStage()
    if name == "device":
        if not bench.identity.moves_plate:
            raise InputError(
                "this device does not move the plate; give --stage hand or --stage grbl:PORT"
            )
        return DeviceStage(bench, rig.plate)
    if bench.identity.moves_plate:
        raise InputError(
            f"{bench.identity.address} moves the plate, so a second stage is not possible; omit "
            f"--stage {name.partition('?')[0]}"
        )
    if isinstance(stage, str):
        return HandStage(ask, rig.plate, bench)

    def listen(duration_s: float) -> None:
        """Discard samples before the start of the run."""
        bench.read(duration_s)

    from benchtool.bench.stage.grbl import GrblStage
    from benchtool.bench.transport.ports import SerialPort

    port = SerialPort(stage.port, stage.baud)
    return GrblStage(port, stage, rig.plate, bench, listen)
