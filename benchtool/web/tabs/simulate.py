"""Simulate tab: form, progress and report."""

from __future__ import annotations

from collections.abc import Mapping

from nicegui import ui

from benchtool.core.inputs import build_inputs
from benchtool.core.rig_file import load_rig_by_name, rig_names
from benchtool.core.schedule import schedule_names
from benchtool.simulate.controllers.laws import FLIGHT_CONTROLLERS, PITCH_CONTROLLERS
from benchtool.simulate.flight.cases import FLIGHTS
from benchtool.simulate.gain_file import gain_names
from benchtool.simulate.inputs import FlightInputs, PitchInputs
from benchtool.web.command_jobs import CommandJob, Simulation
from benchtool.web.command_tab import CommandTab
from benchtool.web.context import PageContext
from benchtool.web.form import InputForm
from benchtool.web.widgets import open_tab, show_section, titled_card, today

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


class SimulateTab(CommandTab):
    """Form and report of one page."""

    label, icon, noun = "Simulate", "flight_takeoff", "simulation"

    def __init__(self, context: PageContext) -> None:
        super().__init__(context)
        with titled_card("Simulation"):
            self._kind = ui.toggle([*KINDS], value="pitch bench", on_change=self.change)
            self._kind.props('no-caps aria-label="Type of simulation"')
            choices = (_pitch_choices(), _flight_choices())
            self._forms = dict(zip(KINDS, map(self._build_form, KINDS, choices), strict=True))
            self.add_controls()
        context.persist("simulate.kind", self._kind)
        self.add_report()

    def _build_form(
        self, kind: str, fields: Mapping[str, Mapping[str, str] | None]
    ) -> InputForm[Simulation]:
        form: InputForm[Simulation] = InputForm(KINDS[kind], self.change)
        with ui.element("div").classes("field-grid") as container:
            for name in (*fields, *COMMON_FIELDS):
                form.add(name, options=fields.get(name))
        container.bind_visibility_from(self._kind, "value", value=kind)
        return form

    def read_form(self) -> tuple[str, Simulation]:
        form = self._forms[self._kind.value]
        values = form.values()
        case = values.get("schedule") or values.get("case")
        free = self.folder.free_path(today(), f"{self._kind.value.partition(' ')[0]}-{case}")
        form.show_defaults({"out": free.name})
        out = self.folder.new_path(values["out"]) if values["out"] else free
        numbers = (values["set"] or "").replace(",", " ").split()
        values |= {"out": str(out), "set": numbers or None}
        return out.name, build_inputs(KINDS[self._kind.value], values, source="label")

    def show_report(self, job: CommandJob) -> None:
        section, recording = job.result()
        with ui.card().classes("w-full"):
            show_section(section)
            with ui.row().classes("items-center w-full gap-4"):
                ui.label("saved in the runs folder; see Runs").classes("soft")
                if recording:
                    explain = ui.button("Explain", icon="troubleshoot").props("outline")
                    explain.on_click(lambda: open_tab("explain", learn=recording))


build = SimulateTab
