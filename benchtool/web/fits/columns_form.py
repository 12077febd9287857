"""The form that maps a table's columns to our channels."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from benchtool.store.csv_text import read_csv_text
from benchtool.store.runs_folder import RunsFolder
from benchtool.store.upload import columns_file
from benchtool.web.context import Context
from benchtool.web.fits.columns import (
    Line,
    columns_of,
    lines_for,
    units_for,
)
from benchtool.web.fits.jobs import keep_columns
from benchtool.web.show import show_piece
from benchtool.web.tell import tells_errors

NONE, CONSTANT = "", "\0constant"

READER = "tables"

WORDS = {
    "thrust_N": "thrust_N (needed)",
    "thrust_se_N": "thrust_se_N (its standard error)",
    "plate_z_m": "plate_z_m (rotor plane to plate)",
    "rpm1": "rpm1 (or that of all rotors)",
    "pwm1_us": "pwm1_us (where there is no rpm)",
}
"""What a fit wants first, for people; other channels are shown when they are asked for."""


class ColumnsForm:
    """Ask which column of one table is which.

    Args:
        context: of the page.
        name: of the table.
        kept: called when a map was kept.

    Raises:
        BenchtoolError: the table cannot be read.
    """

    def __init__(self, context: Context, name: str, kept: Callable[[], None]) -> None:
        self._context, self._name, self._kept = context, name, kept
        path = RunsFolder(context.runs).file_of(name)
        header = read_csv_text(path).header
        lines = lines_for(path)
        known = columns_file(path).is_file()
        self._read: list[Callable[[], Line]] = []
        with ui.expansion(f"Columns of {name}", value=not known).classes("w-full bordered"):
            ui.label("Say which column holds what; what is left empty is not used.").classes("soft")
            for line in lines:
                if _is_shown(line):
                    self._line(line, header)
            with ui.expansion("More channels").classes("w-full"):
                for line in lines:
                    if not _is_shown(line):
                        self._line(line, header)
            ui.button("Use these columns", on_click=self._keep).props("outline no-caps")
            self._shown = ui.column().classes("w-full")

    def _line(self, line: Line, header: tuple[str, ...]) -> None:
        choices = {NONE: "–", CONSTANT: "one number for all rows"}
        choices |= {cell: cell for cell in header if cell}
        value = line.column or (CONSTANT if line.constant is not None else NONE)
        with ui.row().classes("items-center w-full gap-3 column-line"):
            column = ui.select(choices, value=value if value in choices else NONE)
            column.props(f'dense outlined label="{WORDS.get(line.channel, line.channel)}"').classes(
                "grow"
            )
            column.mark(f"column {line.channel}")
            number = ui.number(value=line.constant).props("dense outlined step=any")
            number.props(f'label="{line.channel} in every row"').classes("w-40")
            number.bind_visibility_from(column, "value", value=CONSTANT)
            unit = ui.select(list(units_for(line.channel)), value=line.unit)
            unit.props(f'dense outlined label="unit" aria-label="unit of {line.channel}"')
            unit.classes("w-28").mark(f"unit {line.channel}")
            turned = ui.checkbox("reversed", value=line.reversed).props("dense")
            turned.props(f'aria-label="{line.channel} points the other way"')

        def read() -> Line:
            chosen = column.value
            return Line(
                channel=line.channel,
                column="" if chosen in (NONE, CONSTANT) else str(chosen),
                constant=number.value if chosen == CONSTANT else None,
                unit=str(unit.value),
                reversed=bool(turned.value),
            )

        self._read.append(read)

    @tells_errors
    async def _keep(self) -> None:
        self._context.need_pen()
        self._shown.clear()
        columns = columns_of(read() for read in self._read)
        root = self._context.runs
        told = await self._context.worker(READER).run(keep_columns, root, self._name, columns)
        with self._shown:
            for piece in told:
                show_piece(piece)
        self._kept()


def _is_shown(line: Line) -> bool:
    return line.channel in WORDS or bool(line.column) or line.constant is not None
