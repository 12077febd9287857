"""The fault matrix as one table: which fault, over which links, in which phases, ends a sweep how.

    python -m tests.faults.matrix [RESULTS]

runs every cell (or takes what an earlier call has written to the file RESULTS and goes on there),
prints each that is not as the table says, and the counts and stop times that stand in
docs/explanation/safety.md. Where RESULTS is left out, other sources have a file of their own.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from math import isnan
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any, get_args

from tests.faults.cell import Cell, Expected, Result, run_cell
from tests.faults.dialects import Phase
from tests.faults.proxy import Fault
from tests.long_count import LongCount, sources_hash

PHASES: tuple[Phase, ...] = get_args(Phase)

FAULTS: dict[str, dict[str, Any]] = {
    "device silent": {"kind": "drop", "way": "host"},
    "device silent 0.6 s": {"kind": "drop", "way": "host", "for_s": 0.6},
    "host unheard 0.6 s": {"kind": "drop", "way": "device", "for_s": 0.6},
    "a tenth lost": {"kind": "drop", "p": 0.1},
    "answers lost 0.35 s": {"kind": "drop", "way": "host", "only": "answers", "for_s": 0.35},
    "all 0.15 s late": {"kind": "delay", "delay_s": 0.15},
    "samples twice": {"kind": "duplicate", "way": "host", "only": "samples"},
    "commands twice": {"kind": "duplicate", "way": "device"},
    "samples reversed": {"kind": "reorder", "way": "host", "only": "samples", "for_s": 0.6},
    "bits turned": {"kind": "corrupt", "p": 0.05},
    "cut short": {"kind": "truncate", "p": 0.05},
    "stall 0.2 s": {"kind": "stall", "for_s": 0.2},
    "stall 2 s": {"kind": "stall", "for_s": 2.0},
    "cable pulled": {"kind": "cut"},
    "plate frozen": {"kind": "freeze", "way": "host", "channel": "plate_z_m"},
    "thrust frozen": {"kind": "freeze", "way": "host", "channel": "thrust_N"},
    "acknowledged, not done": {"kind": "ignore", "way": "device"},
    "limit switch closes": {"kind": "happen", "text": "limit", "after_s": 0.04},
    "reset pressed": {"kind": "happen", "text": "reset", "after_s": 0.04},
    "power fails": {"kind": "happen", "text": "power", "after_s": 0.04},
    "answer garbled": {"kind": "corrupt", "way": "host", "times": 1},
    "order garbled": {"kind": "corrupt", "way": "device", "only": "G1", "times": 1},
    "order 100 mm off": {"kind": "replace", "way": "device", "only": " Z-1", "text": " Z-2"},
    "order beyond limits": {"kind": "replace", "way": "device", "only": " Z-", "text": " Z-9"},
    "Idle reads Check": {"kind": "replace", "way": "host", "only": "<Idle", "text": "<Check"},
}
"""Each fault without its phase, which it begins with; `Fault` says what the words mean. The stage
is on its way 0.04 s after the order to move.
"""

RAMPING_S = 0.1  # a fault in a ramp begins so long after its first order: motors turn by then


def fault_of(cell: Cell) -> Fault:
    """Return a cell's fault, not begun yet."""
    after_s = RAMPING_S if cell.phase == "ramping" else 0.0
    return Fault(**{"phase": cell.phase, "after_s": after_s} | FAULTS[cell.fault])


UNSEEN = "rotor 1 was not seen to stand: no reading came after zero was commanded; cut the power"
TURNING = "MOTORS MAY STILL TURN: rpm1 4"
WATCHDOG = "watchdog: no line for"
UNFIT = "that does not fit a pulse of"
SILENT = "sent nothing for"
CLOSED, BROKE = "closed the connection", "the link to...broke"
NO_PULSE, NO_PLATE = "did not acknowledge 'pwm,", "did not acknowledge 'plate,"
NO_STOP = "did not acknowledge 'stop'"
NO_ACK = "did not acknowledge a motor command"
ANEW = "restarted...lost its position"
UNMOVED = "plate_z_m still reads 1.4000 m after the move"

TURNS = "ramping sampling stopping closing"  # phases that come after a motor's first turn
RUNS = Expected()  # the run goes on to its end


def ends(code: int, cause: str, within_s: float | None = None) -> Expected:
    return Expected((code,), cause, within_s)


def row(links: str, fault: str, phases: str, expected: Expected) -> Iterator[Cell]:
    """Return the cells of a line of the table."""
    for link in links.split():
        for phase in phases.split():
            assert phase in PHASES
            yield Cell(link, phase, fault, expected)  # type: ignore[arg-type]


