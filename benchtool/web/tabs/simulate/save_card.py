"""Download a simulation, or save it to the runs folder, from where it can be explained."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from benchtool.data.run.runs_folder import RunsFolder
from benchtool.physics.model_file import model_names
from benchtool.simulate.pitch.inputs import PitchInputs
from benchtool.web.context import PageContext
from benchtool.web.tabs.simulate.work import Simulation, command_words, write_into, zipped
from benchtool.web.widgets import CommandRow, open_tab, shows_errors, titled_card, today


def _bench_of(inputs: PitchInputs) -> tuple[str, dict[str, float]]:
    """Return what makes a bench another one: neither its controllers nor the plate."""
    others = ("gains.", "plate.")
    settings = inputs.study.settings.items()
    return str(inputs.rig), {name: to for name, to in settings if not name.startswith(others)}


class SaveCard:
    """Offer what the command writes with --out."""

    def __init__(self, context: PageContext, inputs: Callable[[], Simulation]) -> None:
        self._context, self._inputs = context, inputs
        self._folder = RunsFolder(context.runs)
        self._worker = context.worker("simulations")
        self._named = ""
        self._recordings: list[tuple[str, PitchInputs]] = []
        with titled_card("Save"):
            with ui.row().classes("items-end w-full gap-3"):
                self._name = ui.input("Name of the folder", on_change=self._show).classes("grow")
                self._save = ui.button("Save to the runs folder", icon="save", on_click=self._write)
                self._zip = ui.button("Download CSV", icon="download", on_click=self._download)
                self._zip.props("outline").tooltip("the same files as one zip file")
            self._command = CommandRow()
            with ui.row().classes("items-center w-full gap-3") as self._after:
                self._saved = ui.label().classes("grow").props("role=status")
                self._explain = ui.button("Explain", icon="troubleshoot", on_click=self._open)
                self._explain.props("outline")
            self._after.set_visibility(False)

    def refresh(self) -> None:
        """Show the name and the command that belong to what is simulated now."""
        if not self._name.value or self._name.value == self._named:
            self._suggest()
        self._show()

    def _suggest(self) -> None:
        inputs = self._inputs()
        if isinstance(inputs, PitchInputs):
            what = f"pitch-{inputs.schedule}"
        else:
            what = f"flight-{inputs.case}"
        self._named = self._folder.free_path(today(), what).name
        self._name.set_value(self._named)

    def _show(self) -> None:
        name = (self._name.value or "").strip()
        out = ["--out", str(self._folder.root / name)] if name else []
        self._command.show([*command_words(self._inputs()), *out])

    @shows_errors
    async def _write(self) -> None:
        self._context.claim_control()
        inputs, out = self._inputs(), self._folder.new_path((self._name.value or "").strip())
        self._save.props("loading")
        try:
            files = await self._worker.run(write_into, inputs, out)
        finally:
            self._save.props(remove="loading")
        self._suggest()
        if isinstance(inputs, PitchInputs):
            self._recordings.append((f"{out.name}/{files[0]}", inputs))
        self._report(out.name)

    def _report(self, name: str) -> None:
        self._after.set_visibility(True)
        pair = self._pair()
        self._explain.set_visibility(pair is not None)
        text = f"saved as {name}; it is listed under Runs"
        if pair is not None:
            text = f"saved as {name}: explain {pair[0]}, checked on {pair[1]}"
        elif self._recordings:
            text += (
                "; to explain it, save a second one to check on: the same bench, another seed, "
                "another schedule"
            )
        self._saved.set_text(text)

    def _pair(self) -> tuple[str, str] | None:
        """Return the two newest recordings of one bench, the older one to learn from."""
        *earlier, (newest, inputs) = self._recordings or [("", PitchInputs())]
        same = [name for name, each in earlier if _bench_of(each) == _bench_of(inputs)]
        return (same[-1], newest) if same else None

    def _open(self) -> None:
        if (pair := self._pair()) is not None:
            model = f"pitch_{self._recordings[-1][1].rig}"
            more = {"model": model} if model in model_names() else {}
            open_tab("explain", learn=pair[0], check=pair[1], **more)

    @shows_errors
    async def _download(self) -> None:
        self._zip.disable()
        try:
            packed = await self._worker.run(zipped, self._inputs())
        finally:
            self._zip.enable()
        ui.download.content(packed, "simulation.zip", "application/zip")
