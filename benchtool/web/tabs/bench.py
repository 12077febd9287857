"""Bench tab: connection, live charts, tare, calibration, recordings and manual throttle."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import Any

from nicegui import run, ui

from benchtool.acquire.inputs import RecordInputs, hover_pulse_us
from benchtool.acquire.pitch import REQUIRED_CHANNELS, arming_text, check_experiment
from benchtool.acquire.visit_order import format_duration
from benchtool.bench.drivers import DRIVERS
from benchtool.core.errors import BenchtoolError, InputError
from benchtool.core.inputs import to_arguments, with_changes
from benchtool.core.rig_file import load_rig_by_name
from benchtool.core.text import format_value, pluralize
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.web import widgets
from benchtool.web.bench_process import messages
from benchtool.web.cards.live import AnnotationRow, ChartCard, QuantitiesCard
from benchtool.web.cards.manual import LoadCellCard, ThrottleCard
from benchtool.web.choices import rig_choices
from benchtool.web.context import PageContext
from benchtool.web.form import InputForm, run_name_error

REFRESH_INTERVAL_S = 0.25  # of the numbers

CLOCK_SPEEDS = {1: "real time", 5: "5 times faster", 20: "20 times faster", 100: "100 times faster"}
DEFAULT_ADDRESS = "sim:pquad"  # needs no hardware
PITCH_OPTIONS = "mode=pitch&schedule=identify"  # of a simulated hinge
FIRST_STEPS = (  # shown without a connected bench
    "**Without hardware**: press *Connect*. `sim:pquad` is a simulated quadrotor over a plate; no "
    "real motor turns, and its clock can run up to 100 times faster.",
    "**With a bench on a cable**: press *Find*, select its port and its rig, then press *Connect*. "
    "Motors stay at zero throttle until you type ARM.",
    "**Then**: *Sweep* measures thrust over plate distance and throttle, *Fit* estimates K_b and "
    "the effective radius. *Simulate* and *Explain* need no bench.",
)


class ConnectCard:
    """Selection of found ports, simulated rigs or any address."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        send = widgets.show_errors(context.send)
        with ui.card().classes("w-full") as self._card:
            with ui.row().classes("items-end w-full gap-3"):
                self._address = ui.input("Address of the bench", value=DEFAULT_ADDRESS)
                self._session = 0
                self._address.classes("grow w-96").on_value_change(self._show_command)
                with ui.button("Find", icon="search").props("outline"), ui.menu() as self._menu:
                    # Filled instead of the menu: a late update of the menu would close it.
                    self._addresses = ui.element("div")
                self._menu.on("before-show", self._find)
                rigs = {"": "from the address"} | rig_choices(RunsFolder(context.runs))
                self._rig = ui.select(rigs, value="", label="Rig")
                self._rig.classes("w-44").on_value_change(self._show_command)
                self._on = ui.button("Connect", icon="power", on_click=self._connect)
                self._off = ui.button("Disconnect", on_click=lambda: send(messages.Disconnect()))
                self._off.props("outline")
            self._command = widgets.CommandRow()
        with widgets.titled_card("No bench is connected") as self._help_card:
            ui.markdown("\n".join(f"1. {step}" for step in FIRST_STEPS)).classes("steps")
        self._show_command()

    def refresh(self) -> None:
        connection = self._context.bench.connection
        if connection.status == "off":
            self._context.shows_connection = False
        self._card.set_visibility(connection.status != "on" or self._context.shows_connection)
        self._on.set_visibility(connection.status == "off")
        self._off.set_visibility(connection.status != "off")
        self._help_card.set_visibility(connection.status == "off")
        if connection.status == "on" and connection.session != self._session:
            # A reloaded or watching page shows the connected bench.
            self._session = connection.session
            self._address.set_value(connection.address)
            rig = connection.rig.name if connection.rig is not None else ""
            if rig in self._rig.options and not connection.address.startswith("sim:"):
                self._rig.set_value(rig)

    @widgets.show_errors
    def _connect(self) -> None:
        self._context.require_control()
        self._context.send(
            messages.Connect(address=self._address.value.strip(), rig=self._rig.value)
        )

    def _show_command(self) -> None:
        rig = ["--rig", self._rig.value] if self._rig.value else []
        address = self._address.value.strip()
        # An onboard controller would counteract a check that drives single rotors.
        check = ["record", address, *rig, "--dry-run"] if "mode=pitch" in address else None
        self._command.show(check or ["bench", "check", address, *rig])

    async def _find(self) -> None:
        from benchtool.bench.ports import serial_ports

        self._addresses.clear()
        ports = None
        with suppress(BenchtoolError):
            ports = await run.io_bound(serial_ports)
        with self._addresses:
            for port in ports or ():
                name = port.by_id or port.name
                self._add_address(f"serial:{name}", port.description or "serial port")
            for rig in rig_choices(RunsFolder(self._context.runs)):
                self._add_address(f"sim:{rig}", "simulated, no real motor turns")
                self._add_address(f"sim:{rig}?rate=1000", "simulated at 1 kHz")
                if any(rotor.x_m for rotor in load_rig_by_name(rig).rotors):
                    self._add_address(f"sim:{rig}?{PITCH_OPTIONS}", "simulated on a pitch hinge")
            for name, driver in DRIVERS.items():
                if name not in ("sim", "serial"):
                    self._add_address(driver.address.EXAMPLE, "example, edit before use")
        self._menu.run_method("updatePosition")

    def _add_address(self, address: str, description: str) -> None:
        item = ui.menu_item(on_click=lambda: self._address.set_value(address))
        with item, ui.item_section():
            ui.item_label(address)
            ui.item_label(description).props("caption")


