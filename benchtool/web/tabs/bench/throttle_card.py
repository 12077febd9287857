"""Turn motors by hand: they turn while a button is held, and no longer."""

from __future__ import annotations

from nicegui import ui

from benchtool.acquire.arming import CONFIRMATION
from benchtool.acquire.bench_check import low_throttle_us
from benchtool.core.rig import Rig
from benchtool.web.arm_dialog import show_warnings
from benchtool.web.bench_process.commands import ArmMotors
from benchtool.web.context import PageContext
from benchtool.web.notifications import shows_errors
from benchtool.web.widgets import LocalSlider, titled_card


class ThrottleCard:
    """Offer a pulse, rotors, and the button that must be held."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        self._shown = -1
        self._rotors: list[ui.checkbox] = []
        with titled_card("Throttle by hand") as self._card:
            self._pulse = ui.number("Pulse, us", value=1000.0, step=10.0, format="%.0f")
            self._pulse.classes("w-full").mark("pulse")
            self._slider = LocalSlider(min=1000.0, max=2000.0, step=5.0)
            self._slider.props('aria-label="Pulse"').bind_value(self._pulse)
            self._names = ui.row().classes("gap-1")
            with ui.row().classes("items-center w-full"):
                self._hold = ui.element("button").classes("hold-button grow").mark("hold")
                self._hold.props("type=button")
                with self._hold:
                    self._said = ui.label("Hold to turn")
                    ui.html('<small class="hold-why" role="status"></small>', sanitize=False)
            self._warnings = ui.column().classes("gap-1")
            with ui.row(wrap=False).classes("items-end w-full") as self._arming:
                self._typed = ui.input(f"Type {CONFIRMATION} to arm").classes("grow")
                ui.button("Arm", on_click=self._arm).props("outline color=warning")
        self._pulse.on_value_change(self._show_pulse)

    def refresh(self) -> None:
        """Show what is so now."""
        connection, live = self._context.bench.connection, self._context.bench.live
        identity, rig = connection.identity, connection.rig
        self._card.set_visibility(
            identity is not None and rig is not None and not connection.weighs
        )
        if identity is None or rig is None:
            return
        if connection.session != self._shown:
            self._shown = connection.session
            self._fit(rig)
            self._warnings.clear()
            with self._warnings:
                show_warnings(identity, rig)
        busy = self._context.bench.sweep.active
        may = live.armed and not busy and self._context.in_control()
        self._hold.props(add="" if may else "disabled", remove="disabled" if may else "")
        self._arming.set_visibility(not live.armed)
        highest = max(live.pulses_us, default=0.0)
        turns = highest > rig.propulsion.pwm_stop_us
        self._said.set_text(f"{highest:.0f} us commanded" if turns else "Hold to turn")

    def _fit(self, rig: Rig) -> None:
        """Offer what this rig has."""
        stop_us = rig.propulsion.pwm_stop_us
        most_us = min(rig.limits.pwm_us, rig.propulsion.pwm_max_us)
        # Not as text: a slider whose bounds are strings fails when it is dragged.
        self._slider.props.update(min=stop_us, max=most_us)
        self._slider.update()
        self._pulse.min, self._pulse.max = stop_us, most_us
        self._pulse.props(f'hint="{stop_us:g} to {most_us:g}"')
        self._pulse.value = low_throttle_us(rig)
        self._names.clear()
        with self._names:
            self._rotors = [
                ui.checkbox(f"{number} {place.name}", value=True, on_change=self._show_pulse)
                for number, place in enumerate(rig.rotors, 1)
            ]
        self._show_pulse()

    def _show_pulse(self) -> None:
        rotors = [str(i) for i, box in enumerate(self._rotors, 1) if box.value]
        pulse_us = self._pulse.value or 0.0
        self._hold.props(f"data-pulse={pulse_us:.0f} data-rotors={','.join(rotors) or 0}")

    @shows_errors
    def _arm(self) -> None:
        self._context.require_control()
        self._context.bench.send(ArmMotors(self._typed.value))
        self._typed.value = ""
