"""Choose a bench and connect to it."""

from __future__ import annotations

from nicegui import run, ui

from benchtool.bench.address import SCHEMES
from benchtool.errors import BenchtoolError
from benchtool.web.bench.start_card import StartCard
from benchtool.web.command_row import CommandRow
from benchtool.web.context import Context
from benchtool.web.desk.asks import Connect, Disconnect, Pace
from benchtool.web.tell import tells_errors

PACES = {1: "as in life", 5: "5 times faster", 20: "20 times faster", 100: "100 times faster"}
"""Speeds of a virtual clock that are offered."""

FIRST = "sim:pquad"
"""Address that stands there at first: needs no hardware."""

PITCH = "mode=pitch&schedule=identify"
"""Behind the address of a simulated bench: on a hinge, its beam moved as explaining likes best."""


class ConnectCard:
    """Offer found ports and simulated rigs, or any address."""

    def __init__(self, context: Context) -> None:
        from benchtool.library import rig_names

        self._context = context
        rigs = list(rig_names())
        with ui.card().classes("w-full"):
            with ui.row().classes("items-end w-full gap-3"):
                self._address = ui.input("Address of the bench", value=FIRST).classes(
                    "grow address"
                )
                self._address.on_value_change(self._show_command)
                with ui.button("Find", icon="search").props("outline"), ui.menu() as self._menu:
                    pass
                self._menu.on("before-show", self._find)
                self._rig = ui.select(
                    {"": "as the address says", **{rig: rig for rig in rigs}}, value="", label="Rig"
                )
                self._rig.classes("w-44").on_value_change(self._show_command)
                self._on = ui.button("Connect", icon="power", on_click=self._connect)
                self._off = ui.button("Disconnect", on_click=self._disconnect).props("outline")
                self._pace = ui.select(PACES, value=1, label="Virtual clock").classes("w-44")
                self._pace.on_value_change(self._set_pace)
            self._why = ui.label().classes("warn-box w-full").mark("why")
            self._command = CommandRow()
        self._start = StartCard()
        self._show_command()
        self.refresh()

    def refresh(self) -> None:
        """Show what is so now."""
        connection, live = self._context.bench.connection, self._context.bench.live
        self._on.set_visibility(connection.status == "off")
        self._off.set_visibility(connection.status != "off")
        self._pace.set_visibility(live.speed > 0.0)
        self._start.set_visibility(connection.status == "off")
        self._why.set_visibility(bool(connection.reason))
        self._why.set_text(connection.reason)

    @tells_errors
    def _connect(self) -> None:
        self._context.need_control()
        address = self._address.value.strip()
        self._pace.value = 1
        self._context.bench.ask(Connect(address=address, rig=self._rig.value))

    @tells_errors
    def _disconnect(self) -> None:
        self._context.need_control()
        self._context.bench.ask(Disconnect())

    @tells_errors
    def _set_pace(self) -> None:
        if self._context.bench.live.speed > 0.0 and self._context.in_control():
            self._context.bench.ask(Pace(float(self._pace.value)))

    def _show_command(self) -> None:
        rig = ["--rig", self._rig.value] if self._rig.value else []
        address = self._address.value.strip()
        # A loop on board would hold against a check that turns one rotor after another.
        check = ["record", address, *rig, "--dry-run"] if "mode=pitch" in address else None
        self._command.show(check or ["bench", "check", address, *rig])

    async def _find(self) -> None:
        from benchtool.bench.ports import serial_ports
        from benchtool.library import rig_named, rig_names

        self._menu.clear()
        try:
            ports = await run.io_bound(serial_ports)
        except BenchtoolError:
            ports = ()
        with self._menu:
            for port in ports or ():
                name = port.by_id or port.name
                self._offer(f"serial:{name}", port.description or "serial port")
            for rig in rig_names():
                self._offer(f"sim:{rig}", "simulated, no motor turns")
                self._offer(f"sim:{rig}?rate=1000", "simulated at 1 kHz")
                if any(rotor.x_m for rotor in rig_named(rig).rotors):
                    self._offer(f"sim:{rig}?{PITCH}", "simulated on a pitch hinge")
            for name, scheme in SCHEMES.items():
                if name not in ("sim", "serial"):
                    self._offer(scheme.example, "an example to change")

    def _offer(self, address: str, what: str) -> None:
        item = ui.menu_item(on_click=lambda: self._address.set_value(address))
        with item, ui.item_section():
            ui.item_label(address)
            ui.item_label(what).props("caption")
