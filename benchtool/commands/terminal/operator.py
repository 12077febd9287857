"""Operator at a terminal, and live output of a sweep."""

from __future__ import annotations

import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console, Group
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.table import Table

from benchtool.acquire.operator import POLL_INTERVAL_S, Unattended
from benchtool.acquire.record import NO_PROGRESS, ProgressLines, RunProgress
from benchtool.acquire.visit_order import Visit, format_duration
from benchtool.commands.terminal.messages import print_error
from benchtool.commands.terminal.tables import EscapedConsole
from benchtool.core.errors import InputError
from benchtool.data.run.append import Event
from benchtool.data.run.points import Point

POINT_LINES = 4  # of a sweep without a terminal
TABLE_ROWS = 8  # latest points in the live table


class TerminalOperator(Unattended):
    """Operator who answers on standard input, with a live display on a terminal.

    Without a terminal `verbose` prints every point, else about `POINT_LINES` of them.
    """

    def __init__(self, *, verbose: bool = True) -> None:
        self._verbose = verbose

    def warn(self, text: str) -> None:
        print_error(text)

    def answer(self, question: str, meanwhile: Callable[[], object] | None = None) -> str:
        print(question, end="", flush=True)
        if meanwhile is None:
            return _check_line(sys.stdin.readline())
        lines: list[str] = []
        reader = threading.Thread(target=lambda: lines.append(sys.stdin.readline()), daemon=True)
        reader.start()
        while reader.is_alive():
            meanwhile()
            reader.join(POLL_INTERVAL_S)
        return _check_line(lines[0] if lines else "")

    @contextmanager
    def display(self, radius_m: float | None) -> Iterator[RunProgress]:
        console = EscapedConsole()
        if not console.is_terminal:
            yield (ProgressLines if self._verbose else FewLines)(radius_m, self.inform)
            return
        display = LiveDisplay(radius_m, console)
        with Live(console=console, refresh_per_second=4, get_renderable=display.render):
            yield display


TERMINAL = TerminalOperator()


def _check_line(line: str) -> str:
    if not line:
        print()
        raise InputError(
            "no answer: end of input; run the command in a terminal, or use --yes "
            "(sweep, record, bench check) if the bench allows it"
        )
    return line.rstrip("\n")


class FewLines(ProgressLines):
    """Print the first point, about `POINT_LINES` others and every event."""

    def measured(self, point: Point, remaining_s: float) -> None:
        number = self._done + 1
        if number in (1, self._visits) or number % -(-self._visits // POINT_LINES) == 0:
            super().measured(point, remaining_s)
        else:
            self._done = number


class LiveDisplay(RunProgress):
    """Progress bar with remaining time, and table of the latest points and events."""

    def __init__(self, radius_m: float | None, console: Console) -> None:
        self._radius_m = radius_m
        self._latest: deque[Point] = deque(maxlen=TABLE_ROWS)
        self._event = ""
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[left]} left"),
            console=console,
        )
        self._task = self._bar.add_task("sweep", total=None, left="?")

    def started(self, visits: int, done: int, expected_s: float) -> None:
        self._bar.update(self._task, total=visits, completed=done, left=format_duration(expected_s))

    def visiting(self, visit: Visit) -> None:
        self._bar.update(self._task, description=visit.description(self._radius_m))

    def measured(self, point: Point, remaining_s: float) -> None:
        self._latest.append(point)
        self._bar.update(self._task, advance=1, left=format_duration(remaining_s))

    def happened(self, event: Event) -> None:
        if event.event not in NO_PROGRESS:
            self._event = f"{event.time_s:.1f} s  {event.event}: {event.text}"

    def render(self) -> Group:
        table = Table(box=None, pad_edge=False)
        radius_m = self._radius_m
        plate_columns = () if radius_m is None else ("kind", "z/R")
        for name in ("point", *plate_columns, "pwm us", "rpm", "thrust N", "+-", "V", ""):
            table.add_column(name, justify="left" if name == "kind" else "right")
        for point in list(self._latest):
            table.add_row(
                str(point.point),
                *(() if radius_m is None else (point.kind, f"{point.plate_z_m / radius_m:.2f}")),
                f"{max(point.pwm_us):.0f}",
                f"{max(point.rpm):.0f}",
                f"{point.thrust_N:.3f}",
                f"{point.thrust_se_N:.3f}",
                f"{point.voltage_V:.2f}",
                "" if point.settled else "not settled",
            )
        return Group(table, self._event, self._bar)