# fmt: off
ROWS = (
    row("tcp pty", "device silent 0.6 s", "arming", ends(3, "did not acknowledge 'clear")),
    row("tcp pty", "device silent 0.6 s", "tare", ends(3, "did not acknowledge 'tare")),
    row("tcp pty", "device silent 0.6 s", "moving", ends(3, NO_PLATE)),
    row("tcp pty", "device silent 0.6 s", "ramping sampling", RUNS),
    row("tcp pty", "device silent 0.6 s", "stopping", ends(3, NO_PULSE, 0.6)),
    row("tcp pty", "device silent 0.6 s", "hello", RUNS),
    row("tcp", "device silent 0.6 s", "closing", ends(3, NO_STOP)),
    row("tcp", "device silent", "hello", ends(3, "sent nothing for 5 s")),
    row("tcp", "device silent", "arming", ends(3, "did not acknowledge 'clear")),
    row("tcp", "device silent", "tare", ends(3, "did not acknowledge 'tare")),
    row("tcp", "device silent", "moving", ends(3, NO_PLATE)),
    row("tcp", "device silent", "ramping sampling", ends(8, UNSEEN, 1.4)),
    row("tcp", "device silent", "stopping closing", ends(8, UNSEEN, 0.6)),
    row("grbl", "device silent 0.6 s", "connect hello arming moving", RUNS),
    row("grbl", "device silent", "moving", ends(3, "did not reply to the move")),
    row("grbl", "device silent", "sampling", ends(3, "did not reply to the request")),
    row("mavlink", "device silent", "hello", ends(3, "nothing came for 5 s")),
    row("mavlink", "device silent", "arming", ends(3, "did not acknowledge command 511")),
    row("mavlink", "device silent", "moving", ends(3, SILENT)),
    row("mavlink", "device silent", "closing", ends(8, UNSEEN, 0.35)),
    row("mavlink", "device silent", "ramping sampling", ends(8, UNSEEN, 0.6)),
    row("mavlink", "device silent", "stopping", ends(8, UNSEEN, 0.35)),
    row("tcp pty", "host unheard 0.6 s", "arming", ends(3, "did not acknowledge 'clear")),
    row("tcp pty", "host unheard 0.6 s", "tare", ends(3, "did not acknowledge 'tare")),
    row("tcp pty", "host unheard 0.6 s", "moving", ends(3, NO_PLATE)),
    row("tcp pty", "host unheard 0.6 s", "ramping sampling", ends(4, WATCHDOG, 0.35)),
    row("tcp pty", "host unheard 0.6 s", "stopping", ends(3, NO_PULSE, 0.35)),
    row("mavlink", "host unheard 0.6 s", "ramping sampling", ends(4, UNFIT, 0.35)),
    row("mavlink", "host unheard 0.6 s", "stopping", ends(3, NO_ACK, 0.35)),
    row("tcp pty", "host unheard 0.6 s", "hello", RUNS),
    row("tcp", "host unheard 0.6 s", "closing", ends(3, NO_STOP, 0.35)),
    row("mavlink", "host unheard 0.6 s", "hello arming moving closing", RUNS),
    row("tcp", "a tenth lost", "connect ramping sampling", RUNS),
    row("pty mavlink", "a tenth lost", "ramping sampling stopping", RUNS),
    row("pty", "a tenth lost", "connect hello tare moving", RUNS),
    row("pty", "a tenth lost", "arming", ends(4, WATCHDOG)),
    row("tcp pty", "answers lost 0.35 s", "connect arming sampling", RUNS),
    row("tcp pty", "answers lost 0.35 s", "stopping", RUNS),
    row("tcp", "answers lost 0.35 s", "tare moving", RUNS),
    row("mavlink", "answers lost 0.35 s", "ramping sampling stopping", RUNS),
    row("tcp", "all 0.15 s late", "connect ramping sampling", RUNS),
    row("grbl", "all 0.15 s late", "connect", RUNS),
    row("tcp pty", "samples twice", "connect ramping sampling", RUNS),
    row("mavlink", "samples twice", "ramping sampling stopping", RUNS),
    row("tcp pty", "commands twice", "connect ramping sampling", RUNS),
    row("tcp", "commands twice", "arming moving stopping", RUNS),
    row("mavlink", "commands twice", "ramping sampling stopping", RUNS),
    row("tcp pty", "samples reversed", "connect ramping sampling", RUNS),
    row("mavlink", "samples reversed", "ramping sampling stopping", RUNS),
    row("tcp pty", "bits turned", "connect ramping sampling", RUNS),
    row("mavlink", "bits turned", "ramping sampling stopping", RUNS),
    row("tcp pty", "cut short", "connect ramping sampling", RUNS),
    row("tcp pty", "stall 0.2 s", "moving ramping", RUNS),
    row("tcp pty", "stall 0.2 s", "sampling stopping", ends(4, WATCHDOG, 0.35)),
    row("tcp pty mavlink", "stall 2 s", "hello", RUNS),
    row("tcp", "stall 2 s", "closing", ends(3, NO_STOP, 0.35)),
    row("mavlink", "stall 2 s", "arming closing", RUNS),
    row("mavlink", "stall 2 s", "moving", ends(3, SILENT)),
    row("tcp pty", "stall 2 s", "arming", ends(3, "did not acknowledge 'clear")),
    row("tcp pty", "stall 2 s", "tare", ends(3, "did not acknowledge 'tare")),
    row("tcp pty", "stall 2 s", "moving", ends(3, NO_PLATE)),
    row("tcp pty mavlink", "stall 2 s", "ramping sampling", ends(3, SILENT, 0.35)),
    row("tcp pty", "stall 2 s", "stopping", ends(3, NO_PULSE, 0.35)),
    row("mavlink", "stall 2 s", "stopping", ends(3, NO_ACK, 0.35)),
    row("tcp mavlink", "cable pulled", "hello arming moving", ends(3, CLOSED)),
    row("tcp", "cable pulled", "tare", ends(3, CLOSED)),
    row("pty", "cable pulled", "hello arming tare moving", ends(3, BROKE)),
    row("tcp mavlink", "cable pulled", TURNS, ends(8, f"{UNSEEN}...{CLOSED}", 0.35)),
    row("pty", "cable pulled", TURNS, ends(8, f"{UNSEEN}...{BROKE}", 0.35)),
    row("grbl", "cable pulled", "homing moving ramping sampling", ends(3, BROKE)),
    row("tcp pty", "plate frozen", "connect", ends(3, UNMOVED)),
    row("tcp pty", "plate frozen", "ramping sampling", RUNS),
    row("tcp pty", "thrust frozen", "connect", ends(3, "after 3 tares, limit")),
    row("tcp pty", "thrust frozen", "ramping sampling", ends(4, "all the time", 0.8)),
    row("tcp pty", "acknowledged, not done", "arming tare moving", ends(3, UNMOVED)),
    row("tcp pty", "acknowledged, not done", "ramping sampling", ends(8, TURNING, 2.5)),
    row("tcp pty", "acknowledged, not done", "stopping", ends(8, TURNING, 1.4)),
    row("mavlink", "acknowledged, not done", "ramping sampling", ends(4, UNFIT, 0.35)),
    row("mavlink", "acknowledged, not done", "stopping", RUNS),
    row("grbl", "limit switch closes", "moving", ends(3, "the move to...ALARM:1")),
    row("grbl", "limit switch closes", "sampling", ends(3, "ALARM:1")),
    row("grbl", "reset pressed", "homing", ends(3, "homing...ALARM:6")),
    row("grbl", "reset pressed", "moving", ends(3, "the move to...ALARM:3")),
    row("grbl", "reset pressed", "sampling", ends(3, ANEW)),
    row("grbl", "power fails", "homing moving sampling", ends(3, ANEW)),
    row("grbl", "answer garbled", "moving", RUNS),
    row("grbl", "order garbled", "moving", ends(3, "rejected the move to 1.362 m: error:1")),
    row("grbl", "order 100 mm off", "moving", ends(3, "was held...a digit was wrong on the line")),
    row("grbl", "order beyond limits", "moving stopping", ends(3, "the move to...ALARM:2")),
    row("grbl", "Idle reads Check", "moving stopping", ends(3, "was held: it reports Check")),
)
# fmt: on

