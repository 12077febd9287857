"""Cards for manual throttle, load cell and plate."""

from __future__ import annotations

from nicegui import ui

from benchtool.acquire.bench_check import low_throttle_us
from benchtool.acquire.inputs import WeighingInputs
from benchtool.acquire.operator import CONFIRMATION
from benchtool.core.errors import InputError
from benchtool.core.inputs import items
from benchtool.core.rig import Limits, Rig
from benchtool.web.bench_process import messages
from benchtool.web.context import PageContext
from benchtool.web.form import InputForm
from benchtool.web.widgets import CommandRow, LocalSlider, show_errors, show_warnings, titled_card


class ThrottleCard:
    """Manual throttle: pulse width, rotors and the button to hold."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        self._displayed: tuple[int, Limits | None] = (-1, None)
        self._rotors: list[ui.checkbox] = []
        with titled_card("Manual throttle") as self._card:
            with ui.row(wrap=False).classes("items-center w-full"):
                self._pulse = ui.number("Pulse, us", value=1000.0, step=10.0, format="%.0f")
                self._pulse.classes("w-28").props("dense")
                self._slider = LocalSlider(min=1000.0, max=2000.0, step=5.0).classes("grow")
                self._slider.props('aria-label="Pulse"').bind_value(self._pulse)
            self._names = ui.row().classes("gap-1")
            self._hold = ui.element("button").classes("hold-button w-full").props("type=button")
            with self._hold:
                self._commanded = ui.label("Hold to turn")
                ui.html('<small class="hold-why" role="status"></small>', sanitize=False)
            self._warnings = ui.column().classes("gap-1")
            with ui.row(wrap=False).classes("items-end w-full") as self._arming:
                self._typed = ui.input(f"Type {CONFIRMATION} to arm").classes("grow")
                ui.button("Arm", on_click=self._arm).props("outline color=warning")
        self._pulse.on_value_change(self._set_hold_data)

    def refresh(self) -> None:
        connection, live = self._context.bench.connection, self._context.bench.live
        identity, rig = connection.identity, connection.rig
        self._card.set_visibility(
            identity is not None and rig is not None and not connection.is_weighing
        )
        if identity is None or rig is None:
            return
        session, limits = self._displayed
        if (connection.session, rig.limits) != (session, limits):
            self._displayed = connection.session, rig.limits
            self._show_rig(rig, is_new=connection.session != session)
            self._warnings.clear()
            with self._warnings:
                show_warnings(identity, rig)
        sweep = self._context.bench.sweep
        is_busy = sweep.active and (sweep.kind, sweep.status) != ("live", "running")
        can_turn = live.armed and not is_busy and self._context.in_control()
        self._hold.props(add="" if can_turn else "disabled", remove="disabled" if can_turn else "")
        self._arming.set_visibility(not live.armed)
        max_command_us = max(live.command_pwm_us, default=0.0)
        is_driven = max_command_us > rig.propulsion.pwm_stop_us
        text = f"{max_command_us:.0f} us commanded" if is_driven else "Hold to turn"
        self._commanded.set_text(text)

    def _show_rig(self, rig: Rig, *, is_new: bool) -> None:
        stop_us = rig.propulsion.pwm_stop_us
        max_us = min(rig.limits.pwm_us, rig.propulsion.pwm_max_us)
        # As numbers: a slider with strings as bounds fails on drag.
        self._slider.props.update(min=stop_us, max=max_us)
        self._slider.update()
        self._pulse.min, self._pulse.max = stop_us, max_us
        self._pulse.props(f'hint="{stop_us:g} to {max_us:g}"')
        if not is_new:
            if (self._pulse.value or 0.0) > max_us:
                self._pulse.value = max_us
                ui.notify(f"pulse lowered to {max_us:g} us, its new limit", position="bottom-left")
            return
        self._pulse.value = low_throttle_us(rig)
        self._names.clear()
        with self._names:
            self._rotors = [
                ui.checkbox(f"{number} {rotor.name}", value=True, on_change=self._set_hold_data)
                for number, rotor in enumerate(rig.rotors, 1)
            ]
        self._set_hold_data()

    def _set_hold_data(self) -> None:
        rotors = [str(i) for i, box in enumerate(self._rotors, 1) if box.value]
        pulse_us = self._pulse.value or 0.0
        self._hold.props(f"data-pulse={pulse_us:.0f} data-rotors={','.join(rotors) or 0}")

    @show_errors
    def _arm(self) -> None:
        self._context.send(messages.ArmMotors(self._typed.value))
        self._typed.value = ""


class LoadCellCard:
    """Preparation of a sweep at standstill: tare, calibration, plate distance."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        send = show_errors(context.send)
        with titled_card("Load cell and plate") as self._card:
            self._scale = ui.label().classes("soft")
            with ui.column().classes("w-full") as self._guarded:
                with ui.row():
                    tare = ui.button("Tare", icon="exposure_zero")
                    tare.on_click(lambda: send(messages.TareLoadCell()))
                    calibrate = ui.button("Calibrate", icon="scale")
                    calibrate.on_click(lambda: self._reconnect(is_weighing=True)).props("outline")
                with ui.row(wrap=False).classes("items-end w-full") as self._plate:
                    self._z_mm = ui.number("Plate distance, mm", value=500.0).classes("grow")
                    ui.button("Move", on_click=self._move).props("outline")
            with ui.column().classes("w-full") as self._weighing_column:
                ui.label(
                    "Hang a mass, wait until it is still and press Weigh; repeat with increasing, "
                    "then decreasing masses. No motor can be commanded."
                )
                with ui.row(wrap=False).classes("items-end w-full"):
                    mass_kg = ui.number("Mass, kg", value=0.0, step=0.1).classes("grow")
                    weigh = ui.button("Weigh", icon="scale")
                    weigh.on_click(lambda: send(messages.WeighMass(float(mass_kg.value or 0.0))))
                self._weighed = ui.label().classes("number").style("white-space: pre-line")
                more = ui.expansion("Operator, masses and their uncertainty")
                with more.classes("w-full").props("dense"), ui.element("div").classes("field-grid"):
                    self._weighing = InputForm(WeighingInputs, lambda: None)
                    self._weighing.add(*(item.name for item in items(WeighingInputs)))
                with ui.row():
                    ui.button(
                        "Store the calibration",
                        on_click=lambda: send(messages.Calibrate(weighing=self._weighing.make())),
                    )
                    restart = ui.button(
                        "Start over", on_click=lambda: send(messages.Calibrate(store=False))
                    )
                    restart.props("outline")
                    finish = ui.button("Done", on_click=lambda: self._reconnect(is_weighing=False))
                    finish.props("outline")
                self._command = CommandRow()
            self._busy = ui.label().classes("soft").props("role=status")

    def refresh(self) -> None:
        connection, live = self._context.bench.connection, self._context.bench.live
        identity = connection.identity
        has_thrust = identity is not None and any(
            channel.name.startswith("thrust") for channel in identity.channels
        )
        self._card.set_visibility(has_thrust)
        if identity is None:
            return
        stored = connection.calibration
        self._scale.set_text(
            f"calibration {stored.id}" if stored else "no calibration; thrust as sent by the device"
        )
        self._guarded.set_visibility(not connection.is_weighing)
        self._weighing_column.set_visibility(connection.is_weighing)
        self._plate.set_visibility(identity.moves_plate)
        self._busy.set_text(live.busy)
        self._weighed.set_text(
            "\n".join(f"{mass:g} kg: {counts:.1f} counts" for mass, counts in live.weighed)
        )
        masses = ",".join(f"{mass:g}" for mass, _ in live.weighed) or "0,0.2,0.5,0.2,0"
        arguments = self._weighing.arguments({})
        self._command.show(["calibrate", connection.address, "--masses", masses, *arguments])

    @show_errors
    def _move(self) -> None:
        if self._z_mm.value is None:
            raise InputError("the plate distance is empty; type one in mm")
        self._context.send(messages.MovePlateTo(1e-3 * float(self._z_mm.value)))

    @show_errors
    def _reconnect(self, *, is_weighing: bool) -> None:
        connection = self._context.bench.connection
        rig = connection.rig.name if connection.rig else ""
        self._context.send(messages.Disconnect())
        self._context.send(
            messages.Connect(address=connection.address, rig=rig, is_weighing=is_weighing)
        )
