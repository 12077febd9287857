"""A virtual bench whose plate hangs on a virtual G-code stage beside it."""

from __future__ import annotations

from dataclasses import replace

from benchtool.core.rig import PlateStage
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.grbl import VirtualGrbl
from benchtool.virtual.served_device import ServedDevice
from benchtool.virtual.server_links import ServerLink


class CarriedPlate:
    """Be another served device, its plate carried by the Z axis of a stage on a link of its own.

    The home switch is at the far end: Z at 0 is the greatest distance.

    Args:
        device: the bench.
        firmware: of the bench.
        link: of the stage.
        plate: travel and where it is parked.
    """

    def __init__(
        self, device: ServedDevice, firmware: Firmware, link: ServerLink, plate: PlateStage
    ) -> None:
        self._device, self._firmware, self._link, self._plate = device, firmware, link, plate
        firmware.hello = replace(firmware.hello, moves_plate=False)
        travel_mm = dict.fromkeys("XYZ", 1e3 * plate.z_max_m)
        self._stage = VirtualGrbl(travel_mm, 1e3 * (plate.z_park_m - plate.z_max_m))

    @property
    def speed(self) -> float:
        """Device seconds per wall second, of the stage as well."""
        return self._device.speed

    @property
    def greeted_s(self) -> float | None:
        """Wall time at which the present host came, None before any."""
        return self._device.greeted_s

    def receive(self, data: bytes, now_s: float) -> bytes:
        return self._device.receive(data, now_s)

    def tick(self, n: int, now_s: float) -> tuple[bytes, list[bytes]]:
        self._link.write(self._stage.step(self._link.read(), now_s * self.speed))
        self._firmware.carry_plate(self._plate.z_max_m + 1e-3 * self._stage.true_mm["Z"])
        return self._device.tick(n, now_s)

    def tell_dropped(self, count: int) -> bytes:
        return self._device.tell_dropped(count)


def stage_option(path: str, plate: PlateStage) -> str:
    """Return the `--stage` of a host for the stage at a path."""
    return f"grbl:{path}?axis=Z&zero_mm={1e3 * plate.z_max_m:g}&direction=1"
