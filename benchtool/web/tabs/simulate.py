"""Simulate tab: form, progress and report."""

from __future__ import annotations

from collections.abc import Mapping

from nicegui import ui

from benchtool.core.inputs import build_inputs
from benchtool.core.rig_file import load_rig_by_name, rig_names
from benchtool.core.user_file import list_names
from benchtool.simulate.controllers.laws import FLIGHT_CONTROLLERS, PITCH_CONTROLLERS
from benchtool.simulate.flight.cases import FLIGHTS
from benchtool.simulate.gain_file import gain_names
from benchtool.simulate.inputs import FlightInputs, PitchInputs
from benchtool.web.command_jobs import CommandJob, Simulation
from benchtool.web.command_tab import CommandTab
from benchtool.web.context import PageContext
from benchtool.web.form import InputForm, Options
from benchtool.web.widgets import open_tab, show_section, show_title, titled_card, today

KINDS: dict[str, type[Simulation]] = {"pitch bench": PitchInputs, "flight": FlightInputs}


def _choices() -> dict[str, dict[str, Options | None]]:
    """Return the fields of each kind with their options; None for a text field."""
    rigs = {name: load_rig_by_name(name).rotors for name in rig_names()}
    common = dict.fromkeys(("duration_s", "seed", "set", "out"))
    return {
        "pitch bench": {
            "rig": [name for name, rotors in rigs.items() if any(rotor.x_m for rotor in rotors)],
            "schedule": list_names("schedules"),
            "controllers": [*PITCH_CONTROLLERS],
            "gains": gain_names(),
            **common,
        },
        "flight": {
            "case": {name: flight.title for name, flight in FLIGHTS.items()},
            # Thrust and three torques need at least four rotors.
            "rig": [name for name, rotors in rigs.items() if len(rotors) >= 4],
            "controllers": [*FLIGHT_CONTROLLERS],
            "gains": gain_names(),
            "z_over_r": None,
            "speed_m_s": None,
            **common,
        },
    }


class SimulateTab(CommandTab):
    """Form and report of one page."""

    label, icon, noun = "Simulate", "flight_takeoff", "simulation"
    folds_form = False

    def __init__(self, context: PageContext) -> None:
        super().__init__(context)
        with self.inputs, titled_card("Simulation"):
            self._kind = ui.toggle([*KINDS], value="pitch bench", on_change=self.change)
            self._kind.props('no-caps aria-label="Type of simulation"')
            self._forms = {
                kind: self._build_form(kind, fields) for kind, fields in _choices().items()
            }
            self.add_controls()
        context.persist("simulate.kind", self._kind)
        self.show_latest()

    def _build_form(self, kind: str, fields: Mapping[str, Options | None]) -> InputForm[Simulation]:
        form: InputForm[Simulation] = InputForm(KINDS[kind], self.change)
        with ui.element("div").classes("field-grid large") as container:
            for name, options in fields.items():
                form.add(name, options=options)
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
            show_title(section, "saved in the runs folder; see Runs")
            if recording:
                explain = ui.button("Explain", icon="troubleshoot").props("outline")
                explain.on_click(lambda: open_tab("explain", learn=recording))
            show_section(section)


build = SimulateTab
