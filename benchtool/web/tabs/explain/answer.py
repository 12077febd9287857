"""The answer on the page: the sentence, accept it, where, which, the gap, what is next."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from html import escape
from pathlib import Path
from urllib.parse import urlencode

from nicegui import run, ui

from benchtool.web.context import PageContext
from benchtool.web.notifications import shows_errors
from benchtool.web.sections import PageSection
from benchtool.web.tabs.explain.sources import RecordingSources
from benchtool.web.tabs.explain.work import ExplainJob, ExplanationResult
from benchtool.web.widgets import CommandRow, show_section

OPEN = ("What now", "Where", "Which", "The gap")
"""Sections of the report that are shown; the others can be opened."""


class AnswerView:
    """Show an answer and let it be accepted.

    Args:
        context: of the page.
        sources: where recordings and models are.
        written: called when the answer has been written.
    """

    def __init__(
        self,
        context: PageContext,
        sources: RecordingSources,
        written: Callable[[], Awaitable[None]],
    ) -> None:
        self._context, self._sources, self._written = context, sources, written
        self._place = ui.column().classes("w-full gap-3 scroll-place")

    def clear(self) -> None:
        """Remove an earlier answer."""
        self._place.clear()

    def show(self, job: ExplainJob) -> None:
        """Show the answer of a job."""
        found = job.state.result
        if found is None:
            return
        self.clear()
        with self._place:
            with ui.card().classes("w-full gap-2"):
                self._head(job, found)
            for part in found.parts:
                if part.title in OPEN:
                    with ui.card().classes("w-full"):
                        show_section(part)
            with ui.card().classes("w-full"):
                for part in found.parts:
                    if part.title not in OPEN:
                        with ui.expansion(part.title).classes("w-full").props("dense"):
                            show_section(part, headed=False)
        self._place.run_method("scrollIntoView", {"behavior": "smooth", "block": "start"})

    def _head(self, job: ExplainJob, found: ExplanationResult) -> None:
        with ui.row().classes("items-center gap-3"):
            ui.label("Answer").classes("card-title")
            if found.simulated:
                ui.label("SIMULATED").classes("stamp")
            ui.label(f"after {found.seconds:.1f} s").classes("soft")
        ui.label(found.sentence).classes("text-h6").props("role=status").mark("verdict")
        show_section(PageSection(title="", fragments=found.highlights), headed=False)
        CommandRow(job.words)
        with ui.row().classes("items-center gap-4 w-full"):
            words = f"Accept {' and '.join(found.named)} into a new model"
            button = ui.button(words if found.named else "Save this answer", icon="check")
            button.props("no-caps").mark("accept")
            status = ui.html(self._status(job, found), sanitize=False)
            status.props("role=status").mark("accepted")

        @shows_errors
        async def accept() -> None:
            self._context.claim_control()
            button.disable()
            try:
                await run.io_bound(job.accept, _free(job.out))
            finally:
                button.set_enabled(job.accepted is None)
            status.set_content(self._status(job, found))
            await self._written()

        button.on_click(accept)
        button.set_enabled(job.accepted is None)

    def _status(self, job: ExplainJob, found: ExplanationResult) -> str:
        """Return what accepting does, or what it has done, as HTML."""
        if job.accepted is None:
            what = "model.toml, the report and the figures" if found.named else "report and figures"
            return f'<span class="soft">writes {what} to {escape(str(job.out))}</span>'
        address = "?" + urlencode({"tab": "runs", "run": self._sources.runs.name_of(job.out)})
        link = f'<a href="{escape(address)}">{escape(job.out.name)}</a>'
        if not job.accepted:
            return f"saved as {link}"
        model = escape(job.accepted)
        return f"the model <b>{model}</b> was written to {link}; it can be chosen above"


def _free(out: Path) -> Path:
    """Return the folder, or the next number behind its name where it was taken meanwhile."""
    count, free = 1, out
    while free.exists():
        count += 1
        free = out.with_name(f"{out.name}-{count}")
    return free
