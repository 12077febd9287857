"""Simulate tab: form, progress and report."""

from __future__ import annotations

from collections.abc import Mapping

from nicegui import ui

from benchtool.core.errors import BenchtoolError
from benchtool.core.inputs import build_inputs
from benchtool.core.rig_file import load_rig_by_name, rig_names
from benchtool.core.schedule import schedule_names
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.simulate.controllers.laws import FLIGHT_CONTROLLERS, PITCH_CONTROLLERS
from benchtool.simulate.flight.cases import FLIGHTS
from benchtool.simulate.gain_file import gain_names
from benchtool.simulate.inputs import FlightInputs, PitchInputs
from benchtool.web.context import PageContext
from benchtool.web.form import InputForm
from benchtool.web.jobs import Job, PageSection
from benchtool.web.progress import JobProgress
from benchtool.web.tabs.simulate.work import Simulation, command_arguments, simulate_to_folder
from benchtool.web.widgets import (
    STYLE,
    CommandRow,
    open_tab,
    show_errors,
    show_section,
    titled_card,
    today,
)

SimulationJob = Job[tuple[PageSection, str]]

KINDS: dict[str, type[Simulation]] = {"pitch bench": PitchInputs, "flight": FlightInputs}

COMMON_FIELDS = ("duration_s", "seed", "set", "out")


def _pitch_choices() -> dict[str, Mapping[str, str] | None]:
    """Return the fields of the pitch bench with their options; None for a text field."""
    rigs = [
        name for name in rig_names() if any(rotor.x_m for rotor in load_rig_by_name(name).rotors)
    ]
    return {
        "rig": {name: name for name in rigs},
        "schedule": {name: name for name in schedule_names()},
        "controllers": {name: name for name in PITCH_CONTROLLERS},
        "gains": {name: name for name in gain_names()},
    }


def _flight_choices() -> dict[str, Mapping[str, str] | None]:
    """Return the fields of a flight, as `_pitch_choices`."""
    # Thrust and three torques need at least four rotors.
    rigs = [name for name in rig_names() if load_rig_by_name(name).n_rotors >= 4]
    return {
        "case": {name: flight.title for name, flight in FLIGHTS.items()},
        "rig": {name: name for name in rigs},
        "controllers": {name: name for name in FLIGHT_CONTROLLERS},
        "gains": {name: name for name in gain_names()},
        "z_over_r": None,
        "speed_m_s": None,
    }


class SimulateTab:
    """Form and report of one page."""

    def __init__(self, context: PageContext) -> None:
        self._context, self._folder = context, RunsFolder(context.runs)
        self._ready = False
        with titled_card("Simulation"):
            self._kind = ui.toggle([*KINDS], value="pitch bench", on_change=self._changed)
            self._kind.props('no-caps aria-label="Type of simulation"')
            choices = (_pitch_choices(), _flight_choices())
            self._forms = dict(zip(KINDS, map(self._build_form, KINDS, choices), strict=True))
            with ui.row().classes("items-center w-full gap-4"):
                self._simulate = ui.button("Simulate", icon="flight_takeoff", on_click=self._start)
                self._hint = ui.label().classes("soft").props("role=status")
            self._command = CommandRow()
            self._progress: JobProgress[SimulationJob] = JobProgress(
                context, "simulations", "simulation", self._done, self._changed
            )
        self._report = ui.column().classes("w-full scroll-place")
        context.persist("simulate.kind", self._kind)
        self._ready = True
        self._changed()
        if (latest := self._progress.latest) is not None:
            self._show(latest)

    def _build_form(
        self, kind: str, fields: Mapping[str, Mapping[str, str] | None]
    ) -> InputForm[Simulation]:
        form: InputForm[Simulation] = InputForm(KINDS[kind], self._changed)
        with ui.element("div").classes("field-grid") as container:
            for name in (*fields, *COMMON_FIELDS):
                form.add(name, options=fields.get(name))
        container.bind_visibility_from(self._kind, "value", value=kind)
        return form

    def _inputs(self) -> Simulation:
        """Return the inputs of the form with the output folder."""
        form = self._forms[self._kind.value]
        values = form.values()
        case = values.get("schedule") or values.get("case")
        free = self._folder.free_path(today(), f"{self._kind.value.partition(' ')[0]}-{case}")
        form.show_defaults({"out": free.name})
        out = self._folder.new_path(values["out"]) if values["out"] else free
        numbers = (values["set"] or "").replace(",", " ").split()
        values |= {"out": str(out), "set": numbers or None}
        return build_inputs(KINDS[self._kind.value], values, source="label")

    def _changed(self) -> None:
        """Show the form's command or its first error."""
        if not self._ready:
            return
        try:
            self._command.show(command_arguments(self._inputs()))
        except BenchtoolError as error:
            self._hint.set_text(str(error))
            self._simulate.disable()
            return
        self._hint.set_text("")
        self._simulate.set_enabled(not self._progress.is_watching)

    @show_errors
    def _start(self) -> None:
        self._context.claim_control()
        inputs = self._inputs()
        out = inputs.study.out
        assert out is not None
        self._report.clear()
        self._progress.start(
            lambda: Job(out, command_arguments(inputs), simulate_to_folder, inputs)
        )
        self._changed()

    def _done(self, job: SimulationJob) -> None:
        self._show(job)
        self._report.run_method("scrollIntoView", {"behavior": "smooth", "block": "start"})

    def _show(self, job: SimulationJob) -> None:
        if job.state.result is None:
            return
        section, recording = job.state.result
        self._report.clear()
        with self._report, ui.card().classes("w-full"):
            show_section(section)
            with ui.row().classes("items-center w-full gap-4"):
                ui.label("saved in the runs folder; see Runs").classes("soft")
                if recording:
                    explain = ui.button("Explain", icon="troubleshoot").props("outline")
                    explain.on_click(lambda: open_tab("explain", learn=recording))


def build(context: PageContext) -> None:
    """Build the tab in the current slot."""
    ui.add_head_html(STYLE)
    SimulateTab(context)
