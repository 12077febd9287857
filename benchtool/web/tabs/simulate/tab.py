"""The tab Simulate: the inputs on the left, side views, charts and numbers on the right."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable, Mapping
from contextlib import suppress
from html import escape
from itertools import count
from typing import Any

from nicegui import background_tasks, json, ui
from nicegui.element import Element
from nicegui.elements.echart import EChart as EChart

from benchtool.core.errors import BenchtoolError, InputError
from benchtool.core.inputs import make
from benchtool.core.rig_file import rig_named, rig_names
from benchtool.core.schedule_file import schedule_names
from benchtool.report.palette import BLUE, VERMILION
from benchtool.report.side_view import ADDED_TIMES
from benchtool.simulate.controllers.laws import FLIGHT_CONTROLLERS, PITCH_CONTROLLERS
from benchtool.simulate.flight.cases import FLIGHTS
from benchtool.simulate.flight.inputs import FlightInputs
from benchtool.simulate.gain_file import gain_names
from benchtool.simulate.pitch.inputs import PitchInputs
from benchtool.web.context import PageContext
from benchtool.web.tabs.simulate.save_card import SaveCard
from benchtool.web.tabs.simulate.sliders import (
    Sliders,
    flight_sliders,
    hidden_slider,
    hideable,
    pitch_sliders,
)
from benchtool.web.tabs.simulate.work import LOOKS, Shown, Simulation, simulated
from benchtool.web.theme import STATIC


class SideViews(Element, component=STATIC / "side_views.js"):
    """Show lanes side by side; a change leaves the time where it is."""

    def __init__(self) -> None:
        super().__init__()
        self._sent: Shown | None = None
        self._keys = count(1)
        self.on("ready", self._send, [])

    def show(self, shown: Shown, quick: bool) -> None:
        """Show another simulation; the lines that a quick one lacks stay."""
        self._sent = {**shown, "quick": quick, "key": next(self._keys)}
        self._send()

    def _send(self) -> None:
        if self._sent is not None:
            self.run_method("show", json.dumps(self._sent))


PITCH, FLIGHT = "pitch bench", "flight"

FLOWN_FIRST = ("pid", "observer", "feedforward")
"""Chosen at first for a flight, as the command has them."""

STILL_S = 0.25
"""So long after the last change everything is simulated: also the runs away from any surface, and
the table. A choice."""

FIRST = "simulating; the first time on a machine this compiles, which takes up to a minute"


class SimulateTab:
    """Build the tab for one page."""

    def __init__(self, context: PageContext) -> None:
        self._worker = context.worker("simulations")
        self._changes = asyncio.Event()
        self._drawing, self._whole = False, False
        with ui.element("div").classes("simulate"):
            with ui.card().classes("w-full gap-2"):
                self._show_inputs()
            with ui.column().classes("w-full gap-3 min-w-0"):
                self._show_all(context)
        self._offer()
        self._change()

    # --- inputs ---------------------------------------------------------------------------------

    def _show_inputs(self) -> None:
        self._kind = ui.toggle([PITCH, FLIGHT], value=PITCH, on_change=self._other).props(
            'no-caps spread aria-label="What is simulated"'
        )
        self._kind.classes("w-full")
        with ui.element("div").classes("simulate-choices"):
            self._rig = self._select("Rig", _pitch_rigs(), "pquad")
            self._schedule = self._select("Schedule", schedule_names(), "plate")
            self._length = self._number("Length, s", placeholder="the schedule's own")
            self._case = self._select("Flight", {n: f.title for n, f in FLIGHTS.items()}, "over")
            self._gains = self._select("Gains", gain_names(), "s3")
            controllers = list(PitchInputs().controllers)
            self._controllers = self._select(
                "Controllers", list(PITCH_CONTROLLERS), controllers, multiple=True
            ).props("use-chips")
            self._hidden = self._select("Hidden effect", {"": "none", **hideable()}, "")
            self._hidden.tooltip("what the bench has and its model not, for Explain to find")
            self._seed = self._number("Seed of the noise", value=1, min=0, precision=0)
        self._sliders = Sliders(lambda: self._change(whole=False))
        ui.button("Reset", on_click=self._sliders.reset).props("flat dense")

    def _select(
        self, label: str, options: Iterable[str], value: Any, *, multiple: bool = False
    ) -> ui.select:
        choices = dict(options) if isinstance(options, Mapping) else list(options)
        select = ui.select(
            choices, label=label, value=value, multiple=multiple, on_change=self._other
        )
        return select.props("dense").classes("w-full")

    def _number(self, label: str, **more: Any) -> ui.number:
        number = ui.number(label, on_change=lambda: self._change(), **more)
        return number.props("dense stack-label").classes("w-full")

    def _other(self) -> None:
        self._offer()
        self._change()

    def _offer(self) -> None:
        flying = self._kind.value == FLIGHT
        for each in (self._schedule, self._length, self._hidden):
            each.set_visibility(not flying)
        self._case.set_visibility(flying)
        known = list(FLIGHT_CONTROLLERS if flying else PITCH_CONTROLLERS)
        if list(self._controllers.options) != known:
            first = FLOWN_FIRST if flying else PitchInputs().controllers
            self._rig.set_options(_flying_rigs() if flying else _pitch_rigs(), value="pquad")
            self._controllers.set_options(known, value=list(first))
        if flying:
            self._sliders.offer(flight_sliders(str(self._case.value)))
        else:
            rig, hidden = str(self._rig.value), str(self._hidden.value)
            sliders = pitch_sliders(rig, str(self._schedule.value))
            self._sliders.offer((hidden_slider(rig, hidden), *sliders) if hidden else sliders)

    def inputs(self) -> Simulation:
        """Return what the page simulates now.

        Raises:
            InputError: no controller is chosen, or a number cannot be.
        """
        chosen, settings = self._controllers.value, self._sliders.moved
        if not chosen:
            raise InputError("no controller is chosen; choose one or more")
        given: dict[str, Any] = {
            "rig": self._rig.value,
            "controllers": tuple(name for name in self._controllers.options if name in chosen),
            "gains": (self._gains.value,),
            "seed": int(self._seed.value or 0),
            "set": settings,
        }
        if self._kind.value == PITCH:
            given |= {"schedule": self._schedule.value, "duration_s": self._length.value}
            return make(PitchInputs, given, source="label")
        shipped = FLIGHTS[str(self._case.value)]
        given |= {
            "case": self._case.value,
            "z_over_r": settings.pop("z_over_R", shipped.z_over_R),
            "speed_m_s": settings.pop("speed_m_s", shipped.speed_m_s),
        }
        return make(FlightInputs, given, source="label")

    # --- what is shown --------------------------------------------------------------------------

    def _show_all(self, context: PageContext) -> None:
        with ui.card().classes("w-full gap-2"):
            with ui.row().classes("items-center w-full justify-between"):
                ui.label("SIMULATED: no physical bench").classes("soft")
                self._busy = ui.row().classes("items-center gap-2").props("role=status")
                with self._busy:
                    ui.spinner(size="1.2em")
                    ui.label(FIRST).classes("soft")
            self._wrong = ui.label().classes("warn-box w-full").props("role=alert")
            self._wrong.set_visibility(False)
            self._views = SideViews()
            ui.html(_legend(), sanitize=False).classes("w-full")
        with ui.card().classes("w-full gap-2"):
            ui.label("Numbers").classes("card-title")
            self._table = ui.html(sanitize=False).classes("w-full")
            self._warnings = ui.label().classes("warn whitespace-pre-line")
        self._saving = SaveCard(context, self.inputs)

    def _change(self, whole: bool = True) -> None:
        with suppress(InputError):  # shown where it is drawn
            self._saving.refresh()
        self._whole = self._whole or whole
        self._changes.set()
        if not self._drawing:
            self._drawing = True
            background_tasks.create(self._draw(), name="draw a simulation")

    async def _draw(self) -> None:
        """Draw quickly while sliders move, and everything once they stand still."""
        try:
            while not self._views.is_deleted:
                quick, self._whole = not self._whole, False
                self._changes.clear()
                await self._draw_once(quick)
                if quick:
                    try:
                        await asyncio.wait_for(self._changes.wait(), STILL_S)
                    except TimeoutError:
                        self._whole = True
                elif not self._changes.is_set():
                    return
        finally:
            self._drawing = False

    async def _draw_once(self, quick: bool) -> None:
        try:
            shown = await self._worker.run(simulated, self.inputs(), quick)
        except BenchtoolError as error:
            self._wrong.set_text(str(error))
            self._wrong.set_visibility(True)
            return
        finally:
            self._busy.set_visibility(False)
        self._wrong.set_visibility(False)
        self._views.show(shown, quick)
        if not quick:
            lines = escape("\n".join(shown["lines"]))
            self._table.set_content(f'<pre class="simulate-table" tabindex="0">{lines}</pre>')
            self._warnings.set_text("\n".join(shown["warnings"]))


def _legend() -> str:
    lines = [
        f'<span><i style="border-top-style:{look["dash"]};border-color:{look["color"]}"></i>'
        f"{escape(look['name'])}</span>"
        for look in LOOKS.values()
    ]
    band = '<span><i class="band" style="background:rgba(0,158,115,.3)"></i>over the surface</span>'
    arrows = (
        f'<span><i style="border-color:{BLUE}"></i>arrow: a rotor\'s thrust without it</span>'
        f'<span><i style="border-color:{VERMILION}"></i>on top: what the surface adds, '
        f"{ADDED_TIMES:g} times enlarged</span>"
    )
    return f'<div class="legend">{"".join(lines)}{band}{arrows}</div>'


def _pitch_rigs() -> list[str]:
    """Return rigs that can turn about a hinge."""
    rigs = {name: rig_named(name) for name in rig_names()}
    return [name for name, rig in rigs.items() if any(rotor.x_m for rotor in rig.rotors)]


def _flying_rigs() -> list[str]:
    """Return rigs with four rotors or more: fewer cannot make thrust and three torques."""
    return [name for name in rig_names() if rig_named(name).n_rotors >= 4]


def build(context: PageContext) -> None:
    """Make the tab's elements in the present slot."""
    ui.add_head_html('<link rel="stylesheet" href="/static/simulate.css">')
    SimulateTab(context)
