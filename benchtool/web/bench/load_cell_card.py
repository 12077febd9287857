"""Tare, move the plate, calibrate with known masses."""

from __future__ import annotations

from nicegui import ui

from benchtool.errors import InputError
from benchtool.web.command_row import CommandRow
from benchtool.web.context import Context
from benchtool.web.desk.asks import Calibrate, Connect, Disconnect, MovePlate, Tare, Weigh
from benchtool.web.tell import tells_errors


class LoadCellCard:
    """Offer what is done before a sweep, motors standing."""

    def __init__(self, context: Context) -> None:
        self._context = context
        with ui.card().classes("w-full") as self._card:
            ui.label("Load cell and plate").classes("card-title").props("role=heading aria-level=2")
            self._scale = ui.label().classes("soft")
            with ui.column().classes("w-full") as self._guarded:
                with ui.row():
                    ui.button("Tare", icon="exposure_zero", on_click=self._tare)
                    ui.button("Calibrate", icon="scale", on_click=self._begin).props("outline")
                with ui.row(wrap=False).classes("items-end w-full") as self._plate:
                    self._z_mm = ui.number("Plate distance, mm", value=500.0)
                    self._z_mm.classes("grow")
                    ui.button("Move", on_click=self._move).props("outline")
            with ui.column().classes("w-full") as self._weighs:
                ui.label(
                    "Hang a mass, wait until it is still, press Weigh; then the next, up and down "
                    "again. No motor can turn meanwhile."
                )
                with ui.row(wrap=False).classes("items-end w-full"):
                    self._mass_kg = ui.number("Mass, kg", value=0.0, step=0.1)
                    self._mass_kg.classes("grow")
                    ui.button("Weigh", icon="scale", on_click=self._weigh)
                self._weighed = ui.label().classes("number").style("white-space: pre-line")
                with ui.row():
                    ui.button("Keep the line", on_click=lambda: self._calibrate(keep=True))
                    ui.button("Begin anew", on_click=lambda: self._calibrate(keep=False)).props(
                        "outline"
                    )
                    ui.button("Done", on_click=self._done).props("outline")
                self._command = CommandRow()
            self._busy = ui.label().classes("soft").props("role=status")
        self.refresh()

    def refresh(self) -> None:
        """Show what is so now."""
        connection, live = self._context.bench.connection, self._context.bench.live
        identity = connection.identity
        streams = identity is not None and any(
            channel.name.startswith("thrust") for channel in identity.channels
        )
        self._card.set_visibility(streams)
        if identity is None:
            return
        kept = connection.calibration
        self._scale.set_text(f"calibration {kept.id}" if kept else "the device's own newtons")
        self._guarded.set_visibility(not connection.weighs)
        self._weighs.set_visibility(connection.weighs)
        self._plate.set_visibility(identity.moves_plate)
        self._busy.set_text(live.busy)
        self._weighed.set_text(
            "\n".join(f"{mass:g} kg: {counts:.1f} counts" for mass, counts in live.weighed)
        )
        masses = ",".join(f"{mass:g}" for mass, _ in live.weighed) or "0,0.2,0.5,0.2,0"
        self._command.show(["calibrate", connection.address, "--masses", masses])

    @tells_errors
    def _tare(self) -> None:
        self._context.need_control()
        self._context.bench.ask(Tare())

    @tells_errors
    def _move(self) -> None:
        self._context.need_control()
        if self._z_mm.value is None:
            raise InputError("no plate distance was given; type one in mm")
        self._context.bench.ask(MovePlate(1e-3 * float(self._z_mm.value)))

    @tells_errors
    def _begin(self) -> None:
        self._reconnect(weighs=True)

    @tells_errors
    def _done(self) -> None:
        self._reconnect(weighs=False)

    def _reconnect(self, *, weighs: bool) -> None:
        self._context.need_control()
        connection = self._context.bench.connection
        rig = connection.rig.name if connection.rig else ""
        self._context.bench.ask(Disconnect())
        self._context.bench.ask(Connect(address=connection.address, rig=rig, weighs=weighs))

    @tells_errors
    def _weigh(self) -> None:
        self._context.need_control()
        self._context.bench.ask(Weigh(float(self._mass_kg.value or 0.0)))

    @tells_errors
    def _calibrate(self, *, keep: bool) -> None:
        self._context.need_control()
        self._context.bench.ask(Calibrate(keep=keep))
