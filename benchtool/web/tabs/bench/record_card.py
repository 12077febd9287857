"""Record a pitch experiment: the bench's own controller flies, every sample is stored."""

from __future__ import annotations

from math import radians
from pathlib import Path
from urllib.parse import urlencode

from nicegui import ui

from benchtool.acquire.duration import minutes
from benchtool.acquire.pitch_experiment import (
    NEEDED,
    PitchExperiment,
    arming_text,
    expected_on,
    hover_pulse_us,
)
from benchtool.core.errors import InputError
from benchtool.web.arm_dialog import confirm_arming
from benchtool.web.bench_process.commands import StartRecording
from benchtool.web.context import PageContext
from benchtool.web.notifications import shows_errors
from benchtool.web.widgets import CommandRow, titled_card


class RecordCard:
    """Offer what `benchtool record` does, where the bench streams its pitch."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        self._session = -1
        with titled_card("Pitch recording") as self._card:
            with ui.element("div").classes("field-grid"):
                self._seconds = self._number("Length, s", 40.0)
                self._collective_us = self._number("Collective, us", None)
                self._z_mm = self._number("Plate distance, mm (stays when empty)", None)
                self._limit_deg = self._number("Stop beyond, deg", 45.0)
                self._name = ui.input("Name of the run", value="pitch", on_change=self._show)
                self._name.props("dense stack-label")
            with ui.row().classes("items-center w-full"):
                self._start = ui.button("Record", icon="fiber_manual_record", on_click=self._ask)
                self._explain = ui.button("Explain", icon="troubleshoot", on_click=self._go)
                self._explain.props("outline")
                self._said = ui.label().classes("grow number").props("role=status")
                self._said.mark("recorded")
            self._command = CommandRow()

    def refresh(self) -> None:
        """Show what is so now."""
        connection, sweep = self._context.bench.connection, self._context.bench.sweep
        identity, rig = connection.identity, connection.rig
        names = {channel.name for channel in identity.channels} if identity else set()
        self._card.set_visibility(names.issuperset(NEEDED) and not connection.weighs)
        if identity is not None and rig is not None and connection.session != self._session:
            self._session = connection.session
            self._collective_us.set_value(hover_pulse_us(rig))
            length = identity.facts.get("schedule_s")
            self._seconds.set_value(float(length) if length else self._seconds.value)
        self._start.set_enabled(not sweep.active)
        said = f"{sweep.status}: {sweep.run}"
        if sweep.status == "running":
            said += f", about {minutes(sweep.left_s)} left"
        elif sweep.reason:
            said += f"; {sweep.reason}"
        self._said.set_text(said if sweep.pitch else "")
        self._explain.set_visibility(sweep.pitch and sweep.status == "ended")

    def _number(self, label: str, value: float | None) -> ui.number:
        made = ui.number(label, value=value, format="%.6g", on_change=self._show)
        return made.props("dense stack-label step=any")

    def _experiment(self) -> PitchExperiment:
        """Return what is asked for.

        Raises:
            InputError: a number is missing.
        """
        z_mm = self._z_mm.value
        return PitchExperiment(
            seconds=_given(self._seconds),
            collective_us=_given(self._collective_us),
            plate_z_m=None if z_mm is None else 1e-3 * float(z_mm),
            pitch_limit_rad=radians(_given(self._limit_deg)),
        )

    def _show(self) -> None:
        """Show the command that does the same."""
        connection = self._context.bench.connection
        words = ["record", connection.address or "ADDRESS"]
        if connection.rig is not None and not connection.address.startswith("sim:"):
            words += ["--rig", connection.rig.name]
        numbers = {
            "--seconds": self._seconds.value,
            "--collective": self._collective_us.value,
            "--plate-z-m": None if self._z_mm.value is None else 1e-3 * self._z_mm.value,
            "--limit-deg": self._limit_deg.value,
        }
        for option, value in numbers.items():
            words += [] if value is None else [option, f"{value:.10g}"]
        words += ["--name", self._name.value or "pitch"]
        self._command.show([*words, *self._context.runs_words])

    @shows_errors
    def _ask(self) -> None:
        """Show what will spin, and want a confirmation where a motor turns."""
        self._context.require_control()
        connection = self._context.bench.connection
        identity, rig = connection.identity, connection.rig
        if identity is None or rig is None:
            raise InputError("no bench is connected; connect one first")
        experiment = self._experiment()
        text = arming_text(experiment, rig, expected_on(identity, experiment, rig))
        name = (self._name.value or "").strip() or "pitch"

        def begin(typed: str) -> None:
            runs = self._context.runs
            self._context.bench.send(
                StartRecording(experiment=experiment, runs=runs, name=name, typed=typed)
            )

        confirm_arming(self._context, self._card, text, begin)

    def _go(self) -> None:
        name = Path(self._context.bench.sweep.run).name
        ui.navigate.to(f"/?{urlencode({'tab': 'explain', 'learn': name})}")


def _given(number: ui.number) -> float:
    if number.value is None:
        raise InputError(f"{number.props['label']} is empty; type a number")
    return float(number.value)
