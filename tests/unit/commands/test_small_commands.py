"""Commands that write or show one thing: firmware, flow, demo, record --dry-run."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import pytest

from benchtool.commands import demo
from benchtool.virtual.devices import LARGEST_SPEED
from tests.unit.commands.command_line import run


def test_firmware_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "new" / "my_bench"
    assert run("firmware", "--board", "uno", "--out", str(out), "--device-id", "bench-01") == 0
    said = capsys.readouterr().out
    assert "Arduino Uno R3, device bench-01" in said
    assert (out / "my_bench.ino").exists()
    assert '"bench-01"' in (out / "settings.h").read_text("utf-8")


def test_two_devices_never_share_a_name(tmp_path: Path) -> None:
    for name in ("one", "two"):
        assert run("firmware", "--out", str(tmp_path / name)) == 0
    one, two = ((tmp_path / name / "settings.h").read_text("utf-8") for name in ("one", "two"))
    assert one != two


@pytest.mark.slow
def test_table_and_picture_of_the_flow(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("flow", "table") == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed[1].split()[3:] == ["-0.014", "-0.026", "-0.037", "-0.013", "+0.014", "+0.046"]
    assert "prescribed wake, not CFD" in printed[-1]
    assert run("flow", "picture", "--out", str(tmp_path)) == 0
    svg = (tmp_path / "fig05-flow.svg").read_text("utf-8")
    assert svg.startswith("<?xml")
    assert (tmp_path / "fig05-flow.png").stat().st_size > 50_000


def test_the_greatest_speed_is_that_of_the_virtual_bench(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run("demo", "--speed", f"{LARGEST_SPEED + 1.0:g}") == 2
    assert f"allowed is 1 to {LARGEST_SPEED:,g};" in capsys.readouterr().err


@pytest.mark.parametrize("address", ["sim:pquad?mode=pitch&schedule=steps", "serial:/dev/none"])
def test_a_dry_run_opens_nothing(address: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("record", address, "--rig", "pquad", "--dry-run") == 0
    assert "nothing was opened, nothing spins" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("codes", "speeds", "ends"),
    [((3, 0), (20, 5), "quad-at-5"), ((5,), (20,), 5), ((4, 3, 8, 3), (20, 5, 1.25, 1), 3)],
)
def test_a_demo_sweeps_again_and_slower_on_a_busy_computer(
    codes: tuple[int, ...], speeds: tuple[float, ...], ends: str | int,
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    served: list[float] = []
    left = list(codes)

    @contextmanager
    def bench(words: list[str]) -> Iterator[str]:
        served.append(float(words[words.index("--speed") + 1]))
        yield "serial:/dev/pts/0"

    def swept(words: list[str], check: bool) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess(words, left.pop(0))

    monkeypatch.setattr(demo, "_served", bench)
    monkeypatch.setattr(demo.subprocess, "run", swept)
    commands: list[str] = []
    with pytest.raises(SystemExit) if left[-1] else nullcontext() as ended:
        found = demo._swept("quad", "pquad", tmp_path / "quad", 20.0, 1, commands)
    assert tuple(served) == speeds
    if ended is not None:
        assert (ended.value.code, commands) == (ends, [])
    else:
        assert found.name == ends
        assert "--speed 5" in commands[0]
        assert commands[1].endswith(ends)
