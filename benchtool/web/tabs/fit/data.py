"""The data of a fit on the page: runs and tables to choose, a table to upload, its columns."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from benchtool.data.csv_text import read_csv_text
from benchtool.data.run.entry import Entry
from benchtool.data.run.runs_folder import columns_file
from benchtool.web.context import PageContext
from benchtool.web.notifications import notify, notify_error, shows_errors
from benchtool.web.tabs.fit.columns import ColumnLine, columns_of, lines_for, units_for
from benchtool.web.tabs.fit.work import store_columns
from benchtool.web.tabs.runs.listing import RunsListing
from benchtool.web.widgets import TableUpload, show_fragment

NONE, CONSTANT = "", "\0constant"

READER = "tables"

LABELS = {
    "thrust_N": "thrust_N (needed)",
    "thrust_se_N": "thrust_se_N (its standard error)",
    "plate_z_m": "plate_z_m (rotor plane to plate)",
    "rpm1": "rpm1 (or that of all rotors)",
    "pwm1_us": "pwm1_us (where there is no rpm)",
}
"""What a fit wants first, for people; other channels are in a list that can be opened."""


class DataCard:
    """Choose what is fitted.

    Args:
        context: of the page.
        listing: of the runs folder.
        changed: called after every change.
    """

    def __init__(
        self, context: PageContext, listing: RunsListing, changed: Callable[[], None]
    ) -> None:
        self._context, self._listing, self._changed = context, listing, changed
        self._folder = listing.folder
        self.entries: dict[str, Entry] = {}
        self._choice = ui.select({}, multiple=True, label="Runs and tables", on_change=self._take)
        self._choice.props("use-chips use-input input-debounce=0").classes("w-full").mark("data")
        self._choice.on("popup-show", self.look)
        TableUpload(context, self._uploaded)
        self._columns = ui.column().classes("w-full")
        self._offer()

    @property
    def names(self) -> list[str]:
        """What is chosen and still there, in the order of choosing."""
        return [name for name in self._choice.value or [] if name in self.entries]

    async def choose(self, names: list[str]) -> None:
        """Choose these, as far as they can be fitted."""
        await self.look()
        for name in names:
            if name not in self.entries:
                self._folder.path_of(name)  # raises what is wrong with a name
                notify(f"{name} is not fitted: it is neither a sweep nor a readable table")
        self._choice.set_value([name for name in names if name in self.entries])

    @shows_errors
    async def look(self) -> None:
        """Offer what is in the runs folder now."""
        if await self._listing.look():
            self._offer()

    def _offer(self) -> None:
        found = [entry for entry in self._listing.entries if entry.can_fit]
        self.entries = {entry.name: entry for entry in found}
        offered = {
            entry.name: f"{entry.name} ({', '.join(filter(None, (entry.rig, entry.said)))})"
            for entry in found
        }
        if offered != self._choice.options:
            self._choice.set_options(offered, value=self.names)

    def _take(self) -> None:
        self._columns.clear()
        with self._columns:
            for name in self.names:
                if self.entries[name].kind == "table":
                    try:
                        self._columns_form(name)
                    except Exception as error:  # noqa: BLE001 -- the page stays usable
                        notify_error(error)
        self._changed()

    @shows_errors
    async def _uploaded(self, name: str) -> None:
        await self.look()
        notify(f"saved as {name}; choose its columns")
        self._choice.set_value([*self.names, name])

    def _columns_form(self, name: str) -> None:
        """Ask which column of a table is which.

        Raises:
            BenchtoolError: the table cannot be read.
        """
        path = self._folder.file_of(name)
        header = read_csv_text(path).header
        lines = lines_for(path)
        readers: list[Callable[[], ColumnLine]] = []
        with ui.expansion(f"Columns of {name}", value=not columns_file(path).is_file()) as form:
            form.classes("w-full bordered")
            ui.label("Choose the column of each channel; what is left empty is not used.").classes(
                "soft"
            )
            readers += [_column_line(line, header) for line in lines if _is_first(line)]
            with ui.expansion("More channels").classes("w-full"):
                readers += [_column_line(line, header) for line in lines if not _is_first(line)]
            use = ui.button("Use these columns").props("outline no-caps")
            result = ui.column().classes("w-full")

        @shows_errors
        async def store() -> None:
            self._context.claim_control()
            result.clear()
            columns = columns_of(read() for read in readers)
            worker = self._context.worker(READER)
            fragments = await worker.run(store_columns, self._context.runs, name, columns)
            with result:
                for fragment in fragments:
                    show_fragment(fragment)
            self._changed()

        use.on_click(store)


def _column_line(line: ColumnLine, header: tuple[str, ...]) -> Callable[[], ColumnLine]:
    """Make one line of the form, and return what reads it."""
    choices = {NONE: "–", CONSTANT: "one number for all rows"}
    choices |= {cell: cell for cell in header if cell}
    value = line.column or (CONSTANT if line.constant is not None else NONE)
    with ui.row().classes("items-center w-full gap-3 column-line"):
        column = ui.select(choices, value=value if value in choices else NONE)
        column.props(f'dense outlined label="{LABELS.get(line.channel, line.channel)}"')
        column.classes("grow").mark(f"column {line.channel}")
        number = ui.number(value=line.constant).props("dense outlined step=any")
        number.props(f'label="{line.channel} in every row"').classes("w-40")
        number.bind_visibility_from(column, "value", value=CONSTANT)
        unit = ui.select(list(units_for(line.channel)), value=line.unit)
        unit.props(f'dense outlined label="unit" aria-label="unit of {line.channel}"')
        unit.classes("w-28").mark(f"unit {line.channel}")
        reverse = ui.checkbox("reversed", value=line.reversed).props("dense")
        reverse.props(f'aria-label="{line.channel} points the other way"')

    def read() -> ColumnLine:
        chosen = column.value
        return ColumnLine(
            channel=line.channel,
            column="" if chosen in (NONE, CONSTANT) else str(chosen),
            constant=number.value if chosen == CONSTANT else None,
            unit=str(unit.value),
            reversed=bool(reverse.value),
        )

    return read


def _is_first(line: ColumnLine) -> bool:
    return line.channel in LABELS or bool(line.column) or line.constant is not None
