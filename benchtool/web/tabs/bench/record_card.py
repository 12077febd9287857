"""Cards for recordings: under manual throttle, or of a pitch experiment."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from nicegui import ui

from benchtool.acquire.inputs import RecordInputs, hover_pulse_us
from benchtool.acquire.pitch import REQUIRED_CHANNELS, arming_text, check_experiment
from benchtool.acquire.visit_order import format_duration
from benchtool.core.errors import InputError
from benchtool.core.inputs import to_arguments, with_changes
from benchtool.core.text import format_value, pluralize
from benchtool.web.bench_process.messages import EndRecording, StartLiveRecording, StartRun
from benchtool.web.context import PageContext
from benchtool.web.form import InputForm
from benchtool.web.widgets import CommandRow, confirm_arming, open_tab, show_errors, titled_card

LIVE_HINT = (
    "Stores every sample in a run, which starts with a tare. A constant throttle gives a point "
    "every two seconds once it has settled."
)


class LiveRecordCard:
    """Recording of the live stream under manual throttle."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        with titled_card("Live recording") as self._card:
            with ui.row().classes("items-end w-full"):
                self._name = ui.input("Name of the run", value="live").classes("grow")
                self._start = ui.button("Record", icon="fiber_manual_record", on_click=self._record)
                self._end = ui.button("End", icon="save", on_click=self._finish)
                self._show = ui.button("Show", icon="folder_open", on_click=self._open)
                self._show.props("outline")
            self._status = ui.label().classes("number").props("role=status")

    def refresh(self) -> None:
        connection, sweep = self._context.bench.connection, self._context.bench.sweep
        is_live = sweep.kind == "live" and sweep.status != "none"
        channels = connection.identity.channels if connection.identity else ()
        has_thrust = any(channel.name == "thrust_N" for channel in channels)
        self._card.set_visibility(has_thrust and not connection.is_weighing)
        self._start.set_visibility(not sweep.active)
        self._end.set_visibility(is_live and sweep.status == "running")
        self._show.set_visibility(is_live and not sweep.active)
        points = pluralize(sweep.n_measured, "point")
        text = f"{sweep.status}: {Path(sweep.run).name}, {sweep.reason or points}"
        self._status.set_text(text if is_live else LIVE_HINT)

    @show_errors
    def _record(self) -> None:
        name = self._name.value.strip()
        self._context.send(StartLiveRecording(runs=self._context.runs, name=name))

    @show_errors
    def _finish(self) -> None:
        self._context.send(EndRecording())

    def _open(self) -> None:
        open_tab("runs", run=Path(self._context.bench.sweep.run).name)


class RecordCard:
    """Pitch recording as `benchtool record`, if the bench streams its pitch."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        self._session = -1
        self._base = RecordInputs(address="ADDRESS", runs=context.runs)
        self._form = InputForm(RecordInputs, self._show_command)
        with titled_card("Pitch recording") as self._card:
            with ui.element("div").classes("field-grid"):
                self._form.add("seconds", "collective", "plate_z_m", "limit_deg", "name")
            with ui.row().classes("items-center w-full"):
                self._start = ui.button("Record", icon="fiber_manual_record", on_click=self._arm)
                self._explain = ui.button(
                    "Explain", icon="troubleshoot", on_click=self._open_explain
                )
                self._explain.props("outline")
                self._status = ui.label().classes("grow number").props("role=status")
            self._command = CommandRow()

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

    @show_errors
    def _arm(self) -> None:
        self._context.require_control()
        connection = self._context.bench.connection
        identity, rig = connection.identity, connection.rig
        if identity is None or rig is None:
            raise InputError("no bench is connected; connect one first")
        inputs = self._form.make(self._base)
        text = arming_text(inputs, rig, check_experiment(inputs, rig, identity))

        def start(typed: str, needs_page: bool) -> None:
            self._context.bench.send(StartRun(inputs, typed, needs_page))

        confirm_arming(self._context, self._card, text, start)

    def _open_explain(self) -> None:
        open_tab("explain", learn=Path(self._context.bench.sweep.run).name)