class DeviceCard:
    """Device information, link quality and virtual clock."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        self._session = -1
        with widgets.titled_card("Link and device") as self._card:
            self._link = ui.label().classes("number")
            self._speed = ui.select(CLOCK_SPEEDS, value=1, label="Virtual clock").classes("w-44")
            self._speed.on_value_change(self._set_speed)
            self._facts = ui.element("div").classes("facts-grid")

    def refresh(self) -> None:
        connection, live = self._context.bench.connection, self._context.bench.live
        identity, rig = connection.identity, connection.rig
        self._card.set_visibility(identity is not None)
        if identity is None:
            return
        self._link.set_text(
            f"{live.rate_Hz:.0f} samples/s of {identity.rate_Hz:g}; {live.samples} received, "
            f"{live.lost} lost, {live.corrupt} corrupt"
        )
        self._link.classes(**({"add": "warn"} if live.lost else {"remove": "warn"}))
        self._speed.set_visibility(live.speed > 0.0)
        if connection.session == self._session:
            return
        self._session = connection.session
        self._speed.value = 1
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
        widgets.show_facts(self._facts, facts)

    @widgets.show_errors
    def _set_speed(self) -> None:
        if self._context.bench.live.speed > 0.0 and self._context.in_control():
            self._context.bench.send(messages.SetClockSpeed(float(self._speed.value)))


def build(context: PageContext) -> None:
    """Build the tab."""
    cards: list[Any] = [ConnectCard(context)]
    with ui.element("div").classes("grid-main"):
        with ui.element("div"):
            cards.append(ChartCard(context))
        with ui.element("div"):
            cards += [ThrottleCard(context), LiveRecordCard(context), RecordCard(context)]
            cards += [QuantitiesCard(context), LoadCellCard(context), DeviceCard(context)]
    widgets.refresh_cards(REFRESH_INTERVAL_S, *cards)


LIVE_HINT = (
    "Stores every sample in a run, which starts with a tare. A constant throttle gives a point "
    "every two seconds once it has settled."
)


class LiveRecordCard:
    """Recording of the live stream under manual throttle."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        send = widgets.show_errors(context.send)
        with widgets.titled_card("Live recording") as self._card:
            with ui.row().classes("items-end w-full"):
                name = ui.input("Name of the run", value="live", validation=run_name_error)
                name.props("dense").classes("grow")
                self._start = ui.button("Record", icon="fiber_manual_record")
                self._start.on_click(
                    lambda: send(
                        messages.StartLiveRecording(runs=context.runs, name=name.value.strip())
                    )
                )
                self._end = ui.button(
                    "End", icon="save", on_click=lambda: send(messages.EndRecording())
                )
                self._show = ui.button("Show", icon="folder_open").props("outline")
                self._show.on_click(lambda: widgets.open_tab("runs", run=context.bench.sweep.name))
            self._annotation = AnnotationRow(context, "live")
            self._status = ui.label().classes("number soft").props("role=status")

    def refresh(self) -> None:
        self._annotation.refresh()
        connection, sweep = self._context.bench.connection, self._context.bench.sweep
        is_live = sweep.kind == "live" and sweep.status != "none"
        channels = connection.identity.channels if connection.identity else ()
        has_thrust = any(channel.name == "thrust_N" for channel in channels)
        self._card.set_visibility(has_thrust and not connection.is_weighing)
        self._start.set_visibility(not sweep.active)
        self._end.set_visibility(is_live and sweep.status == "running")
        self._show.set_visibility(is_live and not sweep.active)
        points = pluralize(sweep.n_measured, "point")
        text = f"{sweep.status}: {sweep.name}, {sweep.reason or points}"
        self._status.set_text(text if is_live else LIVE_HINT)


