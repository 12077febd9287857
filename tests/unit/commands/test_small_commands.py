"""Commands firmware, demo and `record --dry-run`."""

from __future__ import annotations

import subprocess
import sys
from types import SimpleNamespace

import pytest

from benchtool.commands.terminal.operator import FewLines
from tests.unit.commands.command_line import run


def test_firmware_is_written(tmp_path, capsys):
    out = tmp_path / "new" / "my_bench"
    assert run("firmware", "--board", "uno", "--out", str(out), "--device-id", "bench-01") == 0
    output = capsys.readouterr().out
    assert "Arduino Uno R3, device bench-01" in output
    assert (out / "my_bench.ino").exists()
    assert '"bench-01"' in (out / "settings.h").read_text("utf-8")


def test_two_devices_have_different_ids(tmp_path):
    for name in ("one", "two"):
        assert run("firmware", "--out", str(tmp_path / name)) == 0
    first, second = ((tmp_path / name / "settings.h").read_text("utf-8") for name in ("one", "two"))
    assert first != second


@pytest.mark.slow
def test_the_demo_prints_its_commands_and_its_report(tmp_path):
    arguments = [sys.executable, "-m", "benchtool", "demo", "--out", str(tmp_path / "demo")]
    process = subprocess.run(arguments, capture_output=True, text=True, check=True, timeout=300)
    page = tmp_path / "demo" / "fit" / "report.html"
    assert process.stdout.endswith(f"\nThe report: {page.resolve()}\n")
    assert process.stdout.count("\n$ benchtool ") == 2
    assert page.is_file()


@pytest.mark.parametrize("address", ["sim:pquad?mode=pitch&schedule=steps", "serial:/dev/none"])
def test_a_dry_run_opens_nothing(address, capsys):
    assert run("record", address, "--rig", "pquad", "--dry-run") == 0
    assert "nothing was opened, nothing spins" in capsys.readouterr().out


def test_a_sweep_without_a_terminal_prints_few_of_its_points():
    lines: list[str] = []
    point = SimpleNamespace(pwm_us=(1500.0,), thrust_N=3.2, thrust_se_N=0.002, settled=True)
    progress = FewLines(None, lines.append)
    progress.started(42, 0, 60.0)
    for _ in range(42):
        progress.measured(point, 1.0)
    assert [line.partition(" ")[0] for line in lines[1:]] == [
        "1/42",
        "11/42",
        "22/42",
        "33/42",
        "42/42",
    ]
