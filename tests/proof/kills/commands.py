"""The commands that are killed, and what must hold of what each of them leaves behind."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from benchtool.acquire.pitch import CHUNK_S, RAMP_UP_S
from benchtool.acquire.record import STEP_S
from benchtool.data.calibration import read_calibration
from benchtool.data.run.append import read_events
from benchtool.data.run.read import is_run, read_points, read_samples
from benchtool.data.run.run import Run, check_not_existing, has_rows, read_settings
from tests.faults.loop import ADDRESS, Outcome, World, command, plan
from tests.proof.kills.disk import Disk, recorded, write_tree

RUN = "runs/run"  # where the run is; `runs` is as new as the run in it

WITHOUT_PHASE = re.compile(rb"^((?:[^,]*,){3})[^,]*")
"""A row of the samples but for its phase, which a resumed run marks anew."""

FAST = 20.0  # times the speed of life; the slower, the more writes of the same rows

Tree = dict[str, bytes | None]


@dataclass(frozen=True, slots=True)
class Left:
    """What one kill or power cut left.

    Attributes:
        root: the folder as it is now.
        said: what the command had printed.
        handed: the files as the command had handed them to the system.
        whole: the files as the command leaves them when nothing ends it.
        before: the files as they were before the command.
        power: whether the power failed; else the process alone was killed.
    """

    root: Path
    said: str
    handed: Tree
    whole: Tree
    before: Tree
    power: bool

    def lines(self, name: str, tree: Tree | None = None) -> list[bytes]:
        """Return the whole lines of a file, of those left where no tree is given."""
        path = self.root / name
        data = path.read_bytes() if path.is_file() else b""
        if tree is not None:
            data = tree.get(name) or b""
        return data.split(b"\n")[:-1]


@dataclass(frozen=True, slots=True)
class Killed:
    """One command: how its folder begins, how it is run, and what must hold after a kill."""

    name: str
    prepare: Callable[[Path], None]
    words: tuple[str, ...]
    check: Callable[[Left], None]

    def run(self, root: Path) -> Outcome:
        """Run it to its end."""
        outcome = command([*self.words], root, World([], FAST))
        assert outcome.code == 0, outcome.said
        return outcome


def check_run(left: Left) -> None:
    """Require every whole row, and a run that closes, once, with what was said to be there."""
    run = left.root / RUN
    measured = len(re.findall(r"^\d+/\d+ ", left.said, re.MULTILINE))
    rows, points = check_rows(left), left.lines(f"{RUN}/points.csv")
    whole_points = left.lines(f"{RUN}/points.csv", left.whole)
    assert points == whole_points[: len(points)]
    visited = [row for row in points[1:] if b",tare," not in row]
    assert len(visited) >= measured
    check_unchanged(left, f"{RUN}/")
    if not is_run(run):
        assert not rows
        assert not measured
        check_not_existing(run)  # the command can be given again
        return
    said_to_be_ended = f"in {RUN}" in left.said
    missing = Run.open(run).close()
    assert not (missing and said_to_be_ended)
    facts = Run.open(run).metadata
    assert facts["state"] in ("ended", "stopped")
    assert check_rows(left) == rows
    assert left.lines(f"{RUN}/points.csv") == points
    assert not Run.open(run).close()
    assert not list(run.glob(".*"))
    assert read_events(run / "events.jsonl")
    if len(rows) > 1:
        assert len(read_samples(run)) == len(rows) - 1
        assert "samples.parquet" in read_samples(run).provenance["file"]
    if len(points) > 1:
        assert len(read_points(run, ["measure", "reference", "anchor", "tare"])) == len(points) - 1
    if facts["state"] == "ended" and has_rows(run / "settings.csv"):
        assert len(read_settings(run)) == len({row.split(b",")[2] for row in visited})


def check_rows(left: Left) -> list[bytes]:
    """Return the whole rows of the samples; every one that had to be there is."""
    rows = [WITHOUT_PHASE.sub(rb"\1", row) for row in left.lines(f"{RUN}/samples.csv")]
    whole = [WITHOUT_PHASE.sub(rb"\1", row) for row in left.lines(f"{RUN}/samples.csv", left.whole)]
    handed = left.lines(f"{RUN}/samples.csv", left.handed)
    before = left.lines(f"{RUN}/samples.csv", left.before)
    assert rows == whole[: len(rows)]
    # A torn line that was not cut off has the next one behind it.
    assert len({row.count(b",") for row in whole}) <= 1
    if not left.power:
        assert len(rows) == len(handed)
    assert len(rows) >= len(before)
    measured = {
        row.split(b",")[0]
        for row in left.lines(f"{RUN}/points.csv")[1:]
        if not row.startswith(b"0,")
    }
    sampled = [row.split(b",")[2:4] for row in left.lines(f"{RUN}/samples.csv", left.whole)]
    needed = [i for i, (point, phase) in enumerate(sampled)
              if point in measured and phase == b"sample"]  # fmt: skip
    assert len(rows) > max(needed, default=-1)
    return rows


def check_recorded(left: Left) -> None:
    """Require a run that closes, and after a power cut all but the last part of its samples."""
    check_run(left)
    handed, rows = (
        left.lines(f"{RUN}/samples.csv", left.handed)[1:],
        left.lines(f"{RUN}/samples.csv")[1:],
    )
    if handed:
        last_s = float(rows[-1].split(b",")[0]) if rows else 0.0
        first_s = float(handed[0].split(b",")[0])
        lost_s = float(handed[-1].split(b",")[0]) - max(last_s, first_s)
        assert lost_s <= RAMP_UP_S + CHUNK_S + STEP_S, lost_s


def check_unchanged(left: Left, *but: str) -> None:
    """Require every other file that was there before to be as it was."""
    for name, data in left.before.items():
        if data is not None and not name.startswith(but):
            assert (left.root / name).read_bytes() == data, name


def check_whole(left: Left, made: tuple[str, ...], done: str) -> None:
    """Require every file of its own name to be as it was or whole, and whole once that is said."""
    check_unchanged(left, *made)
    for name, data in left.whole.items():
        if data is None or not name.startswith(made):
            continue
        path = left.root / name
        found = path.read_bytes() if path.exists() else None
        assert found in (data, left.before.get(name)), f"{name} is torn"
        if done in left.said:
            assert found == data, f"{name} was said to be there"


STORED = ".state/calibration/cell.json"


def check_calibrated(left: Left) -> None:
    """Require the calibration of before or the new one, whole."""
    check_whole(left, (".state/", "c."), "stored in")
    assert read_calibration(left.root / STORED).device_id == "cell"


def check_fitted(left: Left) -> None:
    """Require a result that is whole or absent."""
    check_whole(left, ("fitted/",), "report.html")


def empty(root: Path) -> None:
    (root / "plan.toml").write_text(plan("1.36, 1.34", 0.5))
    (root / "notes.txt").write_text("mine")


SWEEP = ("sweep", ADDRESS, "--rig", "pquad_single", "--plan", "plan.toml", "--yes", "--out", RUN)


def swept(root: Path, until: Callable[[str, str], bool], torn: bool = False) -> None:
    """Leave what a sweep leaves that is killed once its output or a new name is so."""
    empty(root)
    disk = Disk.of(root)
    with recorded(root) as changes:
        said = command([*SWEEP], root, World([], FAST)).said
    for change in changes:
        new = [name for (_, name), number in change.names if number]
        if until(said[: change.said], "".join(new)):
            break
        disk.apply(change)
    shutil.rmtree(root / "runs")
    shutil.rmtree(root / ".state", ignore_errors=True)
    tree = disk.after_kill()
    if torn:
        tree[f"{RUN}/samples.csv"] = (tree[f"{RUN}/samples.csv"] or b"")[:-7]
    write_tree(root, {name: data for name, data in tree.items() if name.startswith("runs")})


def dead(root: Path) -> None:
    """Leave a sweep that was killed when all was measured."""
    swept(root, lambda said, new: "settings.csv" in new)


def half(root: Path) -> None:
    """Leave a sweep that was killed in its second visit, in the middle of a row."""
    moving = []

    def until(said: str, new: str) -> bool:
        moving.append("1/2 " in said)
        return sum(moving) > 30

    swept(root, until, torn=True)


def weighed(root: Path) -> None:
    """Leave counts under known masses, and a calibration of an earlier day."""
    rows = [f"{mass},{1000.0 + 1e5 * mass}" for mass in (0.0, 0.2, 0.5, 0.2, 0.0)]
    (root / "m.csv").write_text("\n".join(["mass_kg,thrust_raw", *rows, ""]))
    command(["calibrate", "--from", "m.csv", "--device-id", "cell"], root, World([], FAST))
    (root / "m.csv").write_text("\n".join(["mass_kg,thrust_raw", *rows[:4], ""]))


def to_fit(root: Path) -> None:
    """Leave a run of five distances, closed."""
    (root / "plan.toml").write_text(plan("0.06, 0.09, 0.15, 0.3, 1.36", 0.3))
    command([*SWEEP], root, World([], FAST))


KILLED = {
    one.name: one
    for one in (
        Killed("sweep", empty, SWEEP, check_run),
        Killed("close", dead, ("runs", "close", RUN), check_run),
        Killed("resume", half, ("sweep", ADDRESS, "--yes", "--resume", RUN), check_run),
        Killed(
            "record",
            empty,
            ("record", "sim:pquad?mode=pitch", "--seconds", "3", "--yes", "--out", RUN),
            check_recorded,
        ),
        Killed(
            "calibrate",
            weighed,
            ("calibrate", "--from", "m.csv", "--device-id", "cell", "--out", "c.json"),
            check_calibrated,
        ),
        Killed("fit", to_fit, ("fit", RUN, "--model", "single", "--out", "fitted"), check_fitted),
    )
}
