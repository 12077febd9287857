from __future__ import annotations

import numpy as np
import pytest

from benchtool.bench.clocks import DeviceClock
from benchtool.bench.mavlink.side_cell import CellLines, SideCell, in_order
from benchtool.core.errors import NoDevice
from benchtool.testing.scripted_link import ScriptedLink


def test_hx711_examples_are_read_in_pieces() -> None:
    lines = CellLines()
    text = b"ading: 1\r\nHX711 reading: 124006\r\none reading:\t16.1\t| average:\t4.2\r\n"
    text += b"ready\r\n-3.5\n"
    readings = [value for at in range(0, len(text), 5) for value in lines.feed(text[at : at + 5])]
    assert readings == [124006.0, 16.1, -3.5]


def test_a_line_without_an_end_is_not_kept_for_ever() -> None:
    lines = CellLines()
    assert lines.feed(b"x" * 100_000) == []
    assert lines.feed(b"\nHX711 reading: 7\n") == [7.0]


class Text(ScriptedLink):
    """A port that says one line at every read."""

    def read(self, timeout_s: float) -> bytes:
        self.now_s += max(timeout_s, 1e-3)
        return b"HX711 reading: 5\n"


def test_readings_stand_on_the_autopilots_clock() -> None:
    link = Text()
    cell = SideCell(link, "/dev/cell", link.clock)
    cell.open()
    clock = DeviceClock()
    # At 100 s of ours the autopilot had been up for 7 s.
    clock.learn(7_000_000, 100.0)
    times_us, values = cell.rows(lambda wall_s: wall_s, clock, 3, [0, 1])
    assert times_us[-1] == round(7e6 + 1e6 * (link.now_s - 100.0))
    np.testing.assert_array_equal(values[-1], [5.0, 5.0, np.nan])
    assert len(cell.rows(lambda wall_s: wall_s, clock, 3, [0, 1])[0]) == 0


def test_a_silent_cell_is_named() -> None:
    link = ScriptedLink()
    with pytest.raises(NoDevice, match="the load cell on /dev/cell sent nothing for 5 s"):
        SideCell(link, "/dev/cell", link.clock).open()
    assert link.opened == 1


def test_rows_of_two_sources_come_in_order_and_never_twice_at_one_time() -> None:
    first = np.array([10, 20, 30]), np.full((3, 2), 1.0)
    second = np.array([5, 20, 31]), np.full((3, 2), 2.0)
    times_us, values = in_order(first, second, after_us=7)
    assert times_us.tolist() == [8, 10, 20, 21, 30, 31]
    assert values[:, 0].tolist() == [2.0, 1.0, 1.0, 2.0, 1.0, 2.0]
