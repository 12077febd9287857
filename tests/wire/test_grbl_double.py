"""The double of a stage against recorded conversations of a driver with Grbl 1.1h."""

from __future__ import annotations

import ast
import re
from dataclasses import replace
from pathlib import Path

import pytest

from tests.doubles.grbl import StageHardware, VirtualGrbl
from tests.wire.grbl_recordings import CASE_SETTINGS, Entry, Recording, names

STAGE = names("driver_", "sweep_")

NOT_IMITATED = "driver_ok_lost_move"
"""A hold and a reset in one piece, 0.2 s before the end of a move."""

ELSEWHERE = {
    # Faults of the stage itself, and settings that were made before the recording began.
    "driver_alarm_line_lost": {"missing": "Z"},
    "driver_no_switch": {"missing": "Z"},
    "driver_one_axis_only": {"missing": "XY"},
    "driver_stuck_switch": {"stuck": "Z"},
    "driver_switch_closed_at_connect": {"stuck": "Z", "closed": "Z"},
}

MORE_SETTINGS: dict[str, dict[int, float]] = {
    "driver_alarm_line_lost": {132: 300},
    "driver_no_switch": {132: 300},
    "sweep_hard_limit": {21: 1},
}

START_MM = {"driver_homing_too_long": -1400.0}
OFFSETS = {"driver_reports_wpos": {"X": 5.0, "Y": 6.0, "Z": -50.0}}
BOOT_S = {"driver_uno_resets_on_open": 1.6, "driver_slow_boot": 4.6}  # of boards with a boot loader

CUT = ("driver_cable_in_move", "driver_frozen_in_move", "sweep_cable")
"""The line was cut while an answer was on its way."""

SYNC_S = 8.0
"""The host waits for the virtual stage at most so long longer than it waited for the real one."""

NEAR_MM = 9.0  # what 0.1 s more or less make on the way


def as_said(recording: Recording) -> list[Entry]:
    """Return a recording with what the line between host and stage changed undone."""
    entries: list[Entry] = []
    altered_s = -1.0
    for entry in recording.entries:
        words = entry.data.decode("latin-1")
        if became := re.match(r"on its way to the stage this became (b.*)", words):
            entries[-1] = replace(entries[-1], data=ast.literal_eval(became[1]))
        elif said := re.match(r"the stage had said (b.*)", words):
            entries.append(Entry(entry.t_s, "stage", ast.literal_eval(said[1])))
            altered_s = entry.t_s
        elif words.startswith("the ok above was never said"):
            entries.pop()
        elif entry.who != "stage" or entry.t_s != altered_s:
            entries.append(entry)
    return entries


class Played:
    """Play the host's part to a virtual stage; collect what it says."""

    def __init__(self, recording: Recording) -> None:
        name = recording.name
        settings = CASE_SETTINGS.get(name, {}) | MORE_SETTINGS.get(name, {})
        hardware = StageHardware(**{k: set(v) for k, v in ELSEWHERE.get(name, {}).items()})
        self.stage = VirtualGrbl(None, START_MM.get(name, -30.0), settings, hardware)
        hardware.lost_mm |= {"X": -3.0, "Y": -3.0}
        self.stage.offset_mm |= OFFSETS.get(name, {})
        self.stage.startup = "G20G91" if name == "driver_startup_lines" else ""
        self.boot_s = BOOT_S.get(name, 0.03)
        self.release_s = float("inf")
        self.now_s = 0.0
        self.text = b""

    def wait(self, until_s: float) -> None:
        while self.now_s < until_s:
            self.now_s = min(self.now_s + 0.005, until_s)
            if self.now_s >= self.release_s:
                self.stage.release()
                self.stage.hardware.closed.clear()
                self.release_s = float("inf")
            self.text += self.stage.step(b"", self.now_s)

    def send(self, data: bytes) -> None:
        self.text += self.stage.step(data, self.now_s)

    def happens(self, event: str) -> None:
        """Do to the stage what an event of the recording did."""
        if before := re.match(r"before, another program: (b.*?) -> (b.*)", event):
            self.send(ast.literal_eval(before[1]))
        elif "switch" in event and "closes" in event:
            self.stage.switch("Z", closed=True)
            if event.endswith("stays so"):
                self.stage.hardware.stuck.add("Z")
            elif event == "switch closes":
                self.release_s = self.now_s + 0.3
        elif "switch" in event and "opens" in event:
            self.stage.hardware.stuck.clear()
            self.stage.switch("Z", closed=False)
        elif found := re.match(r"(hold|start|abort) button", event):
            self.stage.press({"hold": "H", "start": "S", "abort": "R"}[found[1]])
            if "pressed" not in event:
                self.release_s = self.now_s + 0.3
        elif event == "released":
            self.stage.release()
        elif event in ("the board restarts", "power on", "restart by the opened port"):
            self.stage.restart(self.boot_s)
        elif event == "$C from elsewhere":
            self.send(b"$C\n")


def lines_of(text: bytes) -> list[str]:
    return [line.strip() for line in text.decode("latin-1").split("\n") if line.strip()]


def others(lines: list[str]) -> list[str]:
    return [line for line in lines if not line.startswith("<")]


def play(recording: Recording) -> tuple[list[str], list[str]]:
    """Return the lines of the real stage and those of the virtual one."""
    played, real, behind_s = Played(recording), b"", 0.0
    for entry in as_said(recording):
        if entry.who == "stage":
            real += entry.data
            continue
        if entry.data.startswith((b"from here on nothing", b"cable pulled", b"power off")):
            break
        played.wait(entry.t_s + behind_s)
        if entry.who == "event":
            played.happens(entry.data.decode("latin-1"))
            continue
        latest_s = played.now_s + SYNC_S
        while len(others(lines_of(played.text))) < len(others(lines_of(real + b"\n"))):
            if played.now_s >= latest_s:
                break
            played.wait(played.now_s + 0.01)
        behind_s = played.now_s - entry.t_s
        played.send(entry.data)
    played.wait(played.now_s + 2.0)
    return lines_of(real[: real.rfind(b"\n") + 1]), lines_of(played.text)


def fields_of(report: str) -> tuple[str, list[float], list[str]]:
    """Return state, place and the names of the fields of a report."""
    state, place, *rest = report.strip("<>").split("|")
    return (
        state,
        [float(mm) for mm in place[5:].split(",")],
        [place[:4], *(r.split(":")[0] for r in rest)],
    )


@pytest.mark.parametrize("name", [n for n in STAGE if n != NOT_IMITATED] or ["none"])
def test_it_says_what_the_real_stage_said(recordings: Path, name: str) -> None:
    real, virtual = play(Recording.read(recordings / f"{name}.jsonl.gz"))
    assert others(virtual) == others(real)
    asked = [line for line in real if line.startswith("<")]
    answered = [line for line in virtual if line.startswith("<")]
    if name in CUT:
        answered = answered[: len(asked)]
    assert len(answered) == len(asked)
    states = [fields_of(line)[0] for line in asked]
    for number, (theirs, ours) in enumerate(zip(asked, answered, strict=True)):
        _, place, fields = fields_of(theirs)
        found, stands, shown = fields_of(ours)
        # A state may begin one question earlier or later.
        assert found in states[max(number - 1, 0) : number + 2], (theirs, ours)
        assert shown == fields, (theirs, ours)
        assert stands == pytest.approx(place, abs=NEAR_MM), (theirs, ours)