class RecordCard:
    """Pitch recording as `benchtool record`, if the bench streams its pitch."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        self._session = -1
        self._base = RecordInputs(address="ADDRESS", runs=context.runs)
        self._form = InputForm(RecordInputs, self._show_command)
        with widgets.titled_card("Pitch recording") as self._card:
            with ui.element("div").classes("field-grid"):
                self._form.add("seconds", "collective", "plate_z_m", "limit_deg", "name")
            with ui.row().classes("items-center w-full"):
                self._start = ui.button("Record", icon="fiber_manual_record", on_click=self._arm)
                self._explain = ui.button("Explain", icon="troubleshoot").props("outline")
                self._explain.on_click(
                    lambda: widgets.open_tab("explain", learn=context.bench.sweep.name)
                )
                self._status = ui.label().classes("grow number").props("role=status")
            self._command = widgets.CommandRow()

    def refresh(self) -> None:
        connection, sweep = self._context.bench.connection, self._context.bench.sweep
        identity, rig = connection.identity, connection.rig
        names = {channel.name for channel in identity.channels} if identity else set()
        self._card.set_visibility(
            names.issuperset(REQUIRED_CHANNELS) and not connection.is_weighing
        )
        if identity is not None and rig is not None and connection.session != self._session:
            self._session = connection.session
            duration_s = float(identity.facts.get("schedule_s") or self._base.seconds)
            rig_name = None if connection.address.startswith("sim:") else rig.name
            self._base = replace(
                self._base, address=connection.address, rig=rig_name, seconds=duration_s
            )
            hover_us = f"{hover_pulse_us(rig):.6g}"
            defaults = {"seconds": format_value(duration_s), "collective": hover_us}
            self._form.show_defaults(defaults)
            self._show_command()
        self._start.set_enabled(not sweep.active)
        status = f"{sweep.status}: {sweep.run}"
        if sweep.status == "running":
            status += f", about {format_duration(sweep.remaining_s)} left"
        elif sweep.reason:
            status += f"; {sweep.reason}"
        self._status.set_text(status if sweep.kind == "pitch" else "")
        self._explain.set_visibility(sweep.kind == "pitch" and sweep.status == "ended")

    def _show_command(self) -> None:
        with suppress(InputError):  # the start of the recording reports it
            inputs = with_changes(self._form.make(self._base))
            self._command.show(["record", *to_arguments(RecordInputs, inputs)])

    @widgets.show_errors
    def _arm(self) -> None:
        self._context.require_control()
        connection = self._context.bench.connection
        identity, rig = connection.identity, connection.rig
        if identity is None or rig is None:
            raise InputError("no bench is connected; connect one first")
        inputs = self._form.make(self._base)
        text = arming_text(inputs, rig, check_experiment(inputs, rig, identity))
        widgets.confirm_arming(self._context, self._card, text, inputs)
