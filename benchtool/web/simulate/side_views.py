"""The element with the side views: the server draws, the browser moves what is drawn."""

from __future__ import annotations

from itertools import count

from nicegui import json
from nicegui.element import Element

# Its import map entry is what the element's own script imports ECharts by.
from nicegui.elements.echart import EChart as EChart

from benchtool.web.simulate.shown import Shown
from benchtool.web.theme import STATIC


class SideViews(Element, component=STATIC / "side_views.js"):
    """Show lanes side by side; a change leaves the time where it is."""

    def __init__(self) -> None:
        super().__init__()
        self._sent: Shown | None = None
        self._keys = count(1)
        self.on("ready", self._send, [])

    def show(self, shown: Shown, quick: bool) -> None:
        """Show another simulation; a quick one keeps the lines that it lacks."""
        self._sent = {**shown, "quick": quick, "key": next(self._keys)}
        self._send()

    def _send(self) -> None:
        if self._sent is not None:
            self.run_method("show", json.dumps(self._sent))