CELLS = tuple(cell for cells in ROWS for cell in cells)


def results(path: Path, cells: Sequence[Cell]) -> list[tuple[Cell, Result]]:
    """Run what a file of results lacks, add it there, and return each cell with its result."""
    found = []
    with LongCount(path, len(cells), "cells") as count, TemporaryDirectory() as folder:
        done = dict(map(json.loads, count.lines))
        for number, cell in enumerate(cells):
            if cell.name not in done:
                own = Path(folder) / str(number)
                own.mkdir()
                done[cell.name] = asdict(run_cell(cell, fault_of(cell), own))
                count.add(json.dumps([cell.name, done[cell.name]]))
            found.append((cell, Result(**done[cell.name])))
            if found[-1][1].wrong:
                print(f"wrong: {cell.name}: {found[-1][1].wrong}", flush=True)
    return found


def print_table(found: Sequence[tuple[Cell, Result]]) -> None:
    """Print how many cells of each link ended how, and when motors stood."""
    print("| link | cells | measured to the end | ended early | stops | to zero, median | worst |")
    print("|---|---|---|---|---|---|---|")
    for link in (*dict.fromkeys(cell.link for cell in CELLS), ""):
        own = [(cell, result) for cell, result in found if link in ("", cell.link)]
        ran = sum(result.code == 0 for _, result in own)
        # Motors turned when these faults began, and end for them; who lies stops when it will.
        stops_s = [
            result.zero_s
            for cell, result in own
            if cell.expected.within_s is not None
            and not isnan(result.zero_s)
            and cell.fault != "acknowledged, not done"
        ]
        times = f"{median(stops_s):.2f} s | {max(stops_s):.2f} s" if stops_s else "- | -"
        counts = f"{len(own)} | {ran} | {len(own) - ran} | {len(stops_s)}"
        print(f"| {link or 'all'} | {counts} | {times} |")


def main(path: Path, cells: Sequence[Cell] = CELLS) -> int:
    """Return 1 where a cell is not as the table says."""
    found = results(path, cells)
    print_table(found)
    wrong = sum(bool(result.wrong) for _, result in found)
    print(f"{wrong} of {len(found)} cells wrong")
    return int(wrong > 0)


if __name__ == "__main__":
    own = f"build/fault-matrix-{sources_hash('benchtool', 'tests/faults')}.jsonl"
    sys.exit(main(Path(sys.argv[1] if len(sys.argv) > 1 else own)))
