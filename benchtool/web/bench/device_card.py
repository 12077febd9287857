"""Who answers, what it streams, and how good the link is."""

from __future__ import annotations

from nicegui import ui

from benchtool.web.context import Context


class DeviceCard:
    """Show the device and the quality of its link."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._shown = -1
        with ui.card().classes("w-full") as self._card:
            ui.label("Link and device").classes("card-title").props("role=heading aria-level=2")
            self._link = ui.label().classes("number").mark("link")
            self._facts = ui.element("div").classes("facts-grid")
        self.refresh()

    def refresh(self) -> None:
        """Show what is so now."""
        connection, live = self._context.bench.connection, self._context.bench.live
        identity = connection.identity
        self._card.set_visibility(identity is not None)
        if identity is None:
            return
        self._link.set_text(
            f"{live.rate_Hz:.0f} samples/s of {identity.rate_Hz:g}; {live.samples} came, "
            f"{live.lost} lost, {live.corrupt} corrupt"
        )
        self._link.classes(**({"add": "warn"} if live.lost else {"remove": "warn"}))
        if connection.session == self._shown:
            return
        self._shown = connection.session
        self._facts.clear()
        rig = connection.rig
        facts = {
            "device": identity.device_id + (" (virtual)" if identity.simulated else ""),
            "firmware": identity.firmware,
            "protocol": identity.protocol,
            "rig": f"{rig.name}: {rig.title}" if rig else "",
            "plate": "moved by the device" if identity.moves_plate else "not moved by the device",
            "watchdog": f"{1e3 * identity.watchdog_s:.0f} ms",
            "channels": ", ".join(channel.name for channel in identity.channels),
            **{name: text for name, text in identity.facts.items() if name == "warning"},
        }
        with self._facts:
            for name, text in facts.items():
                ui.label(name)
                ui.label(text)
