"""The Bench tab: connect, see it live, tare, turn motors by hand."""

from __future__ import annotations

from nicegui import ui

from benchtool.web.command_row import CommandRow
from benchtool.web.context import Context
from benchtool.web.desk.asks import Connect, Disconnect
from benchtool.web.tab import Tab
from benchtool.web.tell import tells_errors


def build(context: Context) -> None:
    """Make the tab."""

    @tells_errors
    def connect() -> None:
        context.need_control()
        context.bench.ask(Connect(address=address.value.strip()))

    @tells_errors
    def disconnect() -> None:
        context.need_control()
        context.bench.ask(Disconnect())

    with ui.card().classes("w-full"):
        address = ui.input("Address", value="sim:pquad").classes("w-full").mark("address")
        with ui.row():
            ui.button("Connect", on_click=connect)
            ui.button("Disconnect", on_click=disconnect).props("outline")
        CommandRow(["bench", "check", "sim:pquad"])


TAB = Tab(name="Bench", icon="speed", build=build)
