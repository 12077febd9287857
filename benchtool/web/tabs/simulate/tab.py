"""The Simulate tab: fill in the inputs, simulate with progress, read the report."""

from __future__ import annotations

from collections.abc import Mapping

from nicegui import ui

from benchtool.core.errors import BenchtoolError
from benchtool.core.inputs import build_inputs
from benchtool.core.rig_file import load_rig_by_name, rig_names
from benchtool.core.schedule_file import schedule_names
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.simulate.controllers.laws import FLIGHT_CONTROLLERS, PITCH_CONTROLLERS
from benchtool.simulate.flight.cases import FLIGHTS
from benchtool.simulate.flight.inputs import FlightInputs
from benchtool.simulate.gain_file import gain_names
from benchtool.simulate.pitch.inputs import PitchInputs
from benchtool.web.context import PageContext
from benchtool.web.form import InputForm
from benchtool.web.jobs import Job, PageSection
from benchtool.web.progress import JobProgress
from benchtool.web.tabs.simulate.work import Simulation, command_words, simulate_into
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

ALWAYS = ("duration_s", "seed", "set", "out")  # Fields of every simulation


def _pitch_choices() -> dict[str, Mapping[str, str] | None]:
    """Return the fields of the pitch bench, with what is offered in each; None for typed ones."""
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
    """Return the fields of a flight, as above."""
    # Fewer than four rotors cannot make thrust and three torques.
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
    """Form and report, for one page."""

    def __init__(self, context: PageContext) -> None:
        self._context, self._folder = context, RunsFolder(context.runs)
        self._ready = False
        with titled_card("Simulation"):
            self._kind = ui.toggle([*KINDS], value="pitch bench", on_change=self._changed)
            self._kind.props('no-caps aria-label="What is simulated"')
            choices = (_pitch_choices(), _flight_choices())
            self._forms = dict(zip(KINDS, map(self._form, KINDS, choices), strict=True))
            with ui.row().classes("items-center w-full gap-4"):
                self._simulate = ui.button("Simulate", icon="flight_takeoff", on_click=self._start)
                self._hint = ui.label().classes("soft").props("role=status")
            self._command = CommandRow()
            self._progress: JobProgress[SimulationJob] = JobProgress(
                context, "simulations", "simulation", self._done, self._changed
            )
        self._answer = ui.column().classes("w-full scroll-place")
        context.remember("simulate.kind", self._kind)
        self._ready = True
        self._changed()
        if (latest := self._progress.latest) is not None:
            self._show(latest)

    def _form(
        self, kind: str, fields: Mapping[str, Mapping[str, str] | None]
    ) -> InputForm[Simulation]:
        form: InputForm[Simulation] = InputForm(KINDS[kind], self._changed)
        with ui.element("div").classes("field-grid") as place:
            for name in (*fields, *ALWAYS):
                form.add(name, options=fields.get(name))
        place.bind_visibility_from(self._kind, "value", value=kind)
        return form

    def _inputs(self) -> Simulation:
        """Return what the form describes, with the folder that it will be written to."""
        form = self._forms[self._kind.value]
        given = form.given()
        course = given.get("schedule") or given.get("case")
        free = self._folder.free_path(today(), f"{self._kind.value.partition(' ')[0]}-{course}")
        form.show_empty({"out": free.name})
        out = self._folder.new_path(given["out"]) if given["out"] else free
        numbers = (given["set"] or "").replace(",", " ").split()
        given |= {"out": str(out), "set": numbers or None}
        return build_inputs(KINDS[self._kind.value], given, source="label")

    def _changed(self) -> None:
        """Show the command of the form, or what it lacks."""
        if not self._ready:
            return
        try:
            self._command.show(command_words(self._inputs()))
        except BenchtoolError as error:
            self._hint.set_text(str(error))
            self._simulate.disable()
            return
        self._hint.set_text("")
        self._simulate.set_enabled(not self._progress.watching)

    @show_errors
    def _start(self) -> None:
        self._context.claim_control()
        inputs = self._inputs()
        out = inputs.study.out
        assert out is not None
        self._answer.clear()
        self._progress.start(lambda: Job(out, command_words(inputs), simulate_into, inputs))
        self._changed()

    def _done(self, job: SimulationJob) -> None:
        self._show(job)
        self._answer.run_method("scrollIntoView", {"behavior": "smooth", "block": "start"})

    def _show(self, job: SimulationJob) -> None:
        if job.state.result is None:
            return
        section, recording = job.state.result
        self._answer.clear()
        with self._answer, ui.card().classes("w-full"):
            show_section(section)
            with ui.row().classes("items-center w-full gap-4"):
                ui.label("written to the runs folder; it is listed under Runs").classes("soft")
                if recording:
                    explain = ui.button("Explain", icon="troubleshoot").props("outline")
                    explain.on_click(lambda: open_tab("explain", learn=recording))


def build(context: PageContext) -> None:
    """Make the tab's elements in the present slot."""
    ui.add_head_html(STYLE)
    SimulateTab(context)
