"""Tare, move the plate, calibrate with known masses."""

from __future__ import annotations

from nicegui import ui

from benchtool.core.errors import InputError
from benchtool.web.bench_process.commands import (
    Calibrate,
    Connect,
    Disconnect,
    MovePlateTo,
    TareLoadCell,
    WeighMass,
)
from benchtool.web.context import PageContext
from benchtool.web.notifications import shows_errors
from benchtool.web.widgets import CommandRow, titled_card


class LoadCellCard:
    """Offer what is done before a sweep, motors standing."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        with titled_card("Load cell and plate") as self._card:
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
                    ui.button("Store the calibration", on_click=lambda: self._calibrate(store=True))
                    ui.button("Start over", on_click=lambda: self._calibrate(store=False)).props(
                        "outline"
                    )
                    ui.button("Done", on_click=self._done).props("outline")
                self._command = CommandRow()
            self._busy = ui.label().classes("soft").props("role=status")

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
        stored = connection.calibration
        self._scale.set_text(f"calibration {stored.id}" if stored else "the device's own newtons")
        self._guarded.set_visibility(not connection.weighs)
        self._weighs.set_visibility(connection.weighs)
        self._plate.set_visibility(identity.moves_plate)
        self._busy.set_text(live.busy)
        self._weighed.set_text(
            "\n".join(f"{mass:g} kg: {counts:.1f} counts" for mass, counts in live.weighed)
        )
        masses = ",".join(f"{mass:g}" for mass, _ in live.weighed) or "0,0.2,0.5,0.2,0"
        self._command.show(["calibrate", connection.address, "--masses", masses])

    @shows_errors
    def _tare(self) -> None:
        self._context.require_control()
        self._context.bench.send(TareLoadCell())

    @shows_errors
    def _move(self) -> None:
        self._context.require_control()
        if self._z_mm.value is None:
            raise InputError("no plate distance was given; type one in mm")
        self._context.bench.send(MovePlateTo(1e-3 * float(self._z_mm.value)))

    @shows_errors
    def _begin(self) -> None:
        self._reconnect(weighs=True)

    @shows_errors
    def _done(self) -> None:
        self._reconnect(weighs=False)

    def _reconnect(self, *, weighs: bool) -> None:
        self._context.require_control()
        connection = self._context.bench.connection
        rig = connection.rig.name if connection.rig else ""
        self._context.bench.send(Disconnect())
        self._context.bench.send(Connect(address=connection.address, rig=rig, weighs=weighs))

    @shows_errors
    def _weigh(self) -> None:
        self._context.require_control()
        self._context.bench.send(WeighMass(float(self._mass_kg.value or 0.0)))

    @shows_errors
    def _calibrate(self, *, store: bool) -> None:
        self._context.require_control()
        self._context.bench.send(Calibrate(store=store))
